"""Pages and pictures of vibration."""
