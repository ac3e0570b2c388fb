"""stiffscope: from a CAD part to the stiffness of the whole robot, and to the gap between model and machine."""

__version__ = "0.2.0"
