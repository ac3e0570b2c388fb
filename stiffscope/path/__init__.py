"""Error of the tool along a path under process forces."""
