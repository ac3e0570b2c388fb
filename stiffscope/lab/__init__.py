"""The virtual laboratory: machines with known faults, and the blind check of the diagnosis."""
