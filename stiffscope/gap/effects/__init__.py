"""Possible causes of a gap between model and machine."""
