"""The errors of the package: one base class, and the one that a user's input raises."""


class StiffscopeError(Exception):
    """Base class of every error that stiffscope raises on purpose."""


class InputError(StiffscopeError, ValueError):
    """Bad input: its message is one line that names the file or field, what was expected and what would be valid."""

    def __init__(self, message: str = "") -> None:
        """Keep a message on its line, whatever the names and values of the user are."""
        super().__init__("".join(each if each.isprintable() else repr(each)[1:-1] for each in message))
