"""Pictures of a diagnosis, kept in the cache."""

from __future__ import annotations

import hashlib
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from stiffscope.gap.inference.diagnosis import to_json
from stiffscope.gap.show.figures import draw_figures
from stiffscope.gap.show.text import shares
from stiffscope.report.kept_pictures import Order, digest_solids, robot_facts
from stiffscope.report.pictures import (
    draw,
    open_drawing,
)
from stiffscope.report.robot_scene import (
    place_robot,
    pose_text,
    scene_of,
)
from stiffscope.report.run_report import GEOMETRY, SHARE
from stiffscope.runtime.cache import PICTURES, code_version, digest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from stiffscope.experiments.assembly import Assembled
    from stiffscope.gap.inference.diagnosis import Diagnosis
    from stiffscope.runtime.cache import Cache
    from stiffscope.vjm.kinematics.configurations import Configurations


@contextmanager
def shares_ahead(
    assembled: Assembled, campaign: Mapping[str, str], cache: Cache
) -> Iterator[tuple[str, Callable[..., None]]]:
    """Prepare the picture of a diagnosis while the diagnosis runs, unless the picture is cached.

    Yields its cache key and its drawing function.

    Parameters
    ----------
    assembled, cache
        Robot with its parts' matrices, and cache of results.
    campaign
        Files of the campaign with their checksums; with the robot they determine the diagnosis.
    """
    packages = ("stiffscope", "stiffscope.cad", "stiffscope.fea", "stiffscope.vjm")
    code = code_version(packages, ("numpy", "scipy", "pyvista", "vtk", "matplotlib"))
    facts = {**robot_facts(assembled), "skins": digest_solids(assembled)}
    key = digest({**facts, "campaign": campaign, "code": code})
    if cache.get(PICTURES, key) is not None:
        yield key, draw
        return
    with open_drawing(ahead=True) as draw_now:
        yield key, draw_now


def order_figures(diagnosis: Diagnosis, target: Path) -> Order:
    """Order the figures of a diagnosis."""
    samples = diagnosis.samples
    draws = (
        {} if samples is None else {**samples.parameters, "held out": samples.held_out}
    )
    sums = {
        name: hashlib.sha256(values.tobytes()).hexdigest()
        for name, values in draws.items()
    }
    more = repr((diagnosis.steps, diagnosis.signature_correlation))
    drawn = {"numbers": to_json(diagnosis), "not in JSON": more, "draws": sums}
    drawn["units"] = samples and samples.units
    code = code_version(
        ("stiffscope.report", "stiffscope.gap"), ("matplotlib", "numpy")
    )
    key = digest({"diagnosis": drawn, "code": code})
    return Order("figures", key, lambda to, _: draw_figures(diagnosis, to), target)


def order_shares(
    assembled: Assembled,
    diagnosis: Diagnosis,
    configurations: Configurations,
    target: Path,
    ahead: tuple[str, Callable[..., None]],
) -> list[Order]:
    """Order the robot's picture at the pose of the largest residual, coloured by share of the gap.

    There is none without shares.

    Parameters
    ----------
    assembled, target
        Robot with its parts' matrices, and folder to write to.
    diagnosis, configurations
        Diagnosis of the campaign, and configurations at the campaign's poses.
    ahead
        Prepared picture from `shares_ahead`.
    """
    where = diagnosis.where
    mechanism = assembled.mechanism
    if not where.component:
        return []
    worst = int(
        np.argmax(np.nansum(np.square(np.array(where.pose, dtype=float)), axis=1))
    )
    place = pose_text(
        mechanism, configurations.tool[worst, mechanism.tool.commanded_axes].tolist()
    )
    title = (
        f"Share of the gap by component, at the pose of the largest residual, {place}"
    )
    shown = {
        "file": "robot.png",
        "title": title,
        "moves": place_robot(configurations, worst).moves,
    }
    drawn = {**scene_of(assembled), "shares": shares(assembled.robot, diagnosis)}

    key, draw_ahead = ahead

    def write(folder: Path, _: Callable[..., None]) -> None:
        draw_ahead(
            "robot", folder, pictures=[shown], scale=SHARE, geometry=GEOMETRY, **drawn
        )

    return [Order("robot", key, write, target)]
