"""Atomic output: files and folders are written completely or not at all; user files are kept.

An output folder is absent, empty or contains our manifest; it is moved into place as a whole. Files
that the user added or changed are not replaced unless forced; new results are then left beside it.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import uuid
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil

from stiffscope.errors import InputError, StiffscopeError, require
from stiffscope.runtime.json_text import encodable, to_json
from stiffscope.runtime.reading import (
    describe_cause,
    file_digest,
    read_bytes,
    show_path,
)
from stiffscope.runtime.signals import STOPS, defer_signals

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

MANIFEST = "manifest.json"
MAKER = "stiffscope"
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_HOST = f"{zlib.crc32(platform.node().encode()):08x}"
_forced: list[bool] = []
_ANOTHER = "choose another name, or --force, which replaces files of the same names"


def overwrite(whether: bool) -> None:
    """Set whether this process may overwrite foreign files (initially not)."""
    _forced[:] = [True] if whether else []


def is_forced() -> bool:
    """Return whether this process may overwrite foreign files."""
    return bool(_forced)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically. Links are followed; devices are written to, not replaced."""
    check_file(path)
    with refusing(path):
        if _is_stream(path):
            path.write_bytes(content)
            return
        goal = _resolve(path)
        with scratch_folder(goal.parent) as folder:
            (folder / "file").write_bytes(content)
            (folder / "file").replace(goal)


def _resolve(path: str | Path) -> Path:
    """Return the resolved path; raise OSError for circular links under any Python version."""
    try:
        Path(path).stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise
    return Path(path).resolve()


def check_file(path: Path) -> None:
    """Raise InputError early for a file that `write_bytes` cannot write."""
    with refusing(path):
        # pathlib's own raises for some names
        is_folder = os.path.isdir(path)  # noqa: PTH112
        require(not is_folder, show_path(path), "a file to write", "a folder")
        if not _is_stream(path):
            with scratch_folder(_resolve(path).parent) as folder:
                (folder / path.name).touch()


def write_new(path: Path, content: bytes) -> None:
    """Write a file that does not exist yet, whole or not at all.

    Of several processes that write the same new file at once, one succeeds.

    Raises
    ------
    InputError
        The path exists, of any kind (a link to nothing, too), or cannot be written.
    """
    check_new(path)
    with refusing(path), scratch_folder(path.resolve().parent) as folder:
        (folder / "file").write_bytes(content)
        try:
            # a link is made only where nothing is, unlike a file that is moved
            os.link(folder / "file", path)
        except FileExistsError:
            _check_absent(path, "file", "choose another name")
            raise


def check_new(path: str | Path, advice: str = "choose another name") -> None:
    """Raise InputError with advice if a path exists, of any kind, or cannot be written."""
    # "", "." and "/"
    require(Path(path).name, show_path(path), "the name of a file to write", "none")
    _check_absent(path, "file", advice)
    check_file(Path(path))


def _check_absent(
    path: str | Path, kind: str, advice: str = "choose another name"
) -> None:
    require(
        not (kind and os.path.lexists(path)),
        show_path(path),
        f"a {kind} that is not there yet",
        f"one that is; {advice}",
    )


def check_json(path: Path) -> None:
    """Raise InputError for an existing nonempty file, unless it is our JSON or forced."""
    if not _forced and os.path.isfile(path) and os.path.getsize(path):  # noqa: PTH113, PTH202
        maker = None
        with contextlib.suppress(ValueError, LookupError, TypeError, RecursionError):
            held = json.loads(read_bytes(path))
            maker = (held[0] if isinstance(held, list) else held)["made_by"]
        require(
            maker == MAKER,
            show_path(path),
            "a new file or JSON that stiffscope wrote",
            "another; --force replaces it",
        )
    check_file(path)


def _is_stream(path: Path) -> bool:
    """Return whether a path is a device or a pipe, which is written to, not replaced."""
    return os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113


@contextlib.contextmanager
def refusing(path: str | Path, *, folder: bool = False) -> Iterator[None]:
    """Convert system errors to errors of an unwritable file or output folder."""
    try:
        yield
    except StiffscopeError:
        raise
    except (
        OSError,
        RuntimeError,
        ValueError,
    ) as error:  # long names, circular links etc.
        raise _unwritable(path, error, folder=folder) from error


def _unwritable(
    path: str | Path, error: BaseException, *, folder: bool
) -> StiffscopeError:
    what = "cannot be written"
    advice = "give a file in a folder of yours"
    if folder:
        what = f"the output folder {what}"
        advice = "choose another with --out"
    text = f"{show_path(path)}: {what} ({describe_cause(error, path)});"
    if getattr(error, "errno", None) in FULL:
        return StiffscopeError(
            f"{text} make room on its disk{f', or {advice}' if folder else ''}"
        )
    return InputError(f"{text} {advice}")


def write_json(target: str | Path, value: Any) -> None:
    """Write JSON to a file, marked as ours (lists in their first entry); "-" is standard output."""
    if str(target) == "-":
        sys.stdout.write(encodable(to_json(value), sys.stdout.encoding or "ascii"))
        sys.stdout.flush()
    else:
        several = isinstance(value, list | tuple) and len(value)
        content = [_mark(value[0]), *value[1:]] if several else _mark(value)
        write_bytes(Path(target), encodable(to_json(content), "utf-8").encode())


def _mark(value: Any) -> Any:
    return {"made_by": MAKER, **value} if isinstance(value, dict) else value


@contextlib.contextmanager
def scratch_folder(parent: Path | None = None) -> Iterator[Path]:
    """Yield a temporary folder, by default the system's; remove those of killed processes first."""
    holder = Path(tempfile.gettempdir()) if parent is None else parent
    prefix = "stiffscope-scratch-" if parent is None else ".stiffscope-scratch-"
    with contextlib.suppress(OSError):
        for left in holder.glob(f"{prefix}*"):
            if _is_abandoned(left, prefix):
                shutil.rmtree(left, ignore_errors=True)
    folder = holder / (prefix + owner())
    try:
        try:
            folder.mkdir(mode=0o700)
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    finally:  # a stop may have interrupted that; there is no second one
        shutil.rmtree(folder, ignore_errors=True)


def owner() -> str:
    """Return a unique suffix for a temporary folder: process, machine, number."""
    return f"{os.getpid()}-{_HOST}{uuid.uuid4().hex[:6]}"


def _is_abandoned(path: Path, prefix: str) -> bool:
    """Return whether the process of a temporary folder of this machine has ended."""
    match = re.fullmatch(rf"(\d+)-{_HOST}[0-9a-f]+", path.name.removeprefix(prefix))
    if match is None or not path.name.startswith(prefix) or path.is_symlink():
        return False
    return not psutil.pid_exists(int(match[1]))


@contextlib.contextmanager
def staged_folder(target: str | Path, *, new: bool = False) -> Iterator[Path]:
    """Yield a folder to fill; if the block succeeds, it becomes `target` in one step.

    A former output of ours is replaced as a whole. If the block fails, `target` is unchanged.
    A ``new`` folder must not exist, unless forced, and is then the user's.

    Raises
    ------
    InputError
        `target` is a file, cannot be written, contains foreign files, or exists and must be new.
    StiffscopeError
        The disk is full.
    """
    absent = "folder" if new and not _forced else ""
    _check_absent(target, absent, _ANOTHER)
    check_output(target)
    with _open_aside(target) as aside:
        yield aside
        _check_absent(target, absent, _ANOTHER)
        if not new:
            _list_files(aside)
        with defer_signals(*STOPS):
            _exchange(aside, Path(target).resolve(), target)


@contextlib.contextmanager
def _open_aside(target: str | Path) -> Iterator[Path]:
    """Yield a folder next to a target, removed at the end; clean up after killed runs first."""
    goal = Path(target).resolve()
    aside = goal.with_name(f".{goal.name}.partial-{owner()}")
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        for left in list(goal.parent.iterdir()):
            replaced = _is_abandoned(left, f".{goal.name}.replaced-")
            if replaced and not os.path.lexists(goal):
                left.rename(
                    goal
                )  # killed between the renames: restore the former output
            elif replaced or _is_abandoned(left, f".{goal.name}.partial-"):
                shutil.rmtree(left, ignore_errors=True)
        aside.mkdir()
        yield aside
    except OSError as error:
        raise _unwritable(target, error, folder=True) from error
    except StiffscopeError as error:
        if getattr(error.__cause__, "errno", None) in FULL:
            raise _unwritable(target, error.__cause__ or error, folder=True) from error
        raise
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def check_output(target: str | Path, *others: str | Path | None) -> None:
    """Raise InputError early for an invalid output folder, or one that contains other outputs."""
    with refusing(target, folder=True):
        goal = _resolve(target)
        there = os.path.lexists(goal)
        _check_place(target, goal, there=there)
        for other in filter(None, others):
            with refusing(other):
                require(
                    not _resolve(other).is_relative_to(goal),
                    other,
                    f"a file outside {target}, which is replaced as a whole",
                )
        for reason in _foreign(goal).values() if there and not _forced else ():
            cure = "give a new or empty folder, or --force, which keeps that file"
            raise InputError(f"{target}: {reason}; {cure}")
        nearest = next(p for p in (goal, *goal.parents) if p.exists())
        require(nearest.is_dir(), show_path(target), "a folder", f"{nearest}, a file")
        with scratch_folder(goal.parent if there else nearest) as folder:
            (folder / goal.name).mkdir()


def _check_place(target: str | Path, goal: Path, *, there: bool) -> None:
    """Raise InputError for a file, the working folder or a mount point."""
    is_file = there and not goal.is_dir()
    require(not is_file, show_path(target), "a folder for the output", "a file")
    what = ""
    better = Path(target) / "out"
    here = Path.cwd()
    if goal in (here, *here.parents):
        what = "an output folder is replaced as a whole: not the one you are in"
    elif there and goal.is_mount():
        what = "a disk of its own cannot be replaced as a whole"
    if what:
        raise InputError(f"{target}: {what}; try {better}")


def _foreign(folder: Path) -> dict[str, str]:
    """Return reasons for files that differ from the folder's manifest, by name."""
    ours = _digest_written(folder)
    foreign = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        folder_with_files = (
            path.is_dir() and not path.is_symlink() and any(path.iterdir())
        )
        if folder_with_files or (name == MANIFEST and ours):
            continue
        if name not in ours:
            foreign[name] = f'holds "{name}", which stiffscope did not write'
        elif not _is(path, ours[name]):
            foreign[name] = f'"{name}" in it has been changed since stiffscope wrote it'
    return foreign


def _digest_written(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of our files in a folder by name; empty without a manifest of ours."""
    with contextlib.suppress(
        InputError, ValueError, KeyError, TypeError, RecursionError
    ):
        manifest = json.loads(read_bytes(folder / MANIFEST))
        return dict(manifest["sha256"]) if manifest["made_by"] == MAKER else {}
    return {}


def _is(path: Path, checksum: str) -> bool:
    """Return whether a path is a regular file with this SHA-256 and not a link."""
    with contextlib.suppress(InputError):
        return not path.is_symlink() and file_digest(path) == checksum
    return False


def _list_files(folder: Path) -> None:
    """Add the folder's files and their checksums to the manifest."""
    path = folder / MANIFEST
    manifest = json.loads(path.read_bytes()) if path.exists() else {}
    for place, _, _ in os.walk(folder, topdown=False):
        if Path(place) != folder and not any(Path(place).iterdir()):
            Path(place).rmdir()
    files = [file for file in folder.rglob("*") if file.is_file() and file != path]
    names = sorted(file.relative_to(folder).as_posix() for file in files)
    sums = {name: file_digest(folder / name) for name in names}
    content = {"made_by": MAKER, **manifest, "files": names, "sha256": sums}
    path.write_text(encodable(to_json(content), "utf-8"), encoding="utf-8")


def _exchange(aside: Path, goal: Path, target: str | Path) -> None:
    """Replace the old folder by the new one; only here could user files be replaced.

    The old folder is checked after it was renamed; if files were saved in it meanwhile, it is
    restored.
    """
    former = goal.with_name(aside.name.replace(".partial-", ".replaced-"))
    if os.path.lexists(goal):
        goal.rename(former)
    try:
        aside.rename(goal)
    except OSError:
        if former.exists():
            former.rename(goal)
        raise
    foreign = _foreign(former) if former.exists() else {}
    if foreign and not _forced:
        goal.rename(aside)
        former.rename(goal)
        beside = (goal.with_name(f"{goal.name}.new{k or ''}") for k in range(10_000))
        free_path = next(path for path in beside if not os.path.lexists(path))
        aside.rename(free_path)
        reason = next(iter(foreign.values()))
        raise InputError(
            f"{target}: {reason}; it stays as it is, and the new results are in {free_path}"
        )
    for name in foreign:
        if not os.path.lexists(goal / name):
            (goal / name).parent.mkdir(parents=True, exist_ok=True)
            (former / name).rename(goal / name)
    shutil.rmtree(former, ignore_errors=True)


def copy_files(source: Path, target: Path, names: Iterable[str]) -> None:
    """Copy files, given by their names relative to a folder, to another folder."""
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(read_bytes(source / name))


def remove_copied(folder: Path, output: Path, within: str = "") -> bool:
    """Remove files with identical copies in an output of ours; return whether nothing is left.

    ``within`` is the subfolder of the copies, e.g. "designs/". A linked folder is left unchanged.
    """
    if folder.is_symlink():
        return False
    copies = _digest_written(output)
    for path in [path for path in folder.rglob("*") if not path.is_dir()]:
        name = within + path.relative_to(folder).as_posix()
        if name in copies and _is(path, copies[name]):
            path.unlink()
    for place, _, _ in os.walk(folder, topdown=False):
        with contextlib.suppress(OSError):
            Path(place).rmdir()
    return not folder.exists()
