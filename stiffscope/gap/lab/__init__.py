"""The virtual lab: a robot with known faults, and the campaign that a lab would measure on it.

Its mechanics are its own: nothing of `stiffscope.vjm` or of the diagnosis is imported here.
"""
