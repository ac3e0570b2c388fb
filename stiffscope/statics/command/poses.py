"""Commands for a robot at poses: stiffness and deflection."""

from __future__ import annotations

import dataclasses
import logging
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from stiffscope.biglide.literal import literal_gravity, require_biglide
from stiffscope.cli import options
from stiffscope.cli.options import Texts, takes
from stiffscope.cli.output import emit, open_workshop, warn_of_robot
from stiffscope.cli.poses import find_poses
from stiffscope.errors import naming
from stiffscope.experiments.assembly import (
    assemble_robots,
    deflection_bars,
    name_robot,
    stiffness_bars,
    stiffness_json,
)
from stiffscope.experiments.manifest import manifest_of
from stiffscope.experiments.superelements import write_robot
from stiffscope.report import tables
from stiffscope.report.kept_pictures import draw_deflection
from stiffscope.report.robot_view import wrench_cases
from stiffscope.report.run_report import write_deflection_report
from stiffscope.robot.file import quantities as q
from stiffscope.robot.reader import load_robot
from stiffscope.statics.show.load_curve import draw_load_curve, show_load_curve
from stiffscope.vjm.model.screws import CONVENTION
from stiffscope.vjm.statics.analysis import analyse, sag
from stiffscope.vjm.statics.singularity import rigid_note, singular_note
from stiffscope.vjm.statics.slender import find_thrusts
from stiffscope.vjm.statics.yielding import deflection as deflect
from stiffscope.vjm.statics.yielding import find_load_curve

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stiffscope.cli.output import Output
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.report.run_report import Draft
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.statics.analysis import Stiffness

log = logging.getLogger(__name__)
_SLENDER = (
    0.01  # of its buckling load, axial force of a body under own weight that is said
)


@click.command()
@takes(
    *(
        options.robot,
        options.poses,
        options.joints,
        options.components,
        options.gravity(None),
    ),
    *(options.overrides, options.json),
)
@options.superelement("tool at each pose")
def stiffness(
    name: str,
    *,
    poses: Texts,
    joints: Texts,
    components: Any,
    gravity: str | None,
    overrides: Texts,
    superelement: Path | None,
    output: Output,
) -> None:
    """6x6 stiffness and sag of the robot at tool poses.

    Without --at and --joints, at the poses of the robot file.
    """
    robot = load_robot(name, overrides)
    asked = find_poses(robot, poses, joints)
    gravity = gravity or ("exact" if robot.carries("gravity") else "none")
    if gravity == "literal":
        require_biglide(asked.configurations.mechanism)
    output.check_folder(superelement)
    manifest = manifest_of(robot)
    # modes and fields take half of the time, and only a superelement has them
    assembled = assemble(robot, components, output, whole=superelement is not None)
    at = asked.configurations
    with name_robot(robot):
        state = analyse(
            assembled.mechanism, at, gravity="exact" if gravity == "exact" else "none"
        )
    if gravity == "literal":
        matrix = literal_gravity(assembled.mechanism, at.poses)
        sunk = sag(assembled.mechanism, at)
        state = dataclasses.replace(state, matrix=matrix, sag=sunk)
    bars = stiffness_bars(assembled, state.configurations)
    if superelement:
        write_robot(
            assembled, asked.names, asked.configurations, superelement, manifest
        )
    _warn_of_singular(asked.names, state)
    if gravity == "exact" and np.isfinite(state.sag).any():
        _warn_of_slender(assembled.mechanism, at)

    def show() -> None:
        title = f"Stiffness at M ({tables.sources(assembled)}; gravity {gravity})"
        tables.show_stiffness(asked.names, state, bars, title=title)
        if superelement:
            tables.show_line(f"Superelement written to {superelement}")

    emit(output, stiffness_json(state, bars), show)


def assemble(
    robot: RobotFile, components: Any, output: Output, *, whole: bool = True
) -> Assembled:
    """Assemble the robot with its parts; show progress and warnings on standard error.

    Without ``whole``, its parts have neither modes nor fields, in half the time.
    """
    with open_workshop(output) as shop:
        robots = assemble_robots({"now": robot}, components, shop, whole=whole)
        assembled = robots["now"]
    warn_of_robot(assembled)
    return assembled


@click.command()
@takes(
    options.robot,
    options.poses,
    options.joints,
    options.components,
    options.overrides,
    options.json,
)
@options.folder(
    "--out", "report and pictures of the robot deformed, complete or absent."
)
@click.option(
    "--wrench",
    required=True,
    metavar="FX,FY,FZ,MX,MY,MZ",
    help='Wrench on the tool at M, axes {O}, in N and N·m or with units ("100 N,0,0,0,0,5 N*m").',
)
@click.option(
    "--steps",
    type=click.IntRange(0, 1000),
    default=0,
    metavar="N",
    help="Also load, unload, load the other way and unload, each in N steps: force over deflection.",
)
def deflection(
    name: str,
    *,
    poses: Texts,
    joints: Texts,
    components: Any,
    overrides: Texts,
    wrench: str,
    steps: int,
    output: Output,
) -> None:
    """Deflection of the tool under a wrench, and each element's share of it.

    Without --at and --joints, at the poses of the robot file.
    """
    robot = load_robot(name, overrides)
    asked = find_poses(robot, poses, joints)
    form = 'FX,FY,FZ,MX,MY,MZ such as "100 N,0,0,0,0,5 N*m"'
    with naming(f"--wrench {wrench}", form):
        load = np.array(q.several(wrench, *[q.FORCE] * 3, *[q.MOMENT] * 3))
    manifest = manifest_of(robot)
    assembled = assemble(robot, components, output)
    at = asked.configurations
    deflected = deflect(assembled.mechanism, at, load)
    way = np.linspace(0.0, 1.0, steps + 1)
    path = np.concatenate([way, way[-2::-1], -way[1:], -way[-2::-1]])
    curve = find_load_curve(assembled.mechanism, at, load, path) if steps else None
    words = ",".join(f"{value:g}" for value in load)

    def show() -> None:
        error = deflection_bars(assembled, at, deflected.twist)
        tables.show_deflection(
            asked.names, deflected.twist, deflected.shares, words, error
        )
        if curve is not None:
            show_load_curve(asked.names, curve)

    def page(report: Draft) -> None:
        folder = report.folder
        cases = wrench_cases(assembled.mechanism, at, {f"{words} N, N·m": load})
        draw_deflection(assembled, asked.names, at, cases, folder)
        if curve is not None:
            way = np.r_[
                1e-9, np.linspace(0.005, 1.0, 200)
            ]  # near zero load, where backlash acts
            fine = find_load_curve(
                assembled.mechanism, at, load, np.r_[-way[::-1], way]
            )
            draw_load_curve(asked.names, fine, folder)
        write_deflection_report(report, assembled, asked.names, at, cases)

    answer = {
        "poses": at.poses,
        "tool": at.tool,
        "wrench": load,
        "twist": deflected.twist,
        "energy": deflected.energy,
        "shares": deflected.shares,
        "convention": CONVENTION,
    }
    if curve is not None:
        twist = np.moveaxis(curve.twist, 2, 1)
        matrix = np.moveaxis(curve.stiffness, 3, 1)
        answer["path"] = {"load": curve.load, "twist": twist, "stiffness": matrix}
    emit(output, answer, show, manifest=manifest, page=page)


def _warn_of_slender(mechanism: Mechanism, at: Configurations) -> None:
    """Warn of axial forces that bend slender bodies, which exact gravity leaves out."""
    for name, (force, share) in find_thrusts(mechanism, at).items():
        if share > _SLENDER:
            pulled = force > 0.0
            carried = f"{name} carries {abs(force):.3g} N of {'tension' if pulled else 'compression'}"
            what = (
                "that it buckles"
                if share >= 1.0 and not pulled
                else f"that this {'straightens' if pulled else 'bends'} it"
            )
            log.warning(
                "%s, %.0f %% of its buckling load: %s is left out",
                carried,
                100.0 * share,
                what,
            )


def _warn_of_singular(names: Sequence[str], state: Stiffness) -> None:
    for pose, matrix, soft, rigid, sunk in zip(
        names, state.matrix, state.compliance, state.rigid, state.sag, strict=True
    ):
        note = rigid_note(rigid) or singular_note(matrix, soft)
        if note:
            log.warning("%s: %s", pose, note)
        elif any(value != value for value in sunk):  # noqa: PLR0124 (NaN)
            why = "its weight moves the tool too far for a linear answer"
            log.warning("%s: %s; the stiffness is without it", pose, why)
