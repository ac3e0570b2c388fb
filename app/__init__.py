"""What a person touches: command line, robot file, cache, plots, report page."""
