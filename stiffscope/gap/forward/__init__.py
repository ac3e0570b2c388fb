"""What a robot with given effects would read."""
