"""Journal of a study: one line per finished design, appended immediately.

A kill leaves at most an incomplete last line, whose design is computed again. The name is a digest
of everything designs depend on, so that other methods, ranges or more designs can reuse them.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

from stiffscope.experiments.orders import LIBRARIES
from stiffscope.robot.file.part_sections import StepPart
from stiffscope.runtime.cache import code_version, digest
from stiffscope.runtime.reading import file_digest, open_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from stiffscope.design.study_file import StudyFile, Values

CODE = ("stiffscope.cad", "stiffscope.fea", "stiffscope.robot", "stiffscope.vjm")
SUFFIX = ".jsonl"
MOST_BYTES = 1 << 34  # of a journal: enough for a million designs with reasons


@dataclass(frozen=True)
class Design:
    """A finished design: variables and responses, SI, in the study's order; reason of a failure.

    ``again``: whether the same study should retry it, because the design did not cause the failure.
    """

    values: Values
    responses: tuple[float, ...]
    reason: str = ""
    seconds: float = 0.0
    again: bool = False


class Journal:
    """Finished designs of a study in a folder: existing ones and those added."""

    def __init__(self, file: StudyFile, folder: Path) -> None:
        self.path = folder / f"{identify(file)[:32]}{SUFFIX}"
        self._file = file
        self._stream: BinaryIO | None = None

    def __enter__(self) -> Journal:
        """Start; the file is opened with the first write."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def read(self) -> Iterator[Design]:
        """Read the designs; skip invalid lines."""
        if not self.path.is_file():
            return
        variables, responses = len(self._file.variables), len(self._file.responses)
        with open_file(self.path, "designs of a study", MOST_BYTES) as stream:
            for line in stream:
                try:
                    values, found, reason, seconds = json.loads(line)
                    if len(values) == variables and len(found) == responses:
                        numbers = tuple(math.nan if each is None else float(each) for each in found)
                        yield Design(tuple(values), numbers, str(reason), float(seconds))
                except (ValueError, TypeError):
                    continue

    def count(self) -> int:
        """Count the written designs without parsing them."""
        if not self.path.is_file():
            return 0
        with self.path.open("rb") as stream:
            return max(0, sum(block.count(b"\n") for block in iter(lambda: stream.read(1 << 20), b"")) - 1)

    def add(self, design: Design) -> None:
        """Append a design with a single write."""
        numbers = [None if math.isnan(each) else each for each in design.responses]
        self._write([design.values, numbers, design.reason, round(design.seconds, 6)])

    def _write(self, content: Any) -> None:
        if self._stream is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self.path.open("ab", buffering=0)
            if not self._stream.tell():
                columns = [each.column for each in (*self._file.variables, *self._file.responses)]
                self._write({"study": str(self._file.path.resolve()), "columns": columns})
            elif not _ends_whole(self.path):
                self._stream.write(b"\n")
        self._stream.write(json.dumps(content, ensure_ascii=False).encode() + b"\n")


def _ends_whole(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, 2)
        return stream.read() == b"\n"


def name_study(journal: Path) -> str:
    """Return the file of a journal's study; "" if unknown."""
    with open_file(journal, "designs of a study", MOST_BYTES) as stream:
        try:
            return str(json.loads(stream.readline())["study"])
        except (ValueError, TypeError, KeyError):
            return ""


def identify(file: StudyFile) -> str:
    """Return a digest of all that designs depend on except values: robot, responses and code."""
    source = file.robot.source
    responses = [
        {
            "of": r.expression.text,
            "unit": r.unit,
            "name": r.name,
            "take": r.take,
            "poses": [file.poses[k] for k in r.poses] if r.job is None else len(r.poses),
            "job": r.job and [r.job.section.model_dump_json(), file_digest(r.job.path_file)],
        }
        for r in file.responses
    ]
    solids = {
        name: file_digest(source.path.parent / part.file)
        for name, part in file.robot.parts.items()
        if isinstance(part, StepPart)
    }
    return digest(
        {
            "robot": source.text, "set": source.overrides, "solids": solids,
            "components": file.components, "tolerance": file.tolerance,
            "variables": [v.name for v in file.variables], "responses": responses,
            "code": code_version(CODE, LIBRARIES),
        }
    )  # fmt: skip
