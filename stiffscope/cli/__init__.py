"""The command line: each command reads its input, calls the library and shows the results."""
