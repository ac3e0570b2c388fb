"""Paths and processes: the tool's error along a path, and commands that compensate it."""
