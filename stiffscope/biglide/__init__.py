"""The Biglide's publication: its stiffness model, its gravity model and an audit of its numbers."""
