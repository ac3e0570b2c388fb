"""Writing: a file appears whole or not at all, an output folder is complete or absent."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import sys
import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

MANIFEST = "manifest.json"
MAKER = "stiffscope"


def write_bytes(path: Path, content: bytes) -> None:
    """Write one file in one step: whoever looks sees the old content or the new. A link is followed, a device kept."""
    check_file(path)
    goal = path.resolve()
    aside = goal.with_name(f".{goal.name}.{uuid.uuid4().hex[:8]}")
    try:
        if _is_stream(path):
            path.write_bytes(content)
        else:
            aside.write_bytes(content)
            aside.replace(goal)
    except OSError as error:
        raise _unwritable_file(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            aside.unlink()


def check_file(path: Path) -> None:
    """Refuse a file before work is spent on it: see `write_bytes`."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; give a file")
        if not _is_stream(path):
            Path(tempfile.mkdtemp(prefix=".stiffscope-", dir=path.resolve().parent)).rmdir()
    except OSError as error:
        raise _unwritable_file(path, error) from error


def _is_stream(path: Path) -> bool:
    """Whether it is there and is a device or a pipe, which is written to, not replaced."""
    return path.exists() and not path.is_file()


def _unwritable_file(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be written ({error.strerror}); give a file in a folder of yours")


def write_json(target: str | Path, value: Any) -> None:
    """Write JSON to a file, or to standard output where the target is "-"."""
    text = to_json(value)
    if str(target) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_bytes(Path(target), text.encode())


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
        items = [f"{inner}{json.dumps(key)}: {_rows(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, list | dict) for item in value):
        return "[\n" + ",\n".join(inner + _rows(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


@contextlib.contextmanager
def staged_folder(target: str | Path) -> Iterator[Path]:
    """Give a folder to fill; when the block ends well it becomes `target` in one step.

    A former output of ours is replaced as a whole. When the block fails, `target` stays as it was.

    Raises
    ------
    InputError
        `target` is a file, cannot be written, or is a folder with content that this program did not write.

    """
    check_output(target)
    goal = Path(target).resolve()
    aside = goal.with_name(f".{goal.name}.partial-{os.getpid()}-{uuid.uuid4().hex[:6]}")
    try:
        goal.parent.mkdir(parents=True, exist_ok=True)
        _sweep(goal)
        aside.mkdir()
    except OSError as error:
        raise _unwritable(target, error.strerror) from error
    try:
        yield aside
        _seal(aside)
        _swap(aside, goal)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def check_output(target: str | Path, *others: str | Path | None) -> None:
    """Refuse an output folder before work is spent on it: see `staged_folder`. The other outputs must not be in it."""
    goal = Path(target).resolve()
    try:
        there = goal.exists()
    except OSError as error:  # a name that is too long
        raise _unwritable(target, error.strerror) from error
    if there and not goal.is_dir():
        raise InputError(f"{target}: is a file; give a folder for the output")
    if goal in (Path.cwd(), *Path.cwd().parents):
        better = Path(target) / "out"
        raise InputError(f"{target}: an output folder is replaced as a whole: not the one you are in; try {better}")
    for other in filter(None, others):
        if Path(other).resolve().is_relative_to(goal):
            raise InputError(f"{other}: is in {target}, which is replaced as a whole; give a file elsewhere")
    if goal.is_dir():
        foreign = _foreign(goal)
        if foreign:
            raise InputError(f'{target}: holds "{foreign}", which stiffscope did not write; give a new or empty folder')
    nearest = next(p for p in (goal, *goal.parents) if p.exists())
    if not nearest.is_dir():
        raise InputError(f"{target}: {nearest} is a file, not a folder")
    holder = goal.parent if there else nearest
    try:
        Path(tempfile.mkdtemp(prefix=".stiffscope-", dir=holder)).rmdir()
    except OSError as error:
        raise _unwritable(target, f"{error.strerror} in {holder}") from error


def _unwritable(target: str | Path, why: object) -> InputError:
    return InputError(f"{target}: the output folder cannot be written ({why}); choose another with --out")


def _foreign(folder: Path) -> str | None:
    """Name of a file that no manifest of ours lists, or None."""
    present = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir() or p.is_symlink())
    try:
        manifest = json.loads((folder / MANIFEST).read_bytes())
        ours = {*manifest["files"], MANIFEST} if manifest["made_by"] == MAKER else set()
    except (OSError, ValueError, KeyError, TypeError):
        ours = set()
    return next((name for name in present if name not in ours), None)


def _seal(folder: Path) -> None:
    """Complete the manifest with the list of the folder's files."""
    path = folder / MANIFEST
    manifest = json.loads(path.read_bytes()) if path.exists() else {}
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    manifest = {"made_by": MAKER, **manifest, "files": [name for name in names if name != MANIFEST]}
    path.write_text(to_json(manifest), encoding="utf-8")


def _swap(aside: Path, goal: Path) -> None:
    """Put the new folder in the old one's place."""
    old = goal.with_name(aside.name.replace(".partial-", ".replaced-"))
    try:
        if goal.exists():
            goal.rename(old)
        aside.rename(goal)
    except OSError as error:
        if old.exists() and not goal.exists():
            old.rename(goal)
        raise _unwritable(goal, error.strerror) from error
    shutil.rmtree(old, ignore_errors=True)


def _sweep(goal: Path) -> None:
    """Remove what killed runs left beside this output folder."""
    for kind in ("partial", "replaced"):
        prefix = f".{goal.name}.{kind}-"
        for left in goal.parent.iterdir():
            if left.name.startswith(prefix) and not _alive(left.name.removeprefix(prefix).split("-")[0]):
                if kind == "replaced" and not goal.exists():
                    left.rename(goal)  # killed between the two renames: the former output is the complete one
                else:
                    shutil.rmtree(left, ignore_errors=True)


def _alive(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except (ProcessLookupError, ValueError, OverflowError):
        return False
    except OSError:
        return True
    return True
