"""stiffscope: from a CAD part to the stiffness of the whole robot, and to the gap between model and machine.

`import stiffscope as ss` gives what a notebook needs; each name is loaded when it is first used.

A part
    load_robot         read a robot file, or a robot of `data/robots` by its name, with changes as `--set` makes them
    from_assembly      a robot file from a build123d assembly, as `stiffscope import` writes it from a STEP file
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

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from stiffscope.names import *  # noqa: F403

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, str(Path(__file__).with_name("names.pyi")))

if "IPython" in sys.modules:  # a notebook shows every object above as a table, and progress as bars
    from stiffscope.report.notebook import register

    register()
