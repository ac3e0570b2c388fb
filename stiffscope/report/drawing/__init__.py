"""Pictures of solids: pyvista renders off-screen, matplotlib adds titles and scales; run as a process of its own.

Every picture is a function that is called by name through `stiffscope.report.pictures.draw`. Lengths in m.
"""
