"""stiffscope: the stiffness of a robot from its parts' CAD, and the gap between model and machine.

`import stiffscope as ss` provides the names below; each is loaded on first use.

A part
    load_robot         read a robot file, or a robot of `data/robots` by name, with `--set` changes
    from_assembly      a robot file from a build123d assembly, as `stiffscope import` writes it from a STEP file
    build_part         the solid of a part of a robot, with its material, clamped and loaded faces
    read_step          the solid of a STEP file as a part
    material           a material by its name
    run_experiment     virtual experiment: the part's 6x6 compliance with error bounds, by finite elements
    Settings           how an experiment meshes, holds, loads and solves, and the tolerance wanted
    Experiment         result of an experiment: `compliance`, `error`, fields; a table in notebooks
    load_experiment    an experiment from a file written by `Experiment.save` or `stiffscope run`
    beam_compliance    the same 6x6 by beam theory
    compare            finite elements, beam theory and the published matrix, entry by entry
    deformed           picture of a part under each unit wrench

A robot, from a file or built in Python
    assemble           the mechanism of a robot file with its parts' compliances
    Mechanism          bodies, joints, tool and gravity; base axes, at one home configuration
    Body               a rigid body
    member             an elastic body between two ends, from its 6x6 compliance
    Joint              a joint between two bodies or ends of bodies
    Drive              the spring and the range of a driven joint
    Tool               the tool point and the coordinates that define a pose
    configure          configurations of a mechanism at tool poses; which are out of reach, and why
    analyse            stiffness, sag and mobility at tool poses
    stiffness          6x6 stiffness at tool poses
    sag                twist of the tool under the robot's own weight
    deflection         twist of the tool under a wrench, and each element's share of the strain energy
    along              tool error along a job's path under process forces, its causes, drive loads
    modes              natural frequencies, mode shapes and energy by element at tool poses
    stiffness_map      picture of the stiffness over the workspace
    view               interactive 3D view of the robot, inline in a notebook or as an HTML page
    study              run the design study of a study file
    Study              result of `study`: table, best designs, their robots
    sensitivity        derivatives of a compliance or stiffness by dimension, material and drive

A machine
    diagnose           find the effects that explain the gap between model and campaign readings
    Diagnosis          result of `diagnose`: verdict, effects, gap, what to measure next

Errors
    StiffscopeError    base class of every error that stiffscope raises on purpose
    InputError         invalid input; its one-line message states the problem and what is valid
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from stiffscope.names import *  # noqa: F403

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(
    __name__, str(Path(__file__).with_name("names.pyi"))
)

if (
    "IPython" in sys.modules
):  # notebooks show the objects above as tables, and progress as bars
    from stiffscope.notebook.objects import register

    register()
