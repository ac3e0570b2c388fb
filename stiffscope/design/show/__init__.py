"""Tables, figures and pages of studies and sensitivities."""
