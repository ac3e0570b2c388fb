"""Inference of the effects that explain the readings, with probabilities."""
