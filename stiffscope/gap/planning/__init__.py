"""Which reading to take next."""
