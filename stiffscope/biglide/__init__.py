"""The publication that the Biglide is from: its own model, its audit, its gravity."""
