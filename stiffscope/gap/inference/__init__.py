"""Which effects explain the readings, and how surely."""
