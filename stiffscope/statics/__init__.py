"""Stiffness of the whole robot: at poses, over the workspace, and between versions."""
