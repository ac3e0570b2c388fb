"""Forward models: readings predicted for a robot with given effects."""
