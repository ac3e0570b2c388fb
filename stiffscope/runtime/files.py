"""Writing: a file appears whole or not at all, an output folder is complete or absent; the user's files stay."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError
from stiffscope.runtime.children import STOPS, deaf_to
from stiffscope.runtime.reading import open_file, read_bytes, shown, why

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

MANIFEST = "manifest.json"
MAKER = "stiffscope"
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_bytes(path: Path, content: bytes) -> None:
    """Write one file in one step: whoever looks sees the old content or the new. A link is followed, a device kept."""
    check_file(path)
    try:
        if _is_stream(path):
            path.write_bytes(content)
            return
        goal = path.resolve()
        with scratch_folder(goal.parent) as folder:
            (folder / "file").write_bytes(content)
            (folder / "file").replace(goal)
    except OSError as error:
        raise _unwritable_file(path, error) from error


def check_file(path: Path) -> None:
    """Refuse a file before work is spent on it: see `write_bytes`."""
    try:
        if os.path.isdir(path):  # noqa: PTH112 (those of pathlib raise on some names)
            raise InputError(f"{shown(path)}: is a folder; give a file")
        if not _is_stream(path):
            with scratch_folder(path.resolve().parent) as folder:
                (folder / path.name).touch()
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise _unwritable_file(path, error) from error


def write_new(path: Path, content: bytes) -> None:
    """Write a file that must not be there yet: neither before the work nor after it."""
    check_new(path)
    write_bytes(path, content)


def check_new(path: str | Path) -> None:
    """Refuse a file that is there already, whatever it is, and one that cannot be written."""
    if not str(path):
        raise InputError('"": expected a file to write, got no name')
    if os.path.lexists(path):
        raise InputError(f"{shown(path)}: expected a file that is not there yet, got one that is")
    check_file(Path(path))


def check_json(path: Path) -> None:
    """Refuse a file that is there and holds anything but JSON: a robot file or readings, by a slip of the hand."""
    if os.path.isfile(path) and os.path.getsize(path):  # noqa: PTH113, PTH202 (those of pathlib raise on some names)
        try:
            json.loads(read_bytes(path))
        except (ValueError, RecursionError) as error:
            raise InputError(
                f"{shown(path)}: expected a new file or one with JSON to replace, got one with something else"
            ) from error
    check_file(path)


def _is_stream(path: Path) -> bool:
    """Whether it is there and is a device or a pipe, which is written to, not replaced."""
    return os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113


def _unwritable_file(path: Path, error: Exception) -> InputError:
    cure = "make room on its disk" if getattr(error, "errno", None) in FULL else "give a file in a folder of yours"
    return InputError(f"{shown(path)}: cannot be written ({why(error, path)}); {cure}")


def write_json(target: str | Path, value: Any) -> None:
    """Write JSON to a file, or to standard output where the target is "-"."""
    if str(target) == "-":
        sys.stdout.write(_encodable(to_json(value), sys.stdout.encoding or "ascii"))
        sys.stdout.flush()
    else:
        write_bytes(Path(target), _encodable(to_json(value), "utf-8").encode())


def _encodable(text: str, encoding: str) -> str:
    """JSON text as it is where an encoding has all its letters, else with escapes."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return re.sub(r"[^\x00-\x7f]", lambda letter: json.dumps(letter[0])[1:-1], text)
    return text


def to_json(value: Any) -> str:
    """JSON text with arrays as lists, one matrix row a line; what is not a finite number is null."""
    return _rows(_plain(value)) + "\n"


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None  # -0.0 + 0.0 is 0.0
    if isinstance(value, Path):
        return value.as_posix()
    return value


def _rows(value: Any, indent: str = "") -> str:
    """Indented JSON in which a list of plain values stays on one line."""
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = [f"{inner}{json.dumps(key, ensure_ascii=False)}: {_rows(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, list | dict) for item in value):
        return "[\n" + ",\n".join(inner + _rows(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


@contextlib.contextmanager
def scratch_folder(parent: Path | None = None) -> Iterator[Path]:
    """Give a temporary folder, in the system's or in `parent`; those of killed processes there are removed first."""
    holder = Path(tempfile.gettempdir()) if parent is None else parent
    prefix = "stiffscope-scratch-" if parent is None else ".stiffscope-scratch-"
    with contextlib.suppress(OSError):
        for left in holder.glob(f"{prefix}*"):
            if _abandoned(left, prefix):
                shutil.rmtree(left, ignore_errors=True)
    folder = holder / f"{prefix}{os.getpid()}-{uuid.uuid4().hex[:8]}"
    folder.mkdir(mode=0o700)
    try:
        with _claimed(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def staged_folder(target: str | Path) -> Iterator[Path]:
    """Give a folder to fill; when the block ends well it becomes `target` in one step.

    A former output of ours is replaced as a whole. When the block fails, `target` stays as it was. Where the former
    folder holds anything but what its manifest says that we wrote, byte for byte, both it and the new one stay.

    Raises
    ------
    InputError
        `target` is a file, cannot be written, is full, or is a folder with content that this program did not write.

    """
    check_output(target)
    goal = Path(target).resolve()
    aside = goal.with_name(f".{goal.name}.partial-{os.getpid()}-{uuid.uuid4().hex[:6]}")
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        _sweep(goal)
        aside.mkdir()
    except OSError as error:
        raise _unwritable(target, error) from error
    with _claimed(aside):
        try:
            yield aside
            _seal(aside)
        except BaseException as error:
            shutil.rmtree(aside, ignore_errors=True)
            if full := _full(error):
                raise _unwritable(target, full) from error
            raise
        with deaf_to(*STOPS):
            _exchange(aside, goal, target)


@contextlib.contextmanager
def new_folder(target: str | Path) -> Iterator[Path]:
    """Give a folder to fill; when the block ends well it becomes `target`, in one step, and is the user's from then on.

    Raises
    ------
    InputError
        `target` is there already, or cannot be written, or its disk is full.

    """
    there = InputError(f"{shown(target)}: expected a folder that is not there yet, got one that is")
    if os.path.lexists(target):
        raise there
    check_output(target)
    goal = Path(target).resolve()
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(goal.parent) as scratch:
            aside = scratch / goal.name
            aside.mkdir()
            yield aside
            if os.path.lexists(goal):
                raise there
            aside.rename(goal)
    except (OSError, InputError) as error:
        full = _full(error)
        if full or isinstance(error, OSError):
            raise _unwritable(target, full or error) from error
        raise


def _full(error: BaseException) -> OSError | None:
    """The error of a full disk that is behind another, if one is."""
    cause = error.__cause__ if isinstance(error, InputError) else error
    return cause if isinstance(cause, OSError) and cause.errno in FULL else None


def check_output(target: str | Path, *others: str | Path | None) -> None:
    """Refuse an output folder before work is spent on it: see `staged_folder`. The other outputs must not be in it."""
    try:
        goal = Path(target).resolve()
        here = Path.cwd()
        status = goal.stat() if os.path.lexists(goal) else None
    except (OSError, RuntimeError, ValueError) as error:  # a name that is too long, a circle of links, no folder here
        raise _unwritable(target, error) from error
    if status and not stat.S_ISDIR(status.st_mode):
        raise InputError(f"{shown(target)}: is a file; give a folder for the output")
    if goal in (here, *here.parents):
        better = Path(target) / "out"
        raise InputError(f"{target}: an output folder is replaced as a whole: not the one you are in; try {better}")
    if status and goal.is_mount():
        raise InputError(f"{target}: a disk of its own cannot be replaced as a whole; try {Path(target) / 'out'}")
    for other in filter(None, others):
        if _resolved(Path(other)).is_relative_to(goal):
            raise InputError(f"{other}: is in {target}, which is replaced as a whole; give a file elsewhere")
    if status and (foreign := _foreign(goal)):
        raise InputError(f"{target}: {foreign}; give a new or empty folder")
    try:
        nearest = next(p for p in (goal, *goal.parents) if p.exists())
        if not nearest.is_dir():
            raise InputError(f"{shown(target)}: {nearest} is a file, not a folder")
        with scratch_folder(goal.parent if status else nearest) as folder:
            (folder / goal.name).mkdir()
    except OSError as error:
        raise _unwritable(target, error) from error


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a circle of links, a name that no file can have
        raise _unwritable_file(path, error) from error


def _unwritable(target: str | Path, error: Exception) -> InputError:
    cure = "make room on its disk, or choose" if getattr(error, "errno", None) in FULL else "choose"
    return InputError(
        f"{shown(target)}: the output folder cannot be written ({why(error, target)}); {cure} another with --out"
    )


def _foreign(folder: Path) -> str | None:
    """What in a folder is not as its manifest says that we wrote it, or None: then all of it may be replaced."""
    ours = _written(folder)
    folders = {parent for name in ours for parent in Path(name).parents}
    for place, inner, names in os.walk(folder):
        inner.sort()
        for name in sorted([*inner, *names]):
            path = Path(place, name)
            relative = path.relative_to(folder)
            if path.is_dir() and not path.is_symlink():
                known = relative in folders
            else:
                known = relative.as_posix() in ours
                if known and not _is(path, ours[relative.as_posix()]):
                    return f'"{relative.as_posix()}" in it has been changed since stiffscope wrote it'
            if not known:
                return f'holds "{relative.as_posix()}", which stiffscope did not write'
    return None


def _written(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that we wrote into a folder, by name; none where its manifest is not as we wrote it."""
    try:
        with open_file(folder / MANIFEST) as stream:
            content = stream.read()
        manifest = json.loads(content)
        seal = manifest.pop("seal")
        if manifest["made_by"] != MAKER or _seal_of(manifest) != seal or not all(map(_inside, manifest["sha256"])):
            return {}
        return {**manifest["sha256"], MANIFEST: hashlib.sha256(content).hexdigest()}
    except (InputError, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _inside(name: str) -> bool:
    """Whether a name of a manifest is that of a file in its folder."""
    return not Path(name).is_absolute() and ".." not in Path(name).parts


def _is(path: Path, checksum: str) -> bool:
    """Whether a file, no link, has this SHA-256."""
    try:
        return not path.is_symlink() and file_digest(path) == checksum
    except InputError:
        return False


def file_digest(path: Path, what: str = "a file", most: int = 1 << 40) -> str:
    """SHA-256 of a file's bytes. Raises InputError for what is no file, as `open_file` does."""
    with open_file(path, what, most) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()  # pyright: ignore[reportArgumentType]


def _seal_of(manifest: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()


def _seal(folder: Path) -> None:
    """Complete the manifest with the folder's files and their checksums, and with its own."""
    path = folder / MANIFEST
    manifest = json.loads(path.read_bytes()) if path.exists() else {}
    for place, _, _ in os.walk(folder, topdown=False):
        if Path(place) != folder and not any(Path(place).iterdir()):
            Path(place).rmdir()
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file() and p != path)
    sums = {name: file_digest(folder / name) for name in names}
    manifest = json.loads(to_json({"made_by": MAKER, **manifest, "files": names, "sha256": sums}))
    path.write_text(to_json({**manifest, "seal": _seal_of(manifest)}), encoding="utf-8")


def _exchange(aside: Path, goal: Path, target: str | Path) -> None:
    """Put the new folder in the old one's place: the only place where anything of the user's could be replaced.

    The old one is looked at once more when nobody finds it under its name any longer; what was saved in it meanwhile
    brings it back.
    """
    old = goal.with_name(aside.name.replace(".partial-", ".replaced-"))
    try:
        refusal = _foreign(goal) if goal.is_dir() else None
        if refusal is None:
            if os.path.lexists(goal):
                goal.rename(old)
            try:
                aside.rename(goal)
            except OSError:
                if old.exists():
                    old.rename(goal)
                raise
            refusal = _foreign(old) if old.exists() else None
            if refusal is not None:
                goal.rename(aside)
                old.rename(goal)
    except OSError as error:
        refusal = f"cannot be replaced ({why(error, goal)})"
    if refusal is not None:
        kept = _visible(aside, goal)
        raise InputError(f"{target}: {refusal}; it stays as it is, and the new results are in {kept}")
    _remove(old)


def _visible(aside: Path, goal: Path) -> Path:
    """Keep new results beside a folder that cannot be replaced; returns where."""
    for name in (f"{goal.name}.new", *(f"{goal.name}.new-{number}" for number in range(2, 1000))):
        with contextlib.suppress(OSError):
            if not os.path.lexists(goal.with_name(name)):
                return aside.rename(goal.with_name(name))
    return aside


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
    copies = {name: checksum for name, checksum in _written(output).items() if name.startswith(within)}
    _remove_all(folder, {name.removeprefix(within): checksum for name, checksum in copies.items()})
    return not folder.exists()


def _remove_all(folder: Path, ours: Mapping[str, str]) -> None:
    """Remove files that have these SHA-256, by name, and the folders that are empty then."""
    for name, checksum in ours.items():
        if name != MANIFEST and _is(folder / name, checksum):
            with contextlib.suppress(OSError):
                (folder / name).unlink()
    for place, _, _ in os.walk(folder, topdown=False):
        with contextlib.suppress(OSError):
            if Path(place) == folder and [each.name for each in folder.iterdir()] == [MANIFEST] and ours:
                (folder / MANIFEST).unlink()
            Path(place).rmdir()


def _remove(folder: Path) -> None:
    """Remove a former output: each file that is still as its manifest says, and the folders that are empty then."""
    if not folder.is_dir() or folder.is_symlink():
        return
    _remove_all(folder, _written(folder))
    if folder.exists():
        with contextlib.suppress(OSError):
            _visible(folder, folder.with_name(folder.name.lstrip(".") + ".kept"))


def _sweep(goal: Path) -> None:
    """Put right what killed runs left beside this output folder."""
    for left in list(goal.parent.iterdir()):
        if _abandoned(left, f".{goal.name}.replaced-"):
            if not os.path.lexists(goal):
                left.rename(goal)  # killed between the two renames: the former output is the complete one
            else:
                _remove(left)
        elif _abandoned(left, f".{goal.name}.partial-"):
            shutil.rmtree(left, ignore_errors=True)


def _abandoned(path: Path, prefix: str) -> bool:
    """Whether a temporary folder PREFIX<process>-<random> has no process any more: none of its number, no lock."""
    match = re.fullmatch(r"(\d+)-[0-9a-f]+", path.name.removeprefix(prefix)) if path.name.startswith(prefix) else None
    if match is None or path.is_symlink() or _alive(int(match[1])):
        return False
    handle = _lock(path)
    if handle is not None:
        os.close(handle)
    return handle is not None or fcntl is None


@contextlib.contextmanager
def _claimed(folder: Path) -> Iterator[None]:
    """Hold a lock on a folder of ours, which ends with this process, where the system has such locks."""
    handle = _lock(folder)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _lock(folder: Path) -> int | None:
    """Lock a folder; None where another process holds it, or nobody can."""
    if fcntl is None:
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
