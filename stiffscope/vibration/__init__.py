"""Natural frequencies and frequency responses of the robot."""
