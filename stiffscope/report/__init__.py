"""Tables, figures, pages and pictures; only this code uses rich, matplotlib, pyvista or HTML."""
