"""Campaigns: header, tables and readings."""
