"""Stiffness, sag, deflection and equilibrium under load."""
