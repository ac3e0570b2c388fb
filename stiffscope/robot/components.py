"""The 6x6 matrices of the parts from their three sources, and the robot that is assembled from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.robot.published import slider_compliance

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np

    from stiffscope.fea.beam import Section
    from stiffscope.robot.effects import NominalRobot
    from stiffscope.robot.schema import PartName, RobotFile
    from stiffscope.vjm.biglide import Biglide, Geometry

    Theory = Callable[[float, Section, float, float], np.ndarray]


def beam_segments(robot: RobotFile, name: PartName) -> list[tuple[float, Section]]:
    """Lengths (m) and cross-sections of a part seen as a beam along its x, from the clamped end on.

    A link with fittings is three round bars; a slider is its plate, without ribs, holes and pads.
    """
    from stiffscope.fea.beam import circle, rectangle

    poisson = getattr(robot.material(name), "poisson", 0.3)
    part = robot.part(name).lengths()
    if name == "slider":
        return [(part["depth"], rectangle(part["width"], part["thickness"], poisson))]
    shank = circle(part["radius"], part["bore"] / 2, poisson)
    if not part["fitting_radius"]:
        return [(part["length"], shank)]
    end = part["fitting_length"], circle(part["fitting_radius"], part["bore"] / 2, poisson)
    return [end, (part["length"] - 2 * end[0], shank), end]


def beam_compliance(robot: RobotFile, name: PartName, theory: Theory | None = None) -> np.ndarray:
    """Compliance of a part by beam theory.

    Parameters
    ----------
    robot
        As `load_robot` gives it.
    name
        The part's name in the robot file.
    theory
        A function of `stiffscope.fea.beam`; by default Timoshenko's beam with Saint-Venant's torsion.

    Returns
    -------
    ndarray
        (6, 6), SI: twist at the loaded end for unit wrenches there, in the part's axes, clamped at the other end.

    """
    import numpy as np

    from stiffscope.fea.beam import timoshenko
    from stiffscope.vjm.screws import shift

    material, segments = robot.material(name), beam_segments(robot, name)
    total, beyond = np.zeros((6, 6)), 0.0
    for length, section in reversed(segments):
        piece = (theory or timoshenko)(length, section, material.youngs_modulus, material.shear_modulus)
        to_tip = shift([beyond, 0.0, 0.0])
        total += to_tip @ piece @ to_tip.T
        beyond += length
    return total


def published_compliance(robot: RobotFile, name: PartName) -> np.ndarray:
    """(6, 6) as the paper has it: Eq. (28) with the file's dimensions for the link, Eq. (29) as printed."""
    from stiffscope.fea.beam import euler_bernoulli

    return slider_compliance() if name == "slider" else beam_compliance(robot, name, euler_bernoulli)


def geometry(robot: RobotFile) -> Geometry:
    """The mechanism's dimensions for `vjm`."""
    from stiffscope.vjm.biglide import Geometry

    return Geometry(L=robot.part("link").lengths()["length"], **robot.geometry.model_dump())


def assemble(robot: RobotFile, matrices: Mapping[PartName, np.ndarray], link_mass: float) -> Biglide:
    """The elastic robot with the effects that its file has adopted, in their order."""
    from stiffscope.vjm.biglide import Biglide

    bare = Biglide(
        geometry(robot), matrices["link"], matrices["slider"], robot.drive.stiffness, link_mass, robot.platform.mass
    )
    return with_effects(bare, robot)


def entry_name(i: int, j: int) -> tuple[str, str]:
    """Name and unit of a compliance's entry, counted from 0, at or above the diagonal."""
    return f"C{i + 1}{j + 1}", "m/N" if j < 3 else "rad/(N·m)" if i >= 3 else "m/(N·m)"


def with_effects(bare: Biglide, robot: RobotFile) -> Biglide:
    """A robot that carries what its file has adopted. Raises InputError for what is no part of a robot."""
    from stiffscope.errors import InputError
    from stiffscope.robot.effects import adopted

    carried = nominal_robot(bare, robot)
    for number, effect in enumerate(robot.effects, 1):
        try:
            carried = adopted(carried, effect.effect, effect.place, effect.parameters)
        except InputError as error:
            raise InputError(f"{robot.path}: effects, number {number}: {error}") from error
    return carried.elastic


def nominal_robot(elastic: Biglide, robot: RobotFile) -> NominalRobot:
    """An elastic robot with what effects need of its file: gravity, and the links' expansion along them."""
    from stiffscope.robot.effects import NominalRobot

    return NominalRobot(elastic, robot.gravity.acceleration, robot.material("link").expansion)
