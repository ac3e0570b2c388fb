"""What a person sees: tables, figures, pages and pictures. The only place of rich, matplotlib, pyvista and HTML."""
