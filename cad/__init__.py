"""Parametric solids: link, slider, any STEP file, materials."""
