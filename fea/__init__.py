"""Virtual experiments: mesh, linear elasticity, 6x6 compliance with error bounds; beam theory."""
