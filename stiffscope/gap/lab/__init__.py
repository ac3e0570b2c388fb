"""Virtual lab: a robot with known faults, and the campaign that a lab would measure on it.

Its mechanics are independent: it imports nothing from `stiffscope.vjm` or the diagnosis.
"""
