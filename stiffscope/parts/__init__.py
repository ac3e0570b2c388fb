"""Virtual experiments on one part."""
