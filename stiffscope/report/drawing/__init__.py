"""Pictures of solids, drawn in a separate process: pyvista renders, matplotlib adds titles, scales.

`stiffscope.report.pictures.draw` calls the function of each picture by name. Lengths in m.
"""
