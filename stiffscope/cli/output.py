"""Output of commands: JSON, an output folder with report, tables, and progress."""

from __future__ import annotations

import logging
import os
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.errors import InputError, require
from stiffscope.registry import registered
from stiffscope.report.progress import progress
from stiffscope.report.terminal import record_shown, show_line
from stiffscope.robot.inspection import doubt_parts
from stiffscope.runtime.cache import cache_folder
from stiffscope.runtime.output import check_output, staged_folder, write_json
from stiffscope.runtime.reading import opened, show_path
from stiffscope.runtime.workshop import workshop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.report.run_report import Draft
    from stiffscope.runtime.workshop import Workshop

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Output:
    """Values of `--json`, `--out` and `--quiet`."""

    json: str | None = None
    folder: Path | None = None
    quiet: bool = False

    @property
    def loud(self) -> bool:
        """Whether tables go to standard output."""
        return not self.quiet and self.json != "-"

    def required_folder(self) -> Path:
        """Return the folder. Raise InputError if it is missing."""
        if self.folder is None:
            raise InputError("--out: expected a folder to write, got none")
        return self.folder

    def check_json(self) -> None:
        """Raise InputError if the JSON would replace a file that the command has read, or writes too."""
        require(
            self.json in (None, "-") or os.path.realpath(self.json) not in opened,
            show_path(self.json or ""),
            "a file for the JSON alone",
            "one that the command also reads or writes",
        )

    def check_folder(self, folder: Path | None, *others: Path | None) -> None:
        """Raise InputError if a folder cannot be written or would contain another output."""
        if folder is not None:
            if os.path.realpath(folder) == os.path.realpath(cache_folder()):
                raise InputError(
                    f"{folder}: is the folder of the cache; give another one for the output"
                )
            check_output(folder, None if self.json == "-" else self.json, *others)


def _nothing(*_: object) -> None:
    return


def emit(
    output: Output,
    answer: Any,
    show: Callable[[], None] = _nothing,
    *,
    manifest: Manifest | None = None,
    fill: Callable[[Path], object] = _nothing,
    page: Callable[[Draft], None] = _nothing,
    kept: str = "",
    also: Callable[[], None] = _nothing,
    following: str = "",
) -> None:
    """Write the results of a command: output folder, JSON, further files, then tables.

    The folder is written completely or not at all.

    Parameters
    ----------
    output
        Destinations.
    answer
        Content of `--json`, or a function that computes it if that takes time.
    show
        Prints the tables.
    manifest
        Provenance; written after the files and before the page, which shows it.
    fill
        Writes numbers and pictures into the folder.
    page
        Writes ``report.html`` from the folder's content and the tables of `show`.
    kept
        Name of a JSON file of the folder with the answer, if any.
    also
        Writes further files of the command after folder and JSON were written.
    following
        Commands that a user may want next, shown last.
    """
    output.check_json()
    if callable(answer) and (output.json or kept):
        answer = answer()
    if output.folder is not None and manifest is not None:
        from stiffscope.report.run_report import Draft

        with staged_folder(output.folder) as folder:
            if kept:
                write_json(folder / kept, answer)
            fill(folder)
            manifest.write(folder)
            with record_shown() as shown:
                show()
            page(Draft(folder, shown))
    if output.json:
        write_json(output.json, answer)
    also()  # before the tables, whose pipe may be closed early
    if output.loud:
        show()
        if output.folder is not None and manifest is not None:
            show_line(
                f"Written to {output.folder} in {manifest.measure_elapsed():.1f} s"
            )
        if following:
            show_line(f"Next: {following}")


@contextmanager
def open_workshop(output: Output) -> Iterator[Workshop]:
    """Open a workshop with parallel jobs and progress on standard error, before a command's work."""
    output.check_json()
    with (
        progress(quiet=output.quiet) as open_line,
        workshop(open_line, together=True) as shop,
    ):
        yield shop


def warn_of_parts(results: Iterable[PartResult]) -> None:
    """Log the error reached for each part whose tolerance was not met."""
    for result in results:
        if result.note:
            log.warning("%s: %s", result.name, result.note)


def warn_of_robot(assembled: Assembled, *, parts: bool = True) -> None:
    """Log unmet tolerances, doubtful parts, and each `--set` without effect on a published matrix."""
    if parts:
        warn_of_parts(assembled.results.values())
    for remark in doubt_parts(assembled.robot):
        log.warning("%s: %s", assembled.robot.path, remark)
    for doubt in (d for find in registered("doubts") for d in find(assembled.robot)):
        if doubt.warning:
            log.warning("%s is %s", ", ".join(doubt.solids), doubt.text)
    for (room, name, *field), text in assembled.robot.source.changed.items():
        printed = room == "parts" and getattr(
            assembled.robot.parts.get(str(name)), "published", None
        )
        if (
            printed
            and assembled.sources.get(str(name)) == "published"
            and field != ["compliance"]
        ):
            message = (
                "%s: changes nothing of the compliance of %s, which is as published"
            )
            log.warning(message, text, name)
