"""Sim-to-real gap: campaigns, forward models, inference, virtual lab and blind check."""
