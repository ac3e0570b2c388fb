"""Configurations of a mechanism, its mobility and its reach."""
