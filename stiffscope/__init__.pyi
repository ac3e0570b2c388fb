"""The names of the package and their modules: what is loaded when it is first used, and what type checkers see."""

from .cad.materials import material as material
from .cad.step import read_step as read_step
from .design.path.along import along as along
from .design.sensitivities import sensitivity as sensitivity
from .design.studies import Study as Study
from .design.studies import study as study
from .errors import InputError as InputError
from .errors import StiffscopeError as StiffscopeError
from .experiments.assembly import assemble as assemble
from .experiments.orders import build_part as build_part
from .fea.experiment import Experiment as Experiment
from .fea.experiment import load_experiment as load_experiment
from .fea.run import run_experiment as run_experiment
from .fea.settings import Settings as Settings
from .gap.campaigns import diagnose as diagnose
from .gap.inference.diagnosis import Diagnosis as Diagnosis
from .report.compare import compare as compare
from .report.notebook import deformed as deformed
from .report.notebook import stiffness_map as stiffness_map
from .report.notebook import view as view
from .robot.part_matrices import beam_compliance as beam_compliance
from .robot.reader import load_robot as load_robot
from .vjm.bodies import Body as Body
from .vjm.bodies import member as member
from .vjm.joints import Drive as Drive
from .vjm.joints import Joint as Joint
from .vjm.kinematics import configure as configure
from .vjm.mechanism import Mechanism as Mechanism
from .vjm.mechanism import Tool as Tool
from .vjm.modes import modes as modes
from .vjm.statics import analyse as analyse
from .vjm.statics import sag as sag
from .vjm.statics import stiffness as stiffness
from .vjm.yielding import deflection as deflection

__version__: str
