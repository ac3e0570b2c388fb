"""Commands of one part."""
