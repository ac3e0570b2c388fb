"""Sections of a robot file on parts: shape, material, supports and loads, mesh.

Keys of a parametric shape are its fields in `stiffscope.cad`: floats are lengths, integers counts.
"""

from __future__ import annotations

import dataclasses
import inspect
import typing
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    create_model,
    field_validator,
    model_validator,
)

from stiffscope.cad.faces import ENDS, FaceSelector
from stiffscope.cad.materials import AnyMaterial, Material, TransverselyIsotropic
from stiffscope.cad.shapes import SHAPES
from stiffscope.cad.solid import Placement, SolidParameters
from stiffscope.errors import InputError, require
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import values as v
from stiffscope.robot.file.values import Says, Section
from stiffscope.vjm.model.bodies import Body, superelement_body
from stiffscope.vjm.model.checks import check_compliance

Source = Literal["fea", "beam", "published"]
MaterialName = Annotated[str, Says('a material such as "steel"')]


class Mesh(Section):
    """Mesh and solution of a part: "auto" lets the mesher choose; a tolerance refines the mesh.

    `modes`, or all modes below `highest_frequency`, are the fixed-interface modes of the part's
    condensed mass.
    """

    size: v.LengthOrAuto = None
    envelope: v.LengthOrAuto = None
    layers: v.Layers = 1
    tolerance: v.Tolerance = None
    most_unknowns: v.Positive = 2_000_000
    time_limit: v.Duration = 300.0
    solver: Literal["auto", "direct", "multigrid"] = "auto"
    modes: v.Count | None = None
    highest_frequency: v.Frequency | None = None


def _position(value: Any) -> str | tuple[float, ...]:
    if isinstance(value, list) and len(value) == 3:
        x, y, z = (q.to_si(item, q.LENGTH, sign="any") for item in value)
        return x, y, z
    what = f'one of {", ".join(ENDS)} or a point such as ["85 mm", 0, 0]'
    require(isinstance(value, str) and value in ENDS, "", what, q.show_value(value))
    return str(value)


def _numbers(value: Any) -> tuple[int, ...]:
    return tuple(map(v.parse_whole, value if isinstance(value, list) else [value]))


class Face(Section):
    """A choice of faces by geometry; see `stiffscope faces FILE`.

    `washer`, an outer diameter, selects annuli around round holes of plane faces, as if imprinted;
    `radius` and `position` of the centre are then the hole's, `normal` and `index` its face's.
    """

    kind: str | None = None
    normal: v.Direction | None = None
    position: Annotated[str | tuple[float, ...], BeforeValidator(_position)] | None = (
        None
    )
    radius: v.Length | None = None
    index: Annotated[tuple[int, ...], BeforeValidator(_numbers)] | None = None
    washer: v.Length | None = None

    def selector(self) -> FaceSelector:
        """Return the selector for cad."""
        return FaceSelector(**dict(self))

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.selector()
        return self


def _some(value: Any) -> Any:
    faces = [value] if isinstance(value, dict) else value
    require(faces not in ([], ()), "", "at least one face selector", "none")
    return faces


Faces = Annotated[tuple[Face, ...], BeforeValidator(_some)]
Coupled = Literal["rigid", "distributed"]


class NamedFaces(Section):
    """An interface of a STEP part: "rigid" faces move as one, "distributed" ones are loaded evenly.

    A selection of faces, or a list of them, may replace a table of `faces` alone; `interface` may
    stand among its keys.
    """

    faces: Faces
    interface: Coupled | None = None


def _named(value: Any) -> Any:
    if isinstance(value, dict) and "faces" not in value:
        interfaces = {key: value[key] for key in value if key == "interface"}
        return interfaces | {
            "faces": [
                {key: each for key, each in value.items() if key not in interfaces}
            ]
        }
    return {"faces": value} if isinstance(value, list | tuple) else value


Named = Annotated[NamedFaces, BeforeValidator(_named)]


class PartSection(Section):
    """Common keys of parts: a shape, and a mass in kg ("cad": volume times density)."""

    shape: str
    mass: v.MassOrCad = "cad"

    @property
    def interface_names(self) -> tuple[str, ...]:
        """Names of its `interfaces`, ends of its bodies; empty for a part between base and tip."""
        return tuple(getattr(self, "interfaces", None) or ())

    @property
    def sources(self) -> tuple[Source, ...]:
        """Possible sources of its 6x6 that a file or command names."""
        return ()

    @property
    def span(self) -> float | None:
        """Length from clamped end to reference point, m; None if it is not parametric."""
        return None


class SolidPart(PartSection):
    """A solid part: material, source of its 6x6, supports, loads and mesh."""

    material: MaterialName
    compliance: Source = "fea"

    interface: Coupled = "rigid"
    foundation: v.Foundation = None
    mesh: Mesh = Mesh()

    @property
    def sources(self) -> tuple[Source, ...]:
        """See `PartSection`."""
        return typing.get_args(type(self).model_fields["compliance"].annotation)


class ParametricPart(SolidPart):
    """A solid that the file describes by lengths and counts."""

    describes: ClassVar[type[SolidParameters]]

    @property
    def interface_names(self) -> tuple[str, ...]:
        """See `PartSection`."""
        ports = self.parameters().ports
        return ("clamped", *ports) if ports else ()

    @property
    def span(self) -> float:
        """See `PartSection`."""
        return self.parameters().span

    def dimensions(self) -> dict[str, float | int | str]:
        """Return the parameters of the part's shape, SI."""
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self.describes)
        }

    def parameters(self) -> SolidParameters:
        """Return the shape for cad; its InputError names the parameter: "link.bore: …"."""
        return self.describes(**self.dimensions())

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.parameters()
        return self


_CONSTANTS = {
    "modulus": v.Modulus,
    "poisson": v.Ratio,
    "density": v.Density,
    "expansion": v.Expansion,
}


def _section_of(
    name: str,
    base: Any,
    described: type,
    required: tuple[str, ...] = (),
    **further: Any,
) -> Any:
    """Create a section with one key for each field, but its name, of the ``described`` type.

    ``further`` are the docstring and other keys of the section.
    """
    kinds = {float: v.LengthOrZero, int: v.Count}
    hints = typing.get_type_hints(described, include_extras=True)
    fields = dict[str, Any](further)
    for field in dataclasses.fields(described):
        if field.name == "name":
            continue
        hint = hints[field.name]
        means = None
        if typing.get_origin(hint) is Annotated:
            hint, means = typing.get_args(hint)
        needed = field.name in required or field.default is dataclasses.MISSING
        kind = v.Length if needed else kinds.get(hint, hint)
        kind = _CONSTANTS.get(field.name.rpartition("_")[2], kind)
        default = ... if needed else field.default
        fields[field.name] = kind, Field(default, description=means)
    model: Any = create_model(name, __base__=base, __module__=__name__, **fields)
    model.describes = described
    return model


def _read_shape(shape: type[SolidParameters]) -> type[ParametricPart]:
    """Create the section of a shape, described by its docstring without the errors."""
    annotations_of: dict[str, Any] = {}
    annotations_of["__doc__"] = (inspect.getdoc(shape) or "").partition("\n\nRaises\n")[
        0
    ]
    if shape.segments is SolidParameters.segments:  # no beam theory: FEA alone
        annotations_of["compliance"] = (Literal["fea"], "fea")
    if shape.published == "table":
        annotations_of["published"] = (str | None, None)
    name = f"{shape.shape.title()}Part"
    return _section_of(name, ParametricPart, shape, shape.required, **annotations_of)


PARAMETRIC = {name: _read_shape(shape) for name, shape in SHAPES.items()}
# as names of this module, by which other processes unpickle their instances
globals().update({model.__name__: model for model in PARAMETRIC.values()})


def _solid(value: Any) -> int | str:
    if value == "all" or (type(value) is int and value >= 1):
        return value
    raise ValueError(q.expected('the number of a solid, from 1, or "all"', value))


Chosen = Annotated[int | str, BeforeValidator(_solid)]


class StepPart(SolidPart):
    """A solid from a STEP file; its faces by geometry, its axes by a frame, x from base to tip.

    Of a file of several solids, `solid` is the number of one, or "all", which are fused if they
    touch. With two or more named `interfaces` instead of `clamped` and `loaded`, each a choice of faces,
    bodies made of it have these as ends, and are placed by their `at`, `x` and `y`.
    """

    excludes = {"interfaces": ("clamped", "loaded", "reference_point")}  # noqa: RUF012 (not a field)

    compliance: Literal["fea"] = "fea"  # pyright: ignore[reportIncompatibleVariableOverride]
    file: Annotated[str, Says('a path such as "arm.step"')]
    solid: Annotated[
        Chosen | None, Says('the number of a solid in the file, or "all"')
    ] = None
    clamped: Faces | None = None
    loaded: Faces | None = None
    interfaces: dict[str, Named] | None = None
    origin: v.Point = (0.0, 0.0, 0.0)
    x: v.Direction = (1.0, 0.0, 0.0)
    z: v.Direction = (0.0, 0.0, 1.0)
    reference_point: v.Point | None = None

    def placement(self) -> Placement:
        """Return the part's axes for cad."""
        return Placement(self.origin, self.x, self.z)

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.placement()
        if self.interfaces is None:
            return self
        require(
            len(self.interfaces) >= 2,
            "step.interfaces",
            "two or more",
            list(self.interfaces),
        )
        first = next(iter(self.interfaces))
        require(
            self.interfaces[first].interface != "distributed",
            f"step.interfaces.{first}.interface",
            "rigid for the first one, which is at rest",
        )
        return self


def _square(expected: str, size: int = 0) -> BeforeValidator:
    """Return a validator of square matrices (SI), of a given size if it is not zero."""

    def read(value: Any) -> tuple[tuple[float, ...], ...]:
        rows = value if isinstance(value, list | tuple) else []
        count = size or len(rows)
        listed = all(isinstance(row, list | tuple) for row in rows)
        require(
            rows and listed and {count} == {len(rows), *map(len, rows)},
            "",
            expected,
            q.show_value(value),
        )
        return tuple(
            tuple(q.to_si(entry, q.NUMBER, sign="any") for entry in row) for row in rows
        )

    return BeforeValidator(read)


_SIX = "six rows of six numbers (SI)"
_ROWS = "as many rows of numbers (SI) as there are numbers in each"
_SIXES = "a square matrix of six rows for each interface (SI)"
Square = Annotated[tuple[tuple[float, ...], ...], _square(_ROWS), Says(_SIXES)]
Matrix = Annotated[tuple[tuple[float, ...], ...], _square(_SIX, 6), Says(_SIX)]


class MatrixPart(PartSection):
    """A 6x6 compliance from elsewhere: SI, base clamped, twist and wrench at the tip, part axes."""

    matrix: Matrix
    error: Matrix | None = None
    mass: v.OwnMass = 0.0  # pyright: ignore[reportIncompatibleVariableOverride]
    material: str | None = None

    @field_validator("matrix")
    @classmethod
    def _possible(
        cls, value: tuple[tuple[float, ...], ...]
    ) -> tuple[tuple[float, ...], ...]:
        try:
            sound = check_compliance(np.array(value), "matrix", semidefinite=True)
        except ValueError as error:
            what = "a symmetric, positive semidefinite compliance"
            why = str(error).partition(": ")
            raise ValueError(f"expected {what}, got another: {why[2]}") from error
        for k, most in enumerate((q.COMPLIANCE,) * 3 + (q.TILTING,) * 3):
            beyond = most.refusal(sound[k, k]) if sound[k, k] > 1.0 else ""
            require(
                not beyond,
                "",
                f"{most.noun}, not a stiffness",
                f"{sound[k, k]:g} for entry {k + 1}{k + 1}, which is {beyond}",
            )
        return tuple(tuple(map(float, row)) for row in sound)

    @field_validator("error")
    @classmethod
    def _check_bounds(cls, value: Any) -> Any:
        bounds = np.array(value or np.zeros((6, 6)))
        least = bounds.min()
        require(least >= 0.0, "", "bounds of at least 0", f"{least:g}")
        i, j = np.unravel_index(np.abs(bounds - bounds.T).argmax(), (6, 6))
        entries = f"{i + 1}{j + 1} and {j + 1}{i + 1}"
        require(
            np.allclose(bounds, bounds.T, rtol=1e-6, atol=0.0),
            "",
            "symmetric bounds",
            f"{bounds[i, j]:g} and {bounds[j, i]:g} for entries {entries}",
        )
        return value


class InterfacePart(PartSection):
    """A solid by its unsupported stiffness on two or more interfaces: ux uy uz rx ry rz, part axes.

    `interfaces` are their places, in matrix order; without `mass_matrix` they share the `mass`
    equally. Further rows of `mass_matrix` are fixed-interface modes, of `mode_squares` (rad²/s²). A
    `file` may replace the matrices: .npz, Matrix Market (NAME.stiffness.mtx beside NAME.mass.mtx)
    or Nastran's DMIG, as written by `stiffscope compliance --superelement`.
    """

    excludes = {"mass_matrix": ("mass",)}  # noqa: RUF012 (not a field)

    interfaces: dict[str, v.Point]
    stiffness: Square
    mass_matrix: Square | None = None
    mode_squares: tuple[float, ...] = ()
    file: str | None = None
    mass: v.OwnMass = 0.0  # pyright: ignore[reportIncompatibleVariableOverride]
    material: str | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        try:
            _ = self.build("part")
        except InputError as error:  # "bodies.part.stiffness: …"
            raise InputError(str(error).removeprefix("bodies.")) from error
        return self

    def build(self, name: str, at: Any = (0.0, 0.0, 0.0), axes: Any = None) -> Body:
        """Return a body made of it, with its origin ``at`` (3,) and its axes (3, 3) as columns."""
        given = {
            key: getattr(self, key) for key in ("mass", "mass_matrix", "mode_squares")
        }
        return superelement_body(
            name, self.interfaces, self.stiffness, at=at, axes=axes, **given
        )


PARTS: dict[str, type[PartSection]] = {
    **PARAMETRIC,
    "step": StepPart,
    "matrix": MatrixPart,
}


class MaterialSection(Section):
    """An elastic material, of one of the laws that cad knows."""

    describes: ClassVar[type]

    def build(self, name: str) -> AnyMaterial:
        """Return the material for CAD and FEA."""
        return self.describes(name, **self.model_dump())


_BULK = "An isotropic elastic material."
_ALONG = "A transversely isotropic material, fibres along the part's x."
Isotropic = _section_of("Isotropic", MaterialSection, Material, __doc__=_BULK)
Fibrous = _section_of("Fibrous", MaterialSection, TransverselyIsotropic, __doc__=_ALONG)
