"""Reading of user files: only regular files of bounded size, and valid UTF-8 text."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from typing import TYPE_CHECKING

from stiffscope.errors import InputError, require, require_given

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

MOST_TEXT = (
    1 << 20
)  # bytes of a file written by hand; a thousand bodies need a quarter of it
MOST_BYTES = 1 << 28  # bytes of any other file, e.g. a STEP file or a table of readings
opened = set[str]()
"""Resolved paths of the files read by this process, or since a command has cleared them."""
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_file(
    path: str | Path, what: str = "a file", most: int = MOST_BYTES
) -> BinaryIO:
    """Open a regular file for reading, without blocking on pipes.

    Parameters
    ----------
    path
        File; links are followed.
    what
        Expected kind of file for messages, e.g. "a STEP file".
    most
        Largest allowed size, bytes.

    Raises
    ------
    InputError
        The file does not exist, cannot be read, is not regular or is too large.
    """
    try:
        flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        handle = os.open(path, os.O_RDONLY | flags)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{show_path(path)}: expected {what}, got {describe_cause(error, path)}"
        ) from error
    stream = os.fdopen(handle, "rb") if stat.S_ISREG(os.fstat(handle).st_mode) else None
    kind = _KINDS.get(stat.S_IFMT(os.fstat(handle).st_mode), "no regular file")
    if stream is None:
        os.close(handle)
    stream = require_given(stream, show_path(path), what, kind)
    opened.add(os.path.realpath(path))
    size = os.fstat(handle).st_size
    if size > most:
        stream.close()
        what = f"{what} of at most {_size(most)}"
        raise InputError(f"{show_path(path)}: expected {what}, got {_size(size)}")
    return stream


def read_bytes(path: str | Path, what: str = "a file", most: int = MOST_BYTES) -> bytes:
    """Return the bytes of a file; see `open_file`.

    Parameters
    ----------
    path, what, most
        As in `open_file`.
    """
    try:
        with open_file(path, what, most) as stream:
            content = stream.read(most + 1)
    except OSError as error:
        raise InputError(
            f"{show_path(path)}: expected {what}, got {describe_cause(error, path)}"
        ) from error
    what = f"{what} of at most {_size(most)}"
    require(len(content) <= most, show_path(path), what, "a larger one")
    return content


def file_digest(path: Path, what: str = "a file", most: int = 1 << 40) -> str:
    """Return the SHA-256 of a file's bytes. Raise InputError as `open_file` does.

    Parameters
    ----------
    path, what, most
        As in `open_file`.
    """
    with open_file(path, what, most) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()  # pyright: ignore[reportArgumentType]


def read_text(
    path: str | Path, what: str = "a text file", most: int = MOST_TEXT
) -> str:
    """Return a file's UTF-8 text without byte order mark. Raise InputError for invalid text.

    Parameters
    ----------
    path, what, most
        As in `open_file`.
    """
    content = read_bytes(path, what, most)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        got = f"byte {content[error.start]:#04x} (byte {error.start})"
        raise InputError(
            f"{path}:{line}: expected {what} in UTF-8, got {got}"
        ) from error
    before, nul, _ = text.partition("\0")
    line = before.count("\n") + 1 if nul else 1
    require(not nul, f"{path}:{line}", what, "a NUL byte")
    return text


def describe_cause(error: BaseException, path: str | Path = "") -> str:
    """Return a system error about a path in a few words."""
    if isinstance(error, ValueError):  # "embedded null byte"
        return "a name that no file can have"
    number = getattr(error, "errno", None)
    if number == errno.ENAMETOOLONG:
        return f"a name of {len(str(path))} characters, longer than names of files are"
    if number == errno.ENOSPC:
        return os.strerror(errno.ENOSPC)  # libraries' own messages span several lines
    if number == errno.ENOENT:
        return "no file" if str(path) else "no name of a file"
    return {
        errno.ELOOP: "a link that leads back to itself",
        errno.ENXIO: "a socket",
    }.get(number or 0, getattr(error, "strerror", None) or str(error))


def show_path(path: str | Path) -> str:
    """Return a path for a message: on one line, shortened if long."""
    text = (
        "".join(
            letter if letter.isprintable() else repr(letter)[1:-1]
            for letter in str(path)
        )
        or '""'
    )
    return text if len(text) <= 300 else f"{text[:140]}…{text[-140:]}"


def _size(count: int) -> str:
    return f"{count / 2**20:.3g} MiB" if count >= 2**20 else f"{count} bytes"
