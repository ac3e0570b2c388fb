"""`stiffscope run`: from CAD to pictures, once or whenever a file of the robot is saved."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import Output, emit, open_workshop, warn_of_robot
from stiffscope.errors import InputError, StiffscopeError
from stiffscope.experiments.assembly import (
    assemble_robots,
    at_named_poses,
    check_reach,
    compliance_bars,
    stiffness_bars,
    stiffness_json,
)
from stiffscope.experiments.experiments import compliance_json
from stiffscope.experiments.making import EXPERIMENT, FIELDS
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.watching import (
    changes,
    differences,
    digest_sources,
    keep_meshed,
    keep_warm,
    sources,
)
from stiffscope.report import part_tables, tables
from stiffscope.report.kept_pictures import order_run, plain_robot, write_pictures
from stiffscope.report.run_report import write_run_report
from stiffscope.report.terminal import record_shown
from stiffscope.robot.library import find_robot
from stiffscope.robot.parameters import parameters
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import write_json
from stiffscope.runtime.workshop import workshop
from stiffscope.statics.comparison import mass_of
from stiffscope.vjm.statics.yielding import deflection as deflect

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from concurrent.futures import Future
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.experiments.manifest import Manifest
    from stiffscope.report.run_report import Draft
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.runtime.workshop import Workshop
    from stiffscope.vjm.statics.analysis import Stiffness


@dataclass(frozen=True)
class _Step:
    """A watched robot, its stiffness with 95 % bounds if known, and the checksums of its files."""

    robot: Assembled
    state: Stiffness
    bars: np.ndarray | None
    files: dict[str, str]


@click.command()
@takes(
    options.robot,
    options.out,
    options.components,
    options.tolerance,
    options.overrides,
    options.json,
)
@click.option(
    "--watch", is_flag=True, help="Recompute what a saved file changes, until Ctrl-C."
)
def run(
    name: str,
    *,
    components: Any,
    tolerance: str | None,
    overrides: Texts,
    watch: bool,
    output: Output,
) -> None:
    """From CAD to report: parts, robot, tables, pictures.

    Builds the parts in CAD, meshes them, runs their virtual experiments, assembles the robot, and
    writes report.html, pictures, fields, matrices and a manifest to DIR. What was computed before
    is reused.

    With --watch, the stiffness before and after is shown whenever the robot file or a file that it
    names is saved, and report.html, open in a browser, shows the new robot, matrices and pictures
    as soon as they are drawn.
    """
    if watch and output.json:
        raise InputError(
            "--json: --watch writes no JSON but DIR/stiffness.json; leave out either"
        )
    if watch:
        _watch(name, components, tolerance, overrides, output)
        return
    robot = _load_checked(name, overrides, tolerance)
    robots = {"now": robot} | (
        {"before": load_robot(name, (), tolerance)} if overrides else {}
    )
    manifest = manifest_of(robot)
    with open_workshop(output) as shop:
        solved = assemble_robots(robots, components, shop)
        manifest.seconds["parts"] = manifest.measure_elapsed()
        report = shop.open_line("robot")
        report("assembling", 0.2)
        states = {
            label: at_named_poses(each, robot.poses) for label, each in solved.items()
        }
        report("pictures", 0.5)
        now = solved["now"]
        fill, page = _folder_of(now, states, shop, manifest)

        def show() -> None:
            _show_parts(now)
            _show_robot(now, states)
            if "before" in solved:
                tables.show_masses(*map(mass_of, (solved["before"], now)))

        tested = {
            part: compliance_json(robot, result) for part, result in now.results.items()
        }
        answer = {"parts": tested, **_stiffness(now, states["now"])}
        emit(
            output,
            answer,
            show,
            manifest=manifest,
            fill=fill,
            page=page,
            following=_suggest(name, now),
        )
        report("done", 1.0)
    warn_of_robot(now, parts=not output.loud)


def _suggest(name: str, now: Assembled) -> str:
    """Return what to ask next: the effect of a change, what changes most, and a page with sliders."""
    known = parameters(now.robot)
    lengths = [
        part.name for part in known if part.key[0] == "parts" and part.unit == "m"
    ]
    keys = lengths or [part.name for part in known]
    change = "".join(f"run {name} --set {key}=..., " for key in keys[:1])
    return f"stiffscope {change}sensitivity {name}, or live {name}"


def _load_checked(
    name: str, overrides: Sequence[str], tolerance: str | None
) -> RobotFile:
    """Load a robot with reachable poses. Raise InputError otherwise."""
    robot = load_robot(name, overrides, tolerance)
    check_reach(robot, robot.poses)
    return robot


def _watch(
    name: str,
    components: Any,
    tolerance: str | None,
    overrides: Sequence[str],
    output: Output,
) -> None:
    """Run after every change of a file, in this process with a warm CAD kernel; then the page."""
    out = output.required_folder()
    watched = [find_robot(name)]
    before: _Step | None = None
    meshed: dict[str, PartResult] = {}
    page: Future[None] | None = None
    with (
        workshop() as shop,
        workshop(together=True) as behind,
        ThreadPoolExecutor(1) as pool,
        _end_experiments(behind),
    ):
        for _ in changes(watched):
            try:
                robot = _load_checked(name, overrides, tolerance)
                watched[:] = sources(robot)
                manifest = manifest_of(robot)
                assembled = assemble_robots(
                    {"now": robot}, components, shop, whole=False, near=meshed
                )
                now = assembled["now"]
                state = at_named_poses(now, robot.poses)
                step = _Step(
                    now,
                    state,
                    stiffness_bars(now, state.configurations),
                    digest_sources(robot),
                )
            except InputError as error:
                click.echo(f"stiffscope: {error}", err=True)
                continue
            if output.loud:
                _show_step(step, before)
                follows = f"{out / 'report.html'} follows; Ctrl-C ends"
                tables.show_line(f"{manifest.measure_elapsed():.2f} s; {follows}")
            if page is not None:
                page.cancel()
            page = pool.submit(_write_behind, robot, components, out, manifest, behind)
            before = step
            keep_meshed(meshed, now.results)
            keep_warm()
        if page is not None:
            page.result()


@contextmanager
def _end_experiments(behind: Workshop) -> Iterator[None]:
    """On Ctrl-C, end the experiments of a pending page; running drawings are finished."""
    try:
        yield
    except KeyboardInterrupt:
        behind.executor.end()


def _write_behind(
    robot: RobotFile, components: Any, out: Path, manifest: Manifest, shop: Workshop
) -> None:
    """Write a run's folder in the background; report errors without ending the watch."""
    try:
        now = assemble_robots({"now": robot}, components, shop)["now"]
        states = {"now": at_named_poses(now, robot.poses)}
        fill, page = _folder_of(
            now, states, shop, manifest, watched=manifest.started.isoformat()
        )
        emit(
            Output(folder=out, quiet=True),
            None,
            manifest=manifest,
            fill=fill,
            page=page,
        )
    except (StiffscopeError, OSError, RuntimeError) as error:
        if not shop.executor.ended:
            click.echo(f"stiffscope: {error}", err=True)


def _show_step(step: _Step, before: _Step | None) -> None:
    """Show the stiffness, compared with the previous one if it has the same poses."""
    names = list(step.robot.robot.poses)
    if before is None or list(before.robot.robot.poses) != names:
        title = f"Stiffness at M ({tables.sources(step.robot)})"
        tables.show_stiffness(names, step.state, step.bars, title=title)
        return
    changed = differences(
        before.robot.robot, step.robot.robot, before.files, step.files
    )
    bars = before.bars, step.bars
    tables.show_change(
        names, before.state.matrix, step.state.matrix, changed or ["no value"], bars
    )
    tables.show_masses(*map(mass_of, (before.robot, step.robot)))


def _folder_of(
    now: Assembled,
    states: Mapping[str, Stiffness],
    shop: Workshop,
    manifest: Manifest,
    *,
    watched: str = "",
) -> tuple[Callable[[Path], None], Callable[[Draft], None]]:
    """Return functions that fill a run's folder and write its page; ``watched`` pages reload."""

    def fill(folder: Path) -> None:
        for name, result in now.results.items():
            place = folder / name
            place.mkdir()
            write_json(place / "compliance.json", compliance_json(now.robot, result))
            for file in (EXPERIMENT, FIELDS, f"{name}.step", f"{name}.stl"):
                shutil.copyfile(result.folder / file, place / file)
            times = result.seconds
            stages = result.experiment.seconds
            manifest.note(
                name, key=result.key, reused=result.reused, seconds=times, stages=stages
            )
        state = states["now"]
        write_json(folder / "stiffness.json", _stiffness(now, state))
        arrays: dict[str, Any] = {
            f"{n}_compliance": p.compliance for n, p in now.matrices.items()
        }
        arrays |= {"poses": state.poses, "tool": state.tool}
        arrays |= {"stiffness": state.matrix, "sag": state.sag}
        np.savez_compressed(folder / "matrices.npz", **arrays)
        write_json(folder / "robot.json", plain_robot(now.robot))
        orders = order_run(now, folder)
        write_pictures(orders, shop.cache, shop.executor, manifest)
        manifest.seconds["robot"] = manifest.measure_elapsed() - manifest.seconds.get(
            "parts", 0.0
        )

    def page(report: Draft) -> None:
        with record_shown() as parts:
            _show_parts(now)
        with record_shown() as shown:
            _show_robot(now, states)
        with record_shown() as full:
            bars = (
                bound(now, states["now"].configurations)
                for bound in (stiffness_bars, compliance_bars)
            )
            tables.show_full_matrices(list(now.robot.poses), states["now"], *bars)
        shown += [replace(matrix, folded=True) for matrix in full]
        write_run_report(replace(report, shown=shown), now, parts, watched=watched)

    return fill, page


def _stiffness(assembled: Assembled, state: Stiffness) -> dict[str, Any]:
    """Return the stiffness at the named poses for JSON output."""
    names = {"names": list(assembled.robot.poses), "components": assembled.sources}
    return {
        **stiffness_json(state, stiffness_bars(assembled, state.configurations)),
        **names,
    }


def _show_parts(now: Assembled) -> None:
    """Show the tables of the parts."""
    if now.results:
        part_tables.show_parts(list(now.results.values()))
    for name, result in now.results.items():
        if now.sources[name] == "fea":
            part_tables.show_compliance(now.robot, result)


def _find_yielding(now: Assembled, state: Stiffness) -> dict[str, Any]:
    """Return each component's share (n,) of what pushes along x, y and z together move the tool.

    None where the tool is free, so that no push finds an equilibrium.
    """
    yielded = dict[str, Any]()
    try:
        for push in np.eye(6)[:3]:
            deflected = deflect(now.mechanism, state.configurations, push)
            for name, share in deflected.shares.items():
                yielded[name] = yielded.get(name, 0.0) + share * deflected.energy
    except InputError:
        return {}
    whole = sum(yielded.values(), np.zeros(len(state.configurations)))
    if not (np.isfinite(whole) & (whole > 0.0)).all():
        return {}
    return {name: each / whole for name, each in yielded.items()}


def _show_robot(now: Assembled, states: Mapping[str, Stiffness]) -> None:
    """Show the tables of the robot."""
    names = list(now.robot.poses)
    state = states["now"]
    bars = stiffness_bars(now, state.configurations)
    tables.show_stiffness(
        names, state, bars, title=f"Stiffness at M ({tables.sources(now)})"
    )
    shares = _find_yielding(now, state)
    if shares:
        tables.show_yielding(names, shares)
    if "before" in states:
        tables.show_change(
            names, states["before"].matrix, state.matrix, now.robot.source.overrides
        )
