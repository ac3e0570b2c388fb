"""Virtual experiments: solid, tetrahedra, linear elasticity, 6x6 compliance with an error bar; beam theory."""
