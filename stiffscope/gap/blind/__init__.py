"""The blind check: campaigns whose effect is withheld, and how they are answered."""
