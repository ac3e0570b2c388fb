"""Natural frequencies, mode shapes and frequency responses."""
