"""Cache of results, addressed by a hash of everything that determines them, with checksums.

An entry is a folder `<root>/<kind>/<key>/` with files and an `entry.json` of their checksums. It is
written aside and moved into place in one step. On reading, damaged or foreign entries and other
formats are discarded. Nothing is unpickled. An unwritable cache is bypassed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import shutil
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import platformdirs

from stiffscope.errors import InputError
from stiffscope.runtime.output import scratch_folder
from stiffscope.runtime.reading import file_digest, read_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

log = logging.getLogger(__name__)
_Result = TypeVar("_Result")

FORMAT = 1
KINDS = WHOLE, CONDENSED, MOVED, SENSITIVITY, PICTURES = (
    "experiment",
    "condensed",
    "moved",
    "sensitivity",
    "pictures",
)
_INDEX = "entry.json"
_UNREADABLE = "it is another user's"
_ENDS = {
    ".step": b"END-ISO-10303-21;",
    ".vtu": b"</VTKFile>",
    ".png": b"IEND\xaeB`\x82",
}


@dataclass(frozen=True)
class Entry:
    """A stored result: kind, key, size in bytes, and time of creation in seconds since 1970."""

    kind: str
    key: str
    bytes: int
    made: float


@dataclass(frozen=True)
class Cache:
    """A store of results in one folder.

    Attributes
    ----------
    root
        Folder of the cache.
    spare
        Folder for results that cannot be stored; by default the system's temporary folder (kept).
    """

    root: Path
    spare: Path | None = None

    def get(self, kind: str, key: str) -> Path | None:
        """Return the folder of a complete and intact entry, or None."""
        folder = self.root / kind / key
        if not os.path.lexists(folder):
            return None
        reason = _flaw(folder, kind, key)
        if reason == _UNREADABLE:
            _warn_of_unreadable(self.root)
            return None
        if reason:
            log.info("cache entry %s/%s is not used: %s", kind, key[:12], reason)
            self._discard(folder)
            return None
        return folder

    def load(
        self, kinds: Iterable[str], key: str, read: Callable[[Path], _Result]
    ) -> _Result | None:
        """What `read(folder)` makes of the first entry of some kinds; a refused one is absent."""
        for kind in kinds:
            folder = self.get(kind, key)
            try:
                if folder is not None:
                    return read(folder)
            except (
                OSError,
                ValueError,
                LookupError,
                TypeError,
                AttributeError,
            ) as error:
                log.info("cache entry %s/%s is not used: %s", kind, key[:12], error)
                self._discard(self.root / kind / key)
        return None

    def put(self, kind: str, key: str, write: Callable[[Path], object]) -> Path:
        """Create a result with `write(folder)` and store it.

        Return the folder of the entry, or one in `spare` if the cache cannot be written. Errors of
        `write` are passed on. If another process stores the same key meanwhile, either one remains.

        Parameters
        ----------
        kind
            Kind of result.
        key
            Cache key.
        write
            Writes the result to a folder.
        """
        holder = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=self.spare))
        folder = holder / key
        try:
            folder.mkdir()  # by the umask, unlike the holder, so that others may read it
            write(folder)
            held = self._store_result(folder, kind, key)
        except BaseException:
            shutil.rmtree(holder, ignore_errors=True)
            raise
        if held is None:
            return folder
        shutil.rmtree(holder, ignore_errors=True)
        return held

    def entries(self, kinds: Collection[str] = ()) -> list[Entry]:
        """Return the entries of some kinds, by default of all, without checking their integrity."""
        folders = sorted(self.root.glob(f"*/*/{_INDEX}")) if self.root.is_dir() else []
        listed = (entry for index in folders if (entry := _entry(index.parent)))
        return [entry for entry in listed if not kinds or entry.kind in kinds]

    def clear(self, kinds: Collection[str] = ()) -> list[Entry]:
        """Remove and return the entries of some kinds, by default of all; keep other files."""
        gone = self.entries(kinds)
        for entry in gone:
            self._discard(self.root / entry.kind / entry.key)
        return [
            entry
            for entry in gone
            if not os.path.lexists(self.root / entry.kind / entry.key)
        ]

    def _store_result(self, path: Path, kind: str, key: str) -> Path | None:
        """Copy a result aside, add checksums, move it into place; None if this is impossible."""
        folder = self.root / kind / key
        try:
            with self._open_aside() as scratch:
                aside = scratch / key
                shutil.copytree(path, aside)
                files = {
                    name: file_digest(aside / name)
                    for name in sorted(kept_files(aside))
                }
                index = {"format": FORMAT, "kind": kind, "key": key, "files": files}
                (aside / _INDEX).write_text(json.dumps(index))
                folder.parent.mkdir(parents=True, exist_ok=True)
                for _ in range(3):
                    try:
                        aside.rename(folder)
                        return folder
                    except OSError:
                        if self.get(kind, key) is not None:
                            return folder
        except (OSError, shutil.Error) as error:
            message = "results are not kept: the cache %s cannot be written (%s)"
            log.warning(message, self.root, _reason(error))
        return None

    def _discard(self, folder: Path) -> None:
        """Remove a damaged entry, moved away first so that no process sees it half deleted."""
        with contextlib.suppress(OSError), self._open_aside() as scratch:
            folder.rename(scratch / folder.name)

    @contextlib.contextmanager
    def _open_aside(self) -> Iterator[Path]:
        (self.root / "aside").mkdir(parents=True, exist_ok=True)
        with scratch_folder(self.root / "aside") as scratch:
            yield scratch


def _reason(error: OSError) -> str:
    """Return why something cannot be written; for several files, the reason of the first."""
    if isinstance(error, shutil.Error) and error.args and error.args[0]:
        message = str(
            error.args[0][0][2]
        )  # "[Errno 28] No space left on device: 'from' -> 'to'"
        return message.partition("] ")[2].partition(":")[0] or message
    return error.strerror or str(error)


def cache_folder() -> Path:
    """Return the folder of the user's cache; the variable STIFFSCOPE_CACHE overrides it."""
    chosen = os.environ.get("STIFFSCOPE_CACHE", "")
    try:
        place = chosen or platformdirs.user_cache_dir("stiffscope", appauthor=False)
        return Path(place).expanduser().absolute()
    except RuntimeError as error:  # no home folder
        raise InputError(
            f'STIFFSCOPE_CACHE: expected a folder for the cache, got "{chosen}" without HOME'
        ) from error


def digest(determined_by: Mapping[str, Any]) -> str:
    """Return the key of a result: SHA-256 of everything that determines it, with exact numbers."""
    canonical = json.dumps(
        determined_by,
        sort_keys=True,
        separators=(",", ":"),
        allow_nan=False,
        default=_to_plain,
    )
    return hashlib.sha256(canonical.encode()).hexdigest()


@cache
def code_version(packages: tuple[str, ...], libraries: tuple[str, ...]) -> str:
    """Return a hash of the packages' source and the libraries' versions."""
    digest_of_code = hashlib.sha256(f"{sys.version_info[:2]} {FORMAT}".encode())
    for package in packages:
        folder = Path(str(import_module(package).__file__)).parent
        for source in sorted(folder.rglob("*.py")):
            digest_of_code.update(
                f"{package}/{source.relative_to(folder).as_posix()}".encode()
            )
            digest_of_code.update(source.read_bytes())
    for library in libraries:
        digest_of_code.update(f"{library} {library_version(library)}".encode())
    return digest_of_code.hexdigest()


def library_version(library: str) -> str:
    """Return the version of an installed distribution, or "none"."""
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "none"


def _to_plain(value: Any) -> Any:
    if isinstance(value, frozenset | set):
        return sorted(value)
    if isinstance(value, Path):
        return value.as_posix()
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be part of a cache key")


def totals(entries: Iterable[Entry]) -> dict[str, tuple[int, int]]:
    """Return number and size in bytes of entries by kind."""
    sizes: dict[str, list[int]] = {}
    for entry in entries:
        sizes.setdefault(entry.kind, []).append(entry.bytes)
    return {kind: (len(each), sum(each)) for kind, each in sizes.items()}


def _entry(folder: Path) -> Entry | None:
    """Return the entry described by a folder's index; None for a foreign folder."""
    kind = folder.parent.name
    key = folder.name
    try:
        index = json.loads(read_bytes(folder / _INDEX))
        linked = folder.is_symlink() or folder.parent.is_symlink()
        if (index["kind"], index["key"]) != (kind, key) or linked:
            return None
        size = sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file())
        return Entry(kind, key, size, (folder / _INDEX).stat().st_mtime)
    except (InputError, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


@cache
def _warn_of_unreadable(root: Path) -> None:
    """Warn once of a cache with entries of another user."""
    message = "the cache %s has entries that you may not read: they are computed again"
    log.warning(message, root)


def _flaw(folder: Path, kind: str, key: str) -> str | None:
    """Return why an entry is invalid, or None."""
    try:
        index = json.loads(read_bytes(folder / _INDEX))
        if (index["format"], index["kind"], index["key"]) != (FORMAT, kind, key):
            return "it is of another format or another key"
        listed = index["files"]
        if sorted(listed) != sorted(kept_files(folder)):
            return "its files are not those that were written"
        torn = [
            name
            for name, checksum in listed.items()
            if file_digest(folder / name) != checksum
        ]
        torn += [name for name in listed if not _is_whole(folder / name)]
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        if isinstance(error.__cause__ or error, PermissionError):
            return _UNREADABLE
        return f"it cannot be read ({type(error).__name__})"
    return f"{torn[0]} is damaged" if torn else None


def _is_whole(path: Path) -> bool:
    """Return whether a file of a known format ends as it must, whatever its checksum is."""
    with path.open("rb") as file:
        count = int.from_bytes(file.read(84)[80:], "little")
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - 64, 0))
        whole = _ENDS.get(path.suffix, b"") in file.read()
    return whole if path.suffix != ".stl" else size == 84 + 50 * count


def kept_files(folder: Path) -> Iterable[str]:
    """Yield the names of an entry's files relative to its folder."""
    for path in folder.rglob("*"):
        if path.is_symlink():
            raise OSError(f"{path} is a link")
        if path.is_file() and path.name != _INDEX:
            yield path.relative_to(folder).as_posix()
