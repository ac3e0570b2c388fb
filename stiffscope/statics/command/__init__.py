"""Commands of a robot's stiffness."""
