"""Robots, published tables and campaigns that come with stiffscope."""

from pathlib import Path

FOLDER = Path(__file__).parent
"""Where they are."""
