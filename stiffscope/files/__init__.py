"""Bundled robots, keys of all files, and the cache."""
