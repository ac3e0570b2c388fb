"""Orders of virtual experiments: all inputs of a part's experiment, cache key, part to test.

Processes that run experiments import this, and know no robot.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from stiffscope.cad.solid import GREATEST_X, LEAST_X, build
from stiffscope.cad.step import read_step
from stiffscope.errors import InputError
from stiffscope.runtime.cache import code_version, digest

if TYPE_CHECKING:
    from stiffscope.cad.faces import FaceSelector
    from stiffscope.cad.materials import AnyMaterial
    from stiffscope.cad.part import Part
    from stiffscope.cad.solid import Placement, SolidParameters
    from stiffscope.fea.settings import Settings

LIBRARIES = (
    "cadquery-ocp-novtk",
    "pytetwild",
    "scikit-fem",
    "numpy",
    "scipy",
)
FORM = 8  # format version of cached experiments


@dataclass(frozen=True)
class StepOrder:
    """A STEP file's solid as a part: content, faces (default: least and greatest x), axes."""

    path: Path  # absolute, for workers in other folders
    sha256: str
    given: str = field(
        default="", compare=False
    )  # path as the user gave it, for messages
    clamped: tuple[FaceSelector, ...] = LEAST_X
    loaded: tuple[FaceSelector, ...] = GREATEST_X
    interfaces: tuple[tuple[str, tuple[FaceSelector, ...]], ...] = ()
    couplings: tuple[tuple[str, str], ...] = ()
    placement: Placement | None = None
    reference_point: tuple[float, float, float] | None = None
    chosen: int | str | None = None  # of several solids
    shape: ClassVar[str] = "step"
    axes: ClassVar[str] = (
        "those of the STEP file, or of the frame chosen in it; twist (v, omega) and wrench (f, m) "
        "at the loaded faces' reference point"
    )

    def lengths(self) -> dict[str, float]:
        """Return the dimensions that can vary: none."""
        return {}


@dataclass(frozen=True)
class PartOrder:
    """All inputs of a part's virtual experiment; the label is used in messages only.

    The solid comes from dimensions or from a STEP file.
    """

    name: str
    solid: SolidParameters | StepOrder
    material: AnyMaterial
    settings: Settings
    label: str = field(default="", compare=False)

    @property
    def step(self) -> StepOrder | None:
        """STEP file of the solid; None if the solid is parametric."""
        return self.solid if isinstance(self.solid, StepOrder) else None

    @property
    def shape(self) -> str:
        """Kind of solid: "rod", "plate", "box", ... or "step"."""
        return self.solid.shape

    @property
    def axes(self) -> str:
        """Part axes and reference point, in words."""
        return self.solid.axes

    def key(self) -> str:
        """Return the cache key: hash of shape, material, settings, STEP file's content and code."""
        solid = (
            dataclasses.replace(self.step, path=Path(), given="")
            if self.step
            else self.solid
        )
        plain = {"solid": solid, "material": self.material, "settings": self.settings}
        return digest(
            {
                "name": self.name,
                "shape": self.shape,
                "form": FORM,
                **{name: dataclasses.asdict(each) for name, each in plain.items()},
                "code": code_version(("stiffscope.cad", "stiffscope.fea"), LIBRARIES),
            }
        )

    def moves_from(self, other: PartOrder) -> bool:
        """Return whether another order's mesh can be morphed: same shape and mesh settings."""
        one, two = (
            dataclasses.replace(o.settings, foundation=None) for o in (self, other)
        )
        return self.step is None and self.shape == other.shape and one == two

    def build(self) -> Part:
        """Build the part: its parametric shape, or the solid of a STEP file."""
        if not isinstance(self.solid, StepOrder):
            return build(self.solid, self.material, self.name)
        step = self.solid
        try:
            return read_step(
                step.path,
                name=self.name,
                material=self.material,
                clamped=step.clamped,
                loaded=step.loaded,
                interfaces=dict(step.interfaces) or None,
                couplings=dict(step.couplings),
                placement=step.placement,
                reference_point=step.reference_point,
                chosen=step.chosen,
            )
        except InputError as error:
            text = str(error).replace("faces FILE", f"faces {step.path}")
            raise InputError(text.replace(str(step.path), step.given)) from error
