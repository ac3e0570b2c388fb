"""Errors of the package: a base class, and the error raised for invalid user input."""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

T = TypeVar("T")

Key = tuple[str | int, ...]
"""Keys of the tables around a value and its own, outermost first."""

_NO_MEMORY = re.compile(
    r"MemoryError|bad_alloc|failed to map|(unable to|cannot) allocate|out ?of ?memory",
    re.I,
)


class StiffscopeError(Exception):
    """Base class of every error that stiffscope raises on purpose."""


class InputError(StiffscopeError, ValueError):
    """Invalid input; the message is one line: file or field, what was expected, what is valid.

    Attributes
    ----------
    further
        Messages of what else is wrong with the same file, each one line.
    """

    def __init__(self, message: str = "", further: Iterable[str] = ()) -> None:
        """Escape unprintable characters so that each message stays on one line."""
        super().__init__(_on_one_line(message))
        self.further = tuple(_on_one_line(other) for other in further)

    @property
    def lines(self) -> tuple[str, ...]:
        """All messages."""
        return (str(self), *self.further)


def _on_one_line(message: str) -> str:
    return "".join(
        letter if letter.isprintable() else repr(letter)[1:-1] for letter in message
    )


class FieldError(ValueError):
    """Error in the value of a key of a file; `Source.refuse` adds file and line."""

    def __init__(self, key: Key, message: str) -> None:
        super().__init__(message)
        self.key = key


def require(valid: object, where: object, expected: str, got: object = None) -> None:
    """Raise the error ``WHERE: expected …, got …`` unless valid.

    Parameters
    ----------
    valid
        What holds of a valid input.
    where
        File, line and field, or an option: InputError. A key of the file that is being read, as a tuple:
        FieldError, which becomes an InputError with file and line. What makes an error of a message,
        such as ``partial(source.refuse, key)``: its error. "": what calls knows the place.
    expected, got
        The valid and the given, in words; without ``got`` only what is expected is said.
    """
    if not valid:
        raise _error(where, expected, got)


def require_given(
    value: T | None, where: object, expected: str, got: object = "nothing"
) -> T:
    """Return a value; raise the error of `require` if it is None."""
    if value is None:
        raise _error(where, expected, got)
    return value


def _error(where: Any, expected: str, got: object) -> Exception:
    return _place(
        where, f"expected {expected}" + ("" if got is None else f", got {got}")
    )


def _place(where: Any, message: str) -> Exception:
    """Return the error of a message at a place; see `require`."""
    if callable(where):
        return cast("Callable[[str], Exception]", where)(message)
    if isinstance(where, tuple):
        return FieldError(where, message)
    return InputError(f"{where}: {message}" if str(where) else message)


@contextmanager
def naming(where: object, expected: str = "") -> Iterator[None]:
    """Convert a ValueError in the block to an InputError that names the place, and what is expected there.

    ``where``: as for `require`.
    """
    try:
        yield
    except ValueError as error:
        form = f"; expected {expected}" if expected else ""
        raise _place(where, f"{error}{form}") from error


@contextmanager
def expecting(
    where: object, expected: str, *kinds: type[Exception], got: object = None
) -> Iterator[None]:
    """Convert a library's error in the block to the error of `require`.

    Parameters
    ----------
    where, expected
        As for `require`.
    kinds
        Kinds of errors.
    got
        What was given, in words; by default the library's own.
    """
    try:
        yield
    except kinds as error:
        raise _error(where, expected, error if got is None else got) from error


def check_kind(name: str, value: object, kind: Any, maker: str) -> None:
    """Raise InputError for an argument of another type; ``maker``: the function that returns the right one."""
    if not isinstance(value, kind):
        raise InputError(
            f"{name}: expected what `{maker}` returns, got {type(value).__name__}"
        )


def check_word(name: str, word: str, known: tuple[str, ...]) -> None:
    """Raise InputError for an argument that is none of some words."""
    if word not in known:
        raise InputError(f"{name}: expected {' or '.join(known)}, got {word!r}")


def lacks_memory(error: BaseException) -> bool:
    """Return whether an error, also one that a library or a worker reports in words, is a lack of memory."""
    return isinstance(error, MemoryError) or bool(
        _NO_MEMORY.search(f"{error} {getattr(error, 'output', '')}")
    )


def say_count(number: int, one: str, more: str = "") -> str:
    """Return a number with its noun: "1 mode", "2 modes"; ``more``: the plural, if not with an s."""
    return f"{number:,} {one if number == 1 else more or f'{one}s'}"


def suggest(word: str, valid: Iterable[str], cutoff: float = 0.6) -> str:
    """End of a message: the valid word that was probably meant, where one is as like as ``cutoff`` (1 is the same).

    Capital and small letters are the same.
    """
    known = {candidate.casefold(): candidate for candidate in valid}
    close = difflib.get_close_matches(word.casefold(), known, n=1, cutoff=cutoff)
    return f'; did you mean "{known[close[0]]}"?' if close else ""
