"""Solids, light and camera of an MJCF model: for the eye, without mass and contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np

from stiffscope.exports.mjcf_tree import numbers
from stiffscope.vjm.model.checks import GROUND

if TYPE_CHECKING:
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.exports.mjcf_tree import Writer
    from stiffscope.vjm.model.screws import Array

_DIGITS = 6  # of places, m
_FLAT = 1e-9  # m: smallest singular value of a mesh that MuJoCo takes


def add_meshes(writer: Writer, assembled: Assembled) -> None:
    """Add the solids as they are drawn in reports: parts, rigid bodies, joints, feet.

    A solid of an elastic body moves with its mean axes and does not bend.
    """
    from stiffscope.report.drawing.solids import solids_of
    from stiffscope.report.robot_scene import scene_of

    scene = scene_of(assembled)
    up = np.asarray(scene["up"], dtype=float)
    solids = solids_of(scene["bodies"], scene["joints"], scene["tool"], up)
    assets = ET.Element("asset")
    for number, solid in enumerate(solids, start=1):
        owner = _owner(writer, assembled, solid.nodes)
        body, place = writer.places[owner]
        surface: Any = solid.surface.triangulate()
        away = np.asarray(surface.points, dtype=float) - place.origin()
        points = (away @ place.matrix()).round(_DIGITS)
        faces = np.asarray(surface.faces).reshape(-1, 4)[:, 1:]
        if not _is_solid(points, faces):
            continue
        name = f"solid{number}"
        mesh = ET.SubElement(assets, "mesh", name=name, inertia="shell")
        mesh.set("smoothnormal", "false")
        mesh.set("vertex", " ".join(f"{value:g}" for value in points.ravel()))
        mesh.set("face", " ".join(map(str, faces.ravel())))
        geom = ET.SubElement(body, "geom", type="mesh", mesh=name, mass="0")
        geom.set("contype", "0")
        geom.set("conaffinity", "0")
        geom.set("group", "1")
        geom.set("rgba", numbers(_colour(solid.colour, glass=solid.glass)))
    sky = {"type": "skybox", "builtin": "gradient", "width": "64", "height": "384"}
    ET.SubElement(assets, "texture", sky | {"rgb1": "1 1 1", "rgb2": ".8 .84 .88"})
    visual = ET.Element("visual")
    light = {"ambient": ".45 .45 .45", "diffuse": ".5 .5 .5"}
    ET.SubElement(visual, "headlight", light)
    ET.SubElement(visual, "global", {"offwidth": "1920", "offheight": "1080"})
    for position, element in enumerate((_statistic(assembled), visual, assets), 2):
        writer.root.insert(position, element)


def _statistic(assembled: Assembled) -> ET.Element:
    """Return where a camera finds the robot."""
    mechanism = assembled.mechanism
    points: Array = np.array([*(j.at for j in mechanism.joints), mechanism.tool.at])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    out = ET.Element("statistic", center=numbers(middle.round(_DIGITS)))
    size = max(float(np.ptp(points, axis=0).max()), 0.01)
    out.set("extent", numbers(round(size, _DIGITS)))
    return out


def _owner(writer: Writer, assembled: Assembled, nodes: tuple[str, ...]) -> str:
    """Return the name of the place in the model with which a solid moves."""
    if len(nodes) > 1:
        return assembled.mechanism.carrier(nodes[0])
    return nodes[0] if nodes[0] in writer.places else GROUND


def _is_solid(points: Array, faces: Array) -> bool:
    """Return whether points span a volume, which MuJoCo wants of a mesh."""
    if len(points) < 4 or not len(faces):
        return False
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[-1] > _FLAT)


def _colour(text: str, *, glass: bool) -> list[float]:
    """Return red, green, blue and opacity of a colour such as #3b7dbf."""
    parts = [int(text[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    return [*parts, 0.35 if glass else 1.0]
