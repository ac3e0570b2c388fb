"""stiffscope: from a CAD part to the stiffness of the whole robot, and to the gap between model and machine."""

__version__ = "0.1.0"


class InputError(ValueError):
    """Bad input: its message is one line that names the file or field, what was expected and what would be valid."""
