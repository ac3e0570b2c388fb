"""Objects as tables and pictures in notebooks."""
