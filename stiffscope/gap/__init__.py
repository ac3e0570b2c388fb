"""The sim-to-real gap: readings, effects, diagnosis, the virtual lab, the blind check."""
