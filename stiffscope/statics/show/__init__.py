"""Tables, figures and pages of a robot's stiffness."""
