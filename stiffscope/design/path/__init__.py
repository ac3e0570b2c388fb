"""The machine at work: paths, processes, the error of the tool along a path and commands that undo it."""
