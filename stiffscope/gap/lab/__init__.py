"""The virtual lab: a machine with known faults, and the campaign that a lab would measure on it.

Its mechanics are its own: nothing of the virtual-joint model or of the diagnosis is imported here.
"""
