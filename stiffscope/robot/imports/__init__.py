"""Import of simulator models and STEP assemblies as robot files."""
