"""Nouns of the mechanics: screws, joints, bodies, mechanisms."""
