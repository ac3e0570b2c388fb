"""What every room uses: files, cache, processes, progress."""
