"""Sections of a robot file on bearings, guides, screws, by data sheet; SI, x along the joint axis.

Each kind is defined by its rolling elements, or by the stiffnesses in its data sheet.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union, get_args

import numpy as np
from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from stiffscope.errors import InputError, require, require_given
from stiffscope.robot.file import quantities as q
from stiffscope.robot.file import values as v
from stiffscope.robot.file.parse import Source, naming_key, parse_text
from stiffscope.robot.file.tables import one_of, read_table
from stiffscope.robot.file.values import Says, Section
from stiffscope.vjm.elements import machine_elements as me
from stiffscope.vjm.elements.rolling import LINE, POINT
from stiffscope.vjm.model.checks import PARALLEL
from stiffscope.vjm.model.screws import shift

if TYPE_CHECKING:
    from pathlib import Path


def _check_both(value: Any) -> Any:
    pair = value if isinstance(value, list | tuple) else [value, value]
    numbers = tuple(q.to_si(each, q.NUMBER) for each in pair)
    require(
        len(numbers) == 2 and all(0.5 < each < 1.0 for each in numbers),
        "",
        "a groove radius over ball diameter such as 0.52",
        q.show_value(value),
    )
    return numbers


_THREE = 'three forces, along the axis first, such as ["0 N", "500 N", "0 N"]'
_BOTH = "a ratio such as 0.52, or inner and outer"
Osculation = Annotated[tuple[float, float], BeforeValidator(_check_both), Says(_BOTH)]
Forces = Annotated[tuple[v.Force, v.Force, v.Force], Says(_THREE)]


class ElementSection(Section):
    """Common keys: `offset` of the element's middle from the joint's `at` along the axis."""

    sheet: ClassVar[tuple[str, ...]] = ()
    beside: ClassVar[tuple[str, ...]] = ()
    """Keys of data-sheet stiffnesses, and keys permitted beside them."""

    kind: Any
    offset: v.Coordinate = 0.0

    @abstractmethod
    def element(self) -> me.MachineElement:
        """Return the element, with stiffness at its load; raise InputError "KEY: expected ..."."""

    def turn(self, axes: np.ndarray) -> np.ndarray:
        """Return the rotation (3, 3) about x from own to joint axes; ``axes`` (3, 3) in base axes."""
        del axes
        return np.eye(3)

    def stiffness(self, axes: np.ndarray) -> np.ndarray:
        """Return the stiffness (6, 6) at the joint's `at`, in the joint's axes."""
        turn = np.kron(np.eye(2), self.turn(axes))
        carry = shift([self.offset, 0.0, 0.0])
        return carry.T @ turn @ self.element().stiffness @ turn.T @ carry

    def _need(self, *keys: str) -> list[Any]:
        """Return the values of keys; raise InputError if one is missing."""
        what = "a value beside the others"
        return [require_given(getattr(self, key), key, what) for key in keys]

    @property
    def _by_sheet(self) -> str:
        """First key given of the data sheet's own stiffnesses, or an empty text."""
        return next((key for key in self.sheet if getattr(self, key) is not None), "")

    @model_validator(mode="after")
    def _possible(self) -> ElementSection:
        beside = self.model_fields_set - {"kind", "offset", *self.sheet, *self.beside}
        for key in type(self).model_fields if self._by_sheet else ():
            require(
                key not in beside,
                f"bearing.{key}",
                f"none beside the sheet's own {self._by_sheet}",
                "one",
            )
        try:
            _ = self.element().compliance
        except InputError as error:
            raise InputError(f"bearing.{error}") from error
        return self


class _Rotary(ElementSection):
    sheet = ("radial", "axial", "tilting")
    beside = ("at_load", "preload", "load")

    radial: v.Stiffness | None = None
    axial: v.Stiffness | None = None
    tilting: v.Torsion | None = None
    at_load: v.Preload | None = None
    preload: v.Preload = 0.0
    load: Forces = (0.0, 0.0, 0.0)

    def _of_sheet(self, exponent: float) -> me.MachineElement:
        known = [
            (stiffness or 0.0) for stiffness in (self.radial, self.axial, self.tilting)
        ]
        source = "the sheet's own stiffness"
        acting = self.preload or float(np.linalg.norm(self.load))
        beside = "preload" if self.preload else "load"
        what = f"the load of the sheet's own stiffness beside {beside}"
        require(self.at_load is not None or not acting, "at_load", what, "nothing")
        if self.at_load is not None:
            require(
                self.at_load > 0.0 and acting > 0.0,
                "at_load",
                "it beside the preload or load that acts here, both above 0",
            )
            known = [
                me.at_load(value, self.at_load, acting, exponent) for value in known
            ]
            source += f" at {self.at_load:g} N, as the load to the power {1.0 - 1.0 / exponent:.3g}"
        return me.of_sheet(known[0], known[1], known[2], source)

    @property
    def _force(self) -> np.ndarray:
        return np.add(self.load, (self.preload, 0.0, 0.0))


class BallBearing(_Rotary):
    """A ball bearing: number and size of its `balls`, their circle, contact angle, groove radii.

    `preload` acts along its axis, on each bearing of a pair; `load` is any further load on the
    inner ring. `radial`, `axial` and `tilting` stiffness of the whole from its data sheet may be
    given instead; if given `at_load`, they vary with the preload to the power 1/3.
    """

    kind: Literal["deep-groove", "angular-contact"]
    balls: v.Some | None = None
    ball: v.Length | None = None
    pitch: v.Length | None = None
    angle: v.Angle | None = None
    osculation: Osculation = (0.52, 0.53)
    clearance: v.Coordinate = 0.0
    ball_material: Literal["steel", "ceramic"] = "steel"
    arrangement: Literal["single", "back-to-back", "face-to-face", "tandem"] = "single"
    spacing: v.LengthOrZero = 0.0

    def element(self) -> me.MachineElement:
        """See `ElementSection`."""
        if self._by_sheet:
            return self._of_sheet(POINT)
        angular = self.kind == "angular-contact"
        balls, ball, pitch = self._need("balls", "ball", "pitch")
        if angular:
            self._need("angle")
        thrust = self._force[0]
        what = "a thrust along the pressed side of an angular-contact bearing"
        require(not angular or thrust >= 0.0, "load", what, f"{thrust:g} N")
        modulus = me.reduced_modulus(
            {"steel": me.STEEL, "ceramic": me.CERAMIC}[self.ball_material]
        )
        angle = self.angle or 0.0
        groove = self.osculation
        contacts = me.ball_contacts(
            count=balls,
            diameter=ball,
            pitch=pitch,
            angle=angle,
            osculation=groove,
            modulus=modulus,
            clearance=self.clearance,
        )
        return me.ball_bearing(contacts, self._force, self.arrangement, self.spacing)


class RollerBearing(_Rotary):
    """A bearing of cylindrical `rollers`, free along its axis, or of crossed ones.

    A negative (diametral) `clearance` preloads it. Data-sheet stiffness may be given instead; if
    given `at_load`, it varies with the load to the power 1/10.
    """

    kind: Literal["cylindrical-roller", "crossed-roller"]
    rollers: v.Some | None = None
    length: v.Length | None = None
    pitch: v.Length | None = None
    clearance: v.Coordinate = 0.0

    def element(self) -> me.MachineElement:
        """See `ElementSection`."""
        if self._by_sheet:
            return self._of_sheet(LINE)
        rollers, length, pitch = self._need("rollers", "length", "pitch")
        make = (
            me.roller_bearing
            if self.kind == "cylindrical-roller"
            else me.crossed_roller
        )
        return make(rollers, length, pitch, self.clearance, self._force)


class LinearGuide(ElementSection):
    """Carriages on rails, each by its stiffness or its balls.

    Stiffness `vertical` along `normal`, `lateral`, and of rotations; or four rows of `balls` loaded
    ones each, `width` and `height` apart and `length` long, with the `preload` that presses upper
    rows against lower ones. `normal` points away from the rails, base axes; default: the joint's z.
    """

    sheet = ("vertical", "lateral", "roll", "tilt", "yaw")
    beside = ("rails", "rail_spacing", "carriages", "carriage_spacing", "normal")

    kind: Literal["linear-guide"]
    vertical: v.Stiffness | None = None
    lateral: v.Stiffness | None = None
    roll: v.Torsion | None = None
    tilt: v.Torsion | None = None
    yaw: v.Torsion | None = None
    balls: v.Some | None = None
    ball: v.Length | None = None
    width: v.Length | None = None
    height: v.Length | None = None
    length: v.Length | None = None
    angle: v.Angle = np.pi / 4
    osculation: Osculation = (0.52, 0.52)
    preload: v.Preload | None = None
    arrangement: Literal["back-to-back", "face-to-face"] = "back-to-back"
    rails: v.Some = 1
    rail_spacing: v.LengthOrZero = 0.0
    carriages: v.Some = 1
    carriage_spacing: v.LengthOrZero = 0.0
    normal: v.Direction | None = None

    def turn(self, axes: np.ndarray) -> np.ndarray:
        """See `ElementSection`."""
        if self.normal is None:
            return np.eye(3)
        across = axes.T @ np.cross(self.normal, axes[:, 0])
        size = np.linalg.norm(across)
        require(
            size >= PARALLEL * np.linalg.norm(self.normal),
            "bearing.normal",
            "a direction across the joint's axis",
            f"one along it, {list(self.normal)}",
        )
        _, c, s = across / size
        return np.array(
            [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
        )  # its zeros are exact: x stays free

    def element(self) -> me.MachineElement:
        """See `ElementSection`."""
        rails = (self.rails, self.rail_spacing)
        carriages = (self.carriages, self.carriage_spacing)
        for key, (count, spacing) in {
            "rail_spacing": rails,
            "carriage_spacing": carriages,
        }.items():
            require(
                count == 1 or spacing,
                key,
                f"the distance of one of {count} from the next",
                "none",
            )
        if self._by_sheet or self.balls is None:
            vertical, lateral = self._need("vertical", "lateral")
            each = (
                0.0,
                lateral,
                vertical,
                self.roll or 0.0,
                self.tilt or 0.0,
                self.yaw or 0.0,
            )
            for key, others in {
                "roll": "rails",
                "tilt": "carriages",
                "yaw": "carriages",
            }.items():
                require(
                    getattr(self, key) or getattr(self, others) > 1,
                    key,
                    f"a carriage's own beside one of {others}",
                    "nothing",
                )
            source = "the sheet's own stiffness of one carriage"
            return me.guide_of_sheet(each, rails, carriages, source)
        keys = ("ball", "width", "height", "length", "preload")
        ball, width, height, length, preload = self._need(*keys)
        contacts = me.carriage_contacts(
            count=self.balls,
            diameter=ball,
            osculation=self.osculation[0],
            angle=self.angle,
            width=width,
            height=height,
            length=length,
            preload=preload,
            modulus=me.reduced_modulus(),
            face_to_face=self.arrangement == "face-to-face",
        )
        return me.guide_of_balls(contacts, rails, carriages)


class BallScrew(ElementSection):
    """A screw along a driven slide, in series with its drive: shaft, `nut`, `support`, else rigid.

    `diameter` is the shaft's root diameter; `length` is from the support to the nut, or between the
    supports with `both_ends` (nut in the middle). With a `lead` the shaft's torsion counts too. Or
    the sheet's `axial` stiffness.
    """

    sheet = ("axial",)

    kind: Literal["ball-screw"]
    axial: v.Stiffness | None = None
    diameter: v.Length | None = None
    length: v.Length | None = None
    nut: v.Stiffness | None = None
    support: v.Stiffness | None = None
    both_ends: v.Flag = False
    lead: v.LengthOrZero = 0.0

    def element(self) -> me.MachineElement:
        """See `ElementSection`."""
        if self.axial is not None:
            return me.of_sheet(0.0, self.axial, 0.0, "the sheet's own stiffness")
        diameter, length = self._need("diameter", "length")
        nut = self.nut or np.inf
        support = self.support or np.inf
        both = self.both_ends
        return me.ball_screw(
            diameter, length, nut, support, both_ends=both, lead=self.lead
        )


_MODELS = (BallBearing, RollerBearing, LinearGuide, BallScrew)
ELEMENTS: dict[str, type[ElementSection]] = {
    kind: model
    for model in _MODELS
    for kind in get_args(model.model_fields["kind"].annotation)
}


def _some(value: Any) -> Any:
    """Return one or several elements as a tuple, each of a known kind."""
    several = value if isinstance(value, list | tuple) else [value]
    for each in several:
        what = f"a table with a kind ({', '.join(ELEMENTS)})"
        require(isinstance(each, dict | ElementSection), "", what, q.show_value(each))
        if isinstance(each, dict):
            one_of(each.get("kind"), ELEMENTS, "a kind of bearing")
    require(several, "", "at least one bearing", "none")
    return tuple(several)


_EXAMPLE = 'a table such as { kind = "deep-groove", … }'
_KIND = Discriminator(lambda value: f"tagged-{ELEMENTS[dict(value)['kind']].__name__}")
if TYPE_CHECKING:
    AnyElement = ElementSection
else:
    _tagged = (
        Annotated[section, Tag(f"tagged-{section.__name__}")] for section in _MODELS
    )
    AnyElement = Annotated[Union[tuple(_tagged)], _KIND]  # noqa: UP007 (of a list)
Elements = Annotated[tuple[AnyElement, ...], BeforeValidator(_some), Says(_EXAMPLE)]


def read_element(path: Path, text: str) -> ElementSection:
    """Read an element from its own file; raise InputError with file, line and field if invalid."""
    data = parse_text(path, text, "a file of an element")
    with Source(path, text).refusing():
        with naming_key("kind"):
            kind = one_of(data.get("kind"), ELEMENTS, "a kind of element")
        return read_table(ELEMENTS[kind], data, ())
