"""Blind check: campaigns whose effects are withheld, and their scores."""
