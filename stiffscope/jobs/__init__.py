"""Virtual experiments as jobs: what determines one, the cache of results, processes side by side."""
