"""Studies, their responses, and sensitivities."""
