"""The robot file: parsed, overridden, evaluated and validated."""
