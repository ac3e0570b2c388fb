"""Robots in the forms of other programs, one target a module."""
