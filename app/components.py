"""The 6x6 matrices of the parts from their three sources, and the robot that is assembled from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.published import slider_compliance

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np

    from app.parts import PartResult
    from app.schema import PartName, RobotFile, Source
    from fea.beam import Section
    from vjm.biglide import Biglide, Geometry


def sources(robot: RobotFile, components: str | None) -> dict[PartName, Source]:
    """Where each part's matrix comes from: the robot file, unless `components` names one source for all."""
    from app.schema import PARTS

    return {name: components or robot.part(name).compliance for name in PARTS}  # type: ignore[misc]


def beam_section(robot: RobotFile, name: PartName) -> tuple[float, Section]:
    """Length (m) and cross-section of a part seen as a beam along its x: a round link, a rectangular plate."""
    from fea.beam import circle, rectangle

    material, part = robot.material(name), robot.part(name).shape()
    poisson = getattr(material, "poisson", 0.3)
    if name == "link":
        return part["length"], circle(part["radius"], part["bore"], poisson)
    return part["depth"], rectangle(part["width"], part["thickness"], poisson)


def beam_compliance(robot: RobotFile, name: PartName) -> np.ndarray:
    """(6, 6) of Timoshenko's beam with Saint-Venant's torsion: the best that beam theory has."""
    from fea.beam import timoshenko

    material = robot.material(name)
    return timoshenko(*beam_section(robot, name), material.youngs_modulus, material.shear_modulus)


def published_compliance(robot: RobotFile, name: PartName) -> np.ndarray:
    """(6, 6) as the paper has it: Eq. (28) with the file's dimensions for the link, Eq. (29) as printed."""
    from fea.beam import euler_bernoulli

    if name == "slider":
        return slider_compliance()
    material = robot.material(name)
    return euler_bernoulli(*beam_section(robot, name), material.youngs_modulus, material.shear_modulus)


def component(robot: RobotFile, name: PartName, source: Source, results: Mapping[PartName, PartResult]) -> np.ndarray:
    """(6, 6) of a part from a source; "fea" takes it from the results."""
    if source == "fea":
        return results[name].compliance
    return beam_compliance(robot, name) if source == "beam" else published_compliance(robot, name)


def geometry(robot: RobotFile) -> Geometry:
    """The mechanism's dimensions for `vjm`."""
    from vjm.biglide import Geometry

    return Geometry(L=robot.part("link").shape()["length"], **robot.geometry.model_dump())


def assemble(robot: RobotFile, matrices: Mapping[PartName, np.ndarray], link_mass: float) -> Biglide:
    """The elastic robot with the effects that its file has adopted."""
    from vjm.biglide import Biglide

    return Biglide(
        geometry(robot), matrices["link"], matrices["slider"], robot.drive.stiffness, link_mass, robot.platform.mass
    )
