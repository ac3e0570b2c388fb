"""stiffscope: from a CAD part to the stiffness of the whole robot, and to the gap between model and machine.

`import stiffscope as ss` gives what a notebook needs; each name is loaded when it is first used.

A part
    load_robot         read a robot file, or a robot of `data/robots` by its name, with changes as `--set` makes them
    build_part         the solid of a part of a robot, with its material, clamped and loaded faces
    read_step          the solid of a STEP file as a part
    material           a material by its name
    run_experiment     virtual experiment: the part's 6x6 compliance with error bounds, by finite elements
    Settings           how an experiment meshes, holds, loads and solves, and the tolerance wanted
    Experiment         what an experiment gives: `compliance`, `error`, fields; notebooks show every object as a table
    load_experiment    an experiment from the file that `Experiment.save` or `stiffscope run` wrote
    beam_compliance    the same 6x6 by beam theory
    compare            finite elements beside beam theory beside the published matrix, entry by entry
    deformed           picture of a part under each unit wrench

A robot, of a file or made here
    assemble           the mechanism of a robot file with its parts' compliances
    Mechanism          bodies, joints, tool and gravity; base axes, at one home configuration
    Body               a rigid body
    member             an elastic body between two ends, of a 6x6 compliance
    Joint              a joint between two bodies or ends of bodies
    Drive              the spring and the range of a driven joint
    Tool               the tool point and the coordinates that command a pose
    configure          configurations of a mechanism at tool poses; which are out of reach, and why
    analyse            stiffness, sag and mobility at tool poses
    stiffness          6x6 stiffness at tool poses
    sag                twist of the tool under the robot's own weight
    deflection         twist of the tool under a wrench, and each element's share of the strain energy
    along              error of the tool along a job's path under process forces, what the drives carry, and why
    modes              natural frequencies, mode shapes and energy by element at tool poses
    stiffness_map      picture of the stiffness over the workspace
    view               the robot that turns, bends and vibrates, inline in a notebook or as a page
    study              the designs that a study's file asks for, made
    Study              what `study` gives: table, best designs, their robots
    sensitivity        what a part's compliance, or the robot's stiffness, gains by each dimension, material and drive

A machine
    diagnose           which effects explain the gap between a model and the readings of a campaign folder
    Diagnosis          what `diagnose` gives: verdict, effects, gap, what to measure next

Errors
    StiffscopeError    base class of every error that stiffscope raises on purpose
    InputError         bad input; its message is one line that says what is wrong and what would be valid
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stiffscope.cad.materials import material as material
    from stiffscope.cad.step import read_step as read_step
    from stiffscope.design.path.along import along as along
    from stiffscope.design.sensitivities import sensitivity as sensitivity
    from stiffscope.design.studies import Study as Study
    from stiffscope.design.studies import study as study
    from stiffscope.errors import InputError as InputError
    from stiffscope.errors import StiffscopeError as StiffscopeError
    from stiffscope.experiments.assembly import assemble as assemble
    from stiffscope.experiments.orders import build_part as build_part
    from stiffscope.fea.experiment import Experiment as Experiment
    from stiffscope.fea.experiment import load_experiment as load_experiment
    from stiffscope.fea.run import run_experiment as run_experiment
    from stiffscope.fea.settings import Settings as Settings
    from stiffscope.gap.campaigns import diagnose as diagnose
    from stiffscope.gap.inference.diagnosis import Diagnosis as Diagnosis
    from stiffscope.report.compare import compare as compare
    from stiffscope.report.notebook import deformed as deformed
    from stiffscope.report.notebook import stiffness_map as stiffness_map
    from stiffscope.report.notebook import view as view
    from stiffscope.robot.part_matrices import beam_compliance as beam_compliance
    from stiffscope.robot.reader import load_robot as load_robot
    from stiffscope.vjm.bodies import Body as Body
    from stiffscope.vjm.bodies import member as member
    from stiffscope.vjm.joints import Drive as Drive
    from stiffscope.vjm.joints import Joint as Joint
    from stiffscope.vjm.kinematics import configure as configure
    from stiffscope.vjm.mechanism import Mechanism as Mechanism
    from stiffscope.vjm.mechanism import Tool as Tool
    from stiffscope.vjm.modes import modes as modes
    from stiffscope.vjm.statics import analyse as analyse
    from stiffscope.vjm.statics import sag as sag
    from stiffscope.vjm.statics import stiffness as stiffness
    from stiffscope.vjm.yielding import deflection as deflection

__version__ = "0.2.0"

_MODULES = {
    "cad.materials": ("material",),
    "cad.step": ("read_step",),
    "errors": ("InputError", "StiffscopeError"),
    "fea.experiment": ("Experiment", "load_experiment"),
    "fea.run": ("run_experiment",),
    "fea.settings": ("Settings",),
    "gap.inference.diagnosis": ("Diagnosis",),
    "experiments.assembly": ("assemble",),
    "gap.campaigns": ("diagnose",),
    "experiments.orders": ("build_part",),
    "design.path.along": ("along",),
    "design.sensitivities": ("sensitivity",),
    "design.studies": ("Study", "study"),
    "report.compare": ("compare",),
    "report.notebook": ("deformed", "stiffness_map", "view"),
    "robot.part_matrices": ("beam_compliance",),
    "robot.reader": ("load_robot",),
    "vjm.kinematics": ("configure",),
    "vjm.bodies": ("Body", "member"),
    "vjm.joints": ("Drive", "Joint"),
    "vjm.mechanism": ("Mechanism", "Tool"),
    "vjm.modes": ("modes",),
    "vjm.statics": ("analyse", "sag", "stiffness"),
    "vjm.yielding": ("deflection",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_HOME)  # noqa: PLE0605  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a name from its module when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module 'stiffscope' has no attribute {name!r}")
    value = getattr(import_module(f"stiffscope.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names above."""
    return sorted([*__all__, "__version__"])


if "IPython" in sys.modules:  # a notebook shows every object above as a table, and progress as bars
    from stiffscope.report.notebook import register

    register()
