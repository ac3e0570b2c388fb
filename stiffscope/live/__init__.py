"""A page that follows a robot file."""
