"""Blind check: diagnoses of campaigns with withheld effects."""
