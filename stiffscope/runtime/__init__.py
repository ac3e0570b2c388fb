"""Common infrastructure: files, cache, processes, progress."""
