"""Robot files from STEP assemblies, URDF and MJCF."""
