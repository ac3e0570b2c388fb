"""The command line: each command reads its input, calls the rooms below, and shows what they return."""
