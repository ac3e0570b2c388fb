"""Measured frequency responses: files, units, and what they show of themselves."""
