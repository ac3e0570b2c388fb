"""Models of other simulators, as robot files."""
