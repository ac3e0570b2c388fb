"""Machine elements: bearings, guides, screws, and force-deflection curves."""
