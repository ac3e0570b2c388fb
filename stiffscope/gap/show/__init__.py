"""Tables, figures and pages of campaigns and diagnoses."""
