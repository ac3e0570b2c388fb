"""Writing: a file appears whole or not at all, an output folder is complete or absent; the user's files stay.

An output folder is absent, empty, or holds our manifest. It is written beside and moved into place as a whole. What
the user put into it, or changed in it, is never replaced: the new results then stay beside it, unless all is forced.
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

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime.json_text import encodable, to_json
from stiffscope.runtime.reading import file_digest, read_bytes, show_path, why
from stiffscope.runtime.signals import STOPS, deaf_to

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

MANIFEST = "manifest.json"
MAKER = "stiffscope"
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_HOST = f"{zlib.crc32(platform.node().encode()):08x}"
_forced: list[bool] = []


def overwrite(whether: bool) -> None:
    """Let this process write over files that are not ours, or, as it begins, refuse to."""
    _forced[:] = [True] * whether


def is_forced() -> bool:
    """Whether this process may write over files that are not ours."""
    return bool(_forced)


def write_bytes(path: Path, content: bytes) -> None:
    """Write one file in one step: whoever looks sees the old content or the new. A link is followed, a device kept."""
    check_file(path)
    with _refusing(path):
        if _is_stream(path):
            path.write_bytes(content)
            return
        goal = _resolve(path)
        with scratch_folder(goal.parent) as folder:
            (folder / "file").write_bytes(content)
            (folder / "file").replace(goal)


def _resolve(path: str | Path) -> Path:
    """Where a path leads; a circle of links is refused by every version of Python."""
    try:
        Path(path).stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise
    return Path(path).resolve()


def check_file(path: Path) -> None:
    """Refuse a file before work is spent on it: see `write_bytes`."""
    with _refusing(path):
        if os.path.isdir(path):  # noqa: PTH112 (those of pathlib raise on some names)
            raise InputError(f"{show_path(path)}: is a folder; give a file")
        if not _is_stream(path):
            with scratch_folder(_resolve(path).parent) as folder:
                (folder / path.name).touch()


def write_new(path: Path, content: bytes) -> None:
    """Write a file that must not be there yet: neither before the work nor after it."""
    check_new(path)
    write_bytes(path, content)


def check_new(path: str | Path) -> None:
    """Refuse a file that is there already, whatever it is, and one that cannot be written."""
    if not str(path):
        raise InputError('"": expected a file to write, got no name')
    if os.path.lexists(path):
        raise InputError(f"{show_path(path)}: expected a file that is not there yet, got one that is")
    check_file(Path(path))


def check_json(path: Path) -> None:
    """Refuse a file that is there and is not empty, unless it is JSON of ours or all is forced."""
    if not _forced and os.path.isfile(path) and os.path.getsize(path):  # noqa: PTH113, PTH202
        try:
            held = json.loads(read_bytes(path))
            ours = (held[0] if isinstance(held, list) else held)["made_by"] == MAKER
        except (ValueError, KeyError, IndexError, TypeError, RecursionError):
            ours = False
        if not ours:
            raise InputError(
                f"{show_path(path)}: expected a new file or JSON that stiffscope wrote, got another; "
                "--force replaces it"
            )
    check_file(path)


def _is_stream(path: Path) -> bool:
    """Whether it is there and is a device or a pipe, which is written to, not replaced."""
    return os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113


@contextlib.contextmanager
def _refusing(path: str | Path, *, folder: bool = False) -> Iterator[None]:
    """Turn an error of the system into that of a file, or an output folder, that cannot be written."""
    try:
        yield
    except StiffscopeError:
        raise
    except (OSError, RuntimeError, ValueError) as error:  # names too long, circles of links, no folder here
        raise _unwritable(path, error, folder=folder) from error


def _unwritable(path: str | Path, error: BaseException, *, folder: bool) -> StiffscopeError:
    what, advice = "cannot be written", "give a file in a folder of yours"
    if folder:
        what, advice = f"the output folder {what}", "choose another with --out"
    text = f"{show_path(path)}: {what} ({why(error, path)});"
    if getattr(error, "errno", None) in FULL:
        return StiffscopeError(f"{text} make room on its disk{f', or {advice}' if folder else ''}")
    return InputError(f"{text} {advice}")


def write_json(target: str | Path, value: Any) -> None:
    """Write JSON to a file, marked as ours (a list in its first entry), or to standard output for "-"."""
    if str(target) == "-":
        sys.stdout.write(encodable(to_json(value), sys.stdout.encoding or "ascii"))
        sys.stdout.flush()
    else:
        content = [_mark(value[0]), *value[1:]] if isinstance(value, list | tuple) and value else _mark(value)
        write_bytes(Path(target), encodable(to_json(content), "utf-8").encode())


def _mark(value: Any) -> Any:
    return {"made_by": MAKER, **value} if isinstance(value, dict) else value


@contextlib.contextmanager
def scratch_folder(parent: Path | None = None) -> Iterator[Path]:
    """Give a temporary folder, in the system's or in `parent`; those of killed processes there are removed first."""
    holder = Path(tempfile.gettempdir()) if parent is None else parent
    prefix = "stiffscope-scratch-" if parent is None else ".stiffscope-scratch-"
    with contextlib.suppress(OSError):
        for left in holder.glob(f"{prefix}*"):
            if _is_abandoned(left, prefix):
                shutil.rmtree(left, ignore_errors=True)
    folder = holder / (prefix + owner())
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def owner() -> str:
    """End of the name of a temporary folder, another each time: this process, this machine, a number."""
    return f"{os.getpid()}-{_HOST}{uuid.uuid4().hex[:6]}"


def _is_abandoned(path: Path, prefix: str) -> bool:
    """Whether a temporary folder of this machine, PREFIX and its owner, has no process any more."""
    match = re.fullmatch(rf"(\d+)-{_HOST}[0-9a-f]+", path.name.removeprefix(prefix))
    if match is None or not path.name.startswith(prefix) or path.is_symlink():
        return False
    return not psutil.pid_exists(int(match[1]))


@contextlib.contextmanager
def staged_folder(target: str | Path) -> Iterator[Path]:
    """Give a folder to fill; when the block ends well it becomes `target` in one step.

    A former output of ours is replaced as a whole. When the block fails, `target` stays as it was.

    Raises
    ------
    InputError
        `target` is a file, cannot be written, or holds what this program did not write.
    StiffscopeError
        Its disk is full.

    """
    check_output(target)
    with _open_aside(target) as aside:
        yield aside
        _list_files(aside)
        with deaf_to(*STOPS):
            _exchange(aside, Path(target).resolve(), target)


@contextlib.contextmanager
def new_folder(target: str | Path) -> Iterator[Path]:
    """Give a folder to fill; when the block ends well it becomes `target`, in one step, and is the user's from then on.

    Raises
    ------
    InputError
        `target` is there already, or cannot be written.
    StiffscopeError
        Its disk is full.

    """
    there = InputError(f"{show_path(target)}: expected a folder that is not there yet, got one that is")
    if os.path.lexists(target):
        raise there
    check_output(target)
    with _open_aside(target) as aside:
        yield aside
        if os.path.lexists(target):
            raise there
        aside.rename(Path(target).resolve())


@contextlib.contextmanager
def _open_aside(target: str | Path) -> Iterator[Path]:
    """Give a folder beside a target, removed at the end if it is still there; what killed runs left is put right."""
    goal = Path(target).resolve()
    aside = goal.with_name(f".{goal.name}.partial-{owner()}")
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        for left in list(goal.parent.iterdir()):
            replaced = _is_abandoned(left, f".{goal.name}.replaced-")
            if replaced and not os.path.lexists(goal):
                left.rename(goal)  # killed between the two renames: the former output is the complete one
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
    """Refuse an output folder before work is spent on it: see `staged_folder`. The other outputs must not be in it."""
    with _refusing(target, folder=True):
        goal = _resolve(target)
        there = os.path.lexists(goal)
        _check_place(target, goal, there=there)
        for other in filter(None, others):
            with _refusing(other):
                if _resolve(other).is_relative_to(goal):
                    raise InputError(f"{other}: is in {target}, which is replaced as a whole; give a file elsewhere")
        for reason in _foreign(goal).values() if there and not _forced else ():
            raise InputError(f"{target}: {reason}; give a new or empty folder, or --force, which keeps that file")
        nearest = next(p for p in (goal, *goal.parents) if p.exists())
        if not nearest.is_dir():
            raise InputError(f"{show_path(target)}: {nearest} is a file, not a folder")
        with scratch_folder(goal.parent if there else nearest) as folder:
            (folder / goal.name).mkdir()


def _check_place(target: str | Path, goal: Path, *, there: bool) -> None:
    """Refuse a file, the folder that we are in, and a disk of its own."""
    if there and not goal.is_dir():
        raise InputError(f"{show_path(target)}: is a file; give a folder for the output")
    if goal in (here := Path.cwd(), *here.parents):
        better = Path(target) / "out"
        raise InputError(f"{target}: an output folder is replaced as a whole: not the one you are in; try {better}")
    if there and goal.is_mount():
        raise InputError(f"{target}: a disk of its own cannot be replaced as a whole; try {Path(target) / 'out'}")


def _foreign(folder: Path) -> dict[str, str]:
    """What in a folder is not as its manifest says that we wrote it, by name, and why."""
    ours, found = _digest_written(folder), {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        folder_with_files = path.is_dir() and not path.is_symlink() and any(path.iterdir())
        if folder_with_files or (name == MANIFEST and ours):
            continue
        if name not in ours:
            found[name] = f'holds "{name}", which stiffscope did not write'
        elif not _is(path, ours[name]):
            found[name] = f'"{name}" in it has been changed since stiffscope wrote it'
    return found


def _digest_written(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that we wrote into a folder, by name; none where it has no manifest of ours."""
    try:
        manifest = json.loads(read_bytes(folder / MANIFEST))
        return dict(manifest["sha256"]) if manifest["made_by"] == MAKER else {}
    except (InputError, ValueError, KeyError, TypeError, RecursionError):
        return {}


def _is(path: Path, checksum: str) -> bool:
    """Whether a file, no link, has this SHA-256."""
    try:
        return not path.is_symlink() and file_digest(path) == checksum
    except InputError:
        return False


def _list_files(folder: Path) -> None:
    """Complete the manifest with the folder's files and their checksums."""
    path = folder / MANIFEST
    manifest = json.loads(path.read_bytes()) if path.exists() else {}
    for place, _, _ in os.walk(folder, topdown=False):
        if Path(place) != folder and not any(Path(place).iterdir()):
            Path(place).rmdir()
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file() and p != path)
    sums = {name: file_digest(folder / name) for name in names}
    path.write_text(to_json({"made_by": MAKER, **manifest, "files": names, "sha256": sums}), encoding="utf-8")


def _exchange(aside: Path, goal: Path, target: str | Path) -> None:
    """Put the new folder in the old one's place: the only place where anything of the user's could be replaced.

    The old one is looked at when nobody finds it under its name any longer; what was saved in it meanwhile brings it
    back.
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
        kept = next(p for k in range(10_000) if not os.path.lexists(p := goal.with_name(f"{goal.name}.new{k or ''}")))
        aside.rename(kept)
        reason = next(iter(foreign.values()))
        raise InputError(f"{target}: {reason}; it stays as it is, and the new results are in {kept}")
    for name in foreign:
        if not os.path.lexists(goal / name):
            (goal / name).parent.mkdir(parents=True, exist_ok=True)
            (former / name).rename(goal / name)
    shutil.rmtree(former, ignore_errors=True)


def copy_files(source: Path, target: Path, names: Iterable[str]) -> None:
    """Copy files of a folder, by their names relative to it, into another."""
    for name in names:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(read_bytes(source / name))


def remove_copied(folder: Path, output: Path, within: str = "") -> bool:
    """Remove every file of a folder that an output of ours has byte for byte; returns whether nothing is left.

    ``within`` is the output's folder, such as "designs/", where the copies stand. Behind a link everything stays.
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
