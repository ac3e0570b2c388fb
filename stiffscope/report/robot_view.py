"""Viewer data besides the solids: positions of nodes at each pose, and motions by load or mode."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import InputError
from stiffscope.report.numbers import base64_of
from stiffscope.report.robot_scene import place_robot, pose_text
from stiffscope.vjm.statics.yielding import respond

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stiffscope.vjm.kinematics.configurations import Configurations
    from stiffscope.vjm.model.mechanism import Mechanism
    from stiffscope.vjm.network.loading import Response
    from stiffscope.vjm.vibration.modes import Modes

UNSEEN = 1e-4  # rad/m or m/rad; a smaller rotation or displacement counts as zero
LOADS = ("fx = 1 N", "fy = 1 N", "fz = 1 N", "mx = 1 N·m", "my = 1 N·m", "mz = 1 N·m")


@dataclass(frozen=True)
class Case:
    """A load or mode at a pose: node twists (6,) at M in base axes, and shares of elements.

    Without shares, there are no colours. A load at M (N and N·m, base axes) is drawn as an arrow.
    """

    label: str
    note: str
    twists: Mapping[str, np.ndarray]
    shares: Mapping[str, float]
    load: Sequence[float] | None = None


def robot_view(
    geometry: Mapping[str, Any],
    configurations: Configurations,
    names: Sequence[str],
    cases: Sequence[Sequence[Case]],
    *,
    choice: str = "load",
    quantity: str = "share of the strain energy",
) -> dict[str, Any]:
    """Return the data of a page's viewer, JSON-compatible.

    Parameters
    ----------
    geometry
        Solids from `stiffscope.report.drawing.geometry.pack_solids`.
    configurations, names
        Configurations at n poses, and the names of the poses.
    cases
        Selectable cases at each pose.
    choice, quantity
        Kind of case ("load", or "mode", which the viewer animates), and the quantity of the shares.
    """
    mechanism = configurations.mechanism
    nodes = [node for body in mechanism.bodies for node in body.nodes]
    flat = [case for load in cases for case in load]
    elements = sorted({element for case in flat for element in case.shares})
    poses: list[dict[str, Any]] = []
    placed = np.zeros((len(names), len(nodes), 12))
    for k, (name, each) in enumerate(zip(names, cases, strict=True)):
        here = place_robot(configurations, k)
        placed[k] = [np.append(*here.moves[node]) for node in nodes]
        listed = [
            {
                "label": c.label,
                "note": c.note,
                "factor": here.exaggeration(c.twists),
                "coloured": bool(c.shares),
                "load": c.load,
            }
            for c in each
        ]
        place = pose_text(mechanism, configurations.poses[k])
        at = np.round(here.at, 7).tolist()
        poses.append({"name": name, "place": place, "at": at, "cases": listed})
    twists = [[case.twists.get(node, np.zeros(6)) for node in nodes] for case in flat]
    shares = [[case.shares.get(element, 0.0) for element in elements] for case in flat]
    return {
        **geometry,
        "nodes": nodes,
        "elements": elements,
        "poses": poses,
        "choice": choice,
        "quantity": quantity,
        "moving": choice == "mode",
        "moves": base64_of(placed),
        "twists": base64_of(twists),
        "shares": base64_of(shares),
    }


def unit_wrenches(
    mechanism: Mechanism, configurations: Configurations
) -> list[list[Case]]:
    """Return the cases of unit wrenches at M, except those under which the tool moves freely."""
    units: dict[str, np.ndarray] = dict(zip(LOADS, np.eye(6), strict=True))
    try:
        return wrench_cases(mechanism, configurations, units)
    except InputError:
        cases: list[list[Case]] = [[] for _ in range(len(configurations))]
        for k, each in enumerate(cases):
            for label, load in units.items():
                with contextlib.suppress(InputError):
                    each.extend(
                        wrench_cases(
                            mechanism, configurations[np.array([k])], {label: load}
                        )[0]
                    )
        return cases


def wrench_cases(
    mechanism: Mechanism,
    configurations: Configurations,
    loads: Mapping[str, np.ndarray],
) -> list[list[Case]]:
    """Return the cases of wrenches at M. Raise InputError if the tool moves freely under one.

    Parameters
    ----------
    mechanism, configurations
        Robot, and its configurations at the poses.
    loads
        Wrenches (6,) at M, N and N·m, by label on the page.
    """
    return read_cases(
        respond(mechanism, configurations, np.column_stack(list(loads.values()))), loads
    )


def read_cases(done: Response, loads: Mapping[str, np.ndarray]) -> list[list[Case]]:
    """Return the cases of a response to wrenches (6,) at M, including all other loads in it."""
    n = len(done.twist)
    m = len(loads)
    energies = {
        name: np.broadcast_to(each, (n, m)) for name, each in done.energies.items()
    }
    moved = {
        node: np.broadcast_to(twist, (n, 6, m)) for node, twist in done.nodes.items()
    }
    cases: list[list[Case]] = []
    for k in range(n):
        cases.append([])
        for column, label in enumerate(loads):
            tool = done.twist[k, :, column]
            energy = {name: float(e[k, column]) for name, e in energies.items()}
            total = sum(energy.values())
            sizes = np.array([np.linalg.norm(tool[:3]), np.linalg.norm(tool[3:])])
            sizes[sizes < UNSEEN * sizes.max()] = (
                0.0  # rounding, and asymmetry of the mesh
            )
            note = (
                f"tool moves {1e6 * sizes[0]:.4g} µm, turns {1e6 * sizes[1]:.4g} µrad"
            )
            twists = {node: twist[k, :, column] for node, twist in moved.items()}
            shares = (
                {name: e / total for name, e in energy.items()} if total > 0.0 else {}
            )
            cases[-1].append(Case(label, note, twists, shares, loads[label].tolist()))
    return cases


def mode_cases(vibration_modes: Modes) -> list[list[Case]]:
    """Return the modes at each pose as cases."""
    cases: list[list[Case]] = []
    for k in range(len(vibration_modes.configurations)):
        cases.append([])
        for i, hertz in enumerate(vibration_modes.frequencies[k]):
            if np.isfinite(hertz):
                bound = (
                    f" Hz, mesh error ± {vibration_modes.error[k, i]:.2g}"
                    if vibration_modes.error[k, i]
                    else ""
                )
                note = f"{hertz:.5g}{bound} Hz" if hertz else "moves freely"
                twists = {
                    node: shape[k, :, i]
                    for node, shape in vibration_modes.shapes.items()
                }
                energies = vibration_modes.energy.items() if hertz else ()
                shares = {name: float(share[k, i]) for name, share in energies}
                cases[-1].append(Case(f"{i + 1}: {hertz:.4g} Hz", note, twists, shares))
    return cases
