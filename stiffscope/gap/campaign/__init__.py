"""Campaigns: header, tables, readings."""
