"""Assemblies with known joints, modelled in build123d: each returns its solids by name and the joints between them.

A joint is (first, second, kind, place, axis): mm, its own axes; place and axis are None where any will do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import build123d as b
import numpy as np
from OCP.Interface import Interface_Static
from OCP.STEPControl import STEPControl_Controller

from examples.assembly import five_bar as example

if TYPE_CHECKING:
    from pathlib import Path

LOW = (b.Align.CENTER, b.Align.CENTER, b.Align.MIN)
TOP = (b.Align.CENTER, b.Align.CENTER, b.Align.MAX)
X, Y, Z = np.eye(3)


@dataclass
class Made:
    """Solids by name, joints, and the names of hardware."""

    solids: dict[str, Any] = field(default_factory=dict)
    joints: list[tuple[str, str, str, Any, Any]] = field(default_factory=list)
    hardware: set[str] = field(default_factory=set)

    def add(self, name: str, solid: Any) -> None:
        """A part."""
        self.solids[name] = solid.solid()

    def buy(self, name: str, solid: Any) -> None:
        """A piece of hardware."""
        self.add(name, solid)
        self.hardware.add(name)

    def join(
        self, first: str, second: str, kind: str, at: Any = None, axis: Any = None
    ) -> None:
        """A joint that is to be found."""
        self.joints.append(
            (first, second, kind, None if at is None else np.asarray(at, float), axis)
        )

    def write(
        self, path: Path, unit: str = "MM", place: Any = None, named: bool = True
    ) -> None:
        """A STEP file of the assembly at a place (a build123d Location), its lengths in MM, INCH or M."""
        children = []
        for name, solid in self.solids.items():
            child = (
                b.Solid(solid.wrapped)
                if place is None
                else place * b.Solid(solid.wrapped)
            )
            child.label = name if named else ""
            children.append(child)
        STEPControl_Controller.Init_s()  # else the first file of a process is in mm, whatever is set
        assert Interface_Static.SetCVal_s("write.step.unit", unit)
        b.export_step(
            b.Compound(label="machine" if named else "", children=children), path
        )
        Interface_Static.SetCVal_s("write.step.unit", "MM")


def at(solid: Any, point: Any, z: Any = Z, x: Any = None) -> Any:
    """A solid with its origin at a point and its z along a direction."""
    return (
        b.Plane(
            origin=tuple(point), z_dir=tuple(z), x_dir=None if x is None else tuple(x)
        ).location
        * solid
    )


def rod(radius: float, length: float) -> Any:
    """A cylinder from its origin along z."""
    return b.Cylinder(radius, length, align=LOW)


def ring(bore: float, radius: float, width: float) -> Any:
    """A ring from its origin along z."""
    return rod(radius, width) - rod(bore, width)


def screw(diameter: float, length: float) -> Any:
    """A cap screw: its head on the plane z = 0, its shank below."""
    return rod(0.75 * diameter, diameter) + b.Cylinder(
        0.5 * diameter, length, align=TOP
    )


def five_bar() -> Made:
    """The example of the guide: a plate frame on a screwed foot, two cranks on ball bearings, two couplers."""
    made = Made()
    links = {"crank_left", "crank_right", "coupler_left", "coupler_right"}
    for solid in example.build().children:
        (made.add if solid.label in {"frame", "foot", *links} else made.buy)(
            solid.label, solid
        )
    left, right, top = example.place_pins()
    made.join("frame", "foot", "fixed")
    for first, second, place in (
        ("frame", "crank_left", example.LEFT),
        ("frame", "crank_right", example.RIGHT),
        ("crank_left", "coupler_left", left),
        ("crank_right", "coupler_right", right),
        ("coupler_left", "coupler_right", top),
    ):
        made.join(first, second, "revolute", (*place, 0), Z)
    return made


def delta() -> Made:
    """Three arms on pins in a base, two rods with balls at both ends from each to a platform."""
    made = Made()
    base = rod(120, 15)
    platform = at(rod(50, 12), (0, 0, -300))
    for leg, angle in enumerate(np.deg2rad([0.0, 120.0, 240.0]), 1):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        side = np.array([-np.sin(angle), np.cos(angle), 0.0])
        hip = 100 * out - 20 * Z
        elbow = 220 * out - 40 * Z
        wrist = 60 * out - 294 * Z
        for sign in (-1.0, 1.0):
            base += at(
                b.Box(20, 8, 40, align=TOP), hip + sign * 14 * side + 20 * Z, Z, out
            )
        hole = at(rod(5, 80), hip - 40 * side, side)
        base -= hole
        along = (elbow - hip) / np.linalg.norm(elbow - hip)
        arm = at(
            b.Box(20, 20, float(np.linalg.norm(elbow - hip)), align=LOW),
            hip,
            along,
            side,
        )
        arm += at(rod(10, 90), elbow - 45 * side, side)
        arm -= hole
        platform += at(rod(10, 90), wrist - 45 * side, side)
        platform += at(b.Box(30, 20, 10), wrist - 15 * out, Z, out)
        for sign, rod_name in ((-1.0, "a"), (1.0, "b")):
            top = elbow + sign * 45 * side
            low = wrist + sign * 45 * side
            down = (low - top) / np.linalg.norm(low - top)
            length = float(np.linalg.norm(low - top))
            link = at(
                b.Sphere(6) + at(b.Sphere(6), (0, 0, length)) + rod(3, length),
                top,
                down,
            )
            arm -= (
                at(b.Sphere(6), top)
                + at(rod(5, 30), top, down)
                + at(rod(6, 10), top, sign * side)
            )
            platform -= (
                at(b.Sphere(6), low)
                + at(rod(5, 30), low, -down)
                + at(rod(6, 10), low, sign * side)
            )
            name = f"rod{leg}{rod_name}"
            made.add(name, link)
            made.join(f"arm{leg}", name, "spherical", top)
            made.join(name, "platform", "spherical", low)
        made.buy(f"axle{leg}", at(rod(5, 40), hip - 20 * side, side))
        arm -= at(b.Box(60, 60, 60), hip + 70 * Z)
        made.add(f"arm{leg}", arm)
        made.join("base", f"arm{leg}", "revolute", hip, side)
    made.add("base", base)
    made.add("platform", platform)
    return made


def _fork(made: Made, name: str, centre: Any, axis: Any, up: Any) -> Any:
    """A fork that holds the pins of a cross along an axis, its stem along `up`."""
    side = np.cross(up, axis)
    fork = at(rod(8, 20), centre + 14 * up, up)
    fork += at(b.Box(16, 36, 6, align=LOW), centre + 12 * up, up, side)
    for sign in (-1.0, 1.0):
        fork += at(b.Box(12, 6, 24), centre + 3 * up + sign * 15 * axis, up, side)
    return fork - at(rod(3, 80), centre - 40 * axis, axis)


def _cross(made: Made, name: str, centre: Any, one: Any, two: Any) -> None:
    body = at(b.Box(12, 12, 12), centre, np.cross(one, two), one)
    for axis in (one, two):
        body += at(rod(3, 36), centre - 18 * axis, axis)
        for sign in (-1.0, 1.0):
            body += at(rod(6, 6), centre + 6 * sign * axis, sign * axis)
    made.add(name, body)


def hexapod() -> Made:
    """Six legs, a rod in a tube each, with crosses between forks at either end."""
    made = Made()
    base = at(rod(130, 10), (0, 0, -70))
    platform = at(rod(110, 10), (0, 0, 260))
    for leg in range(6):
        turn = np.deg2rad(60 * (leg // 2) * 2 + (-12 if leg % 2 else 12))
        turn2 = np.deg2rad(60 * (leg // 2) * 2 + (-48 if leg % 2 else 48))
        low = np.array([100 * np.cos(turn), 100 * np.sin(turn), -26.0])
        high = np.array([80 * np.cos(turn2), 80 * np.sin(turn2), 226.0])
        up = (high - low) / np.linalg.norm(high - low)
        one = np.cross(Z, up) / np.linalg.norm(np.cross(Z, up))
        two = np.cross(up, one)
        length = float(np.linalg.norm(high - low))
        base += _fork(made, "", low, one, -Z)
        platform += _fork(made, "", high, one, Z)
        tube = _fork(made, "", low, two, up) + at(ring(5, 8, 110), low + 34 * up, up)
        bar_ = _fork(made, "", high, two, -up) + at(
            rod(5, length - 100), high - 34 * up, -up
        )
        tube -= at(rod(5, 200), low + 34 * up, up)
        made.add(f"tube{leg}", tube)
        made.add(f"rod{leg}", bar_)
        for end, centre, part in (("low", low, "base"), ("high", high, "platform")):
            cross = f"cross{leg}{end}"
            _cross(made, cross, centre, one, two)
            made.join(part, cross, "revolute", centre, one)
            made.join(
                cross,
                f"{'tube' if end == 'low' else 'rod'}{leg}",
                "revolute",
                centre,
                two,
            )
        made.join(f"tube{leg}", f"rod{leg}", "cylindrical", low, up)
    made.add("base", base)
    made.add("platform", platform)
    return made


def _rail(length: float) -> Any:
    """A profiled rail along x, its foot on z = 0."""
    with b.BuildPart() as part:
        with b.BuildSketch(b.Plane.YZ.offset(-0.5 * length)):
            b.Polygon(
                (-8, 0),
                (8, 0),
                (8, 6),
                (5, 9),
                (8, 12),
                (8, 15),
                (-8, 15),
                (-8, 12),
                (-5, 9),
                (-8, 6),
                align=None,
            )
        b.extrude(amount=length)
    return part.part


def _carriage() -> Any:
    """A carriage on such a rail, 40 long, its top at z = 24."""
    with b.BuildPart() as part:
        with b.BuildSketch(b.Plane.YZ.offset(-20)):
            b.Polygon(
                (-8, 4),
                (-8, 6),
                (-5, 9),
                (-8, 12),
                (-8, 15),
                (8, 15),
                (8, 12),
                (5, 9),
                (8, 6),
                (8, 4),
                (22, 4),
                (22, 24),
                (-22, 24),
                (-22, 4),
                align=None,
            )
        b.extrude(amount=40)
    return part.part


def slider() -> Made:
    """A plate on four carriages on two rails on a bed, all screwed."""
    made = Made()
    bed = b.Box(400, 240, 30, align=TOP)
    plate = at(b.Box(240, 200, 12, align=LOW), (0, 0, 24))
    for number, y in enumerate((-70.0, 70.0)):
        track = at(_rail(400), (0, y, 0))
        for x in (-160.0, 0.0, 160.0):
            track -= at(rod(2.25, 40), (x, y, -10)) + at(rod(4, 10), (x, y, 10))
            bed -= at(rod(1.65, 15), (x, y, -15))
            made.buy(f"rail{number}_screw{x:g}", at(screw(4, 20), (x, y, 10)))
        made.add(f"rail{number}", track)
        made.join("bed", f"rail{number}", "fixed")
        for x in (-80.0, 80.0):
            name = f"carriage{number}{'+' if x > 0 else '-'}"
            carriage = at(_carriage(), (x, y, 0))
            for side in (-15.0, 15.0):
                carriage -= at(rod(2.1, 8), (x, y + side, 16))
                plate -= at(rod(2.75, 40), (x, y + side, 0))
                made.buy(f"{name}_screw{side:g}", at(screw(5, 19), (x, y + side, 36)))
            made.add(name, carriage)
            made.join(f"rail{number}", name, "prismatic", None, X)
            made.join(name, "plate", "fixed")
    made.add("bed", bed)
    made.add("plate", plate)
    return made


def three_prs() -> Made:
    """Three carriages on upright rails, legs on pins in their forks, balls in a platform."""
    made = Made()
    base = rod(160, 15) - rod(60, 15)
    platform = at(rod(70, 12), (0, 0, 260))
    for leg, angle in enumerate(np.deg2rad([0.0, 120.0, 240.0]), 1):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        side = np.array([-np.sin(angle), np.cos(angle), 0.0])
        foot = 140 * out
        place = b.Plane(
            origin=tuple(foot + 115 * Z), z_dir=tuple(-out), x_dir=(0, 0, 1)
        ).location
        base += place * _rail(230)
        base += at(b.Box(12, 30, 230, align=LOW), foot + 6 * out, Z, out)
        carriage = (
            b.Plane(
                origin=tuple(foot + 90 * Z), z_dir=tuple(-out), x_dir=(0, 0, 1)
            ).location
            * _carriage()
        )
        hip = 105 * out + 90 * Z
        ball = 50 * out + 256 * Z
        for sign in (-1.0, 1.0):
            carriage += at(b.Box(24, 6, 20), hip + sign * 9 * side, Z, out)
        hole = at(rod(4, 60), hip - 30 * side, side)
        along = (ball - hip) / np.linalg.norm(ball - hip)
        link = at(
            b.Box(12, 12, float(np.linalg.norm(ball - hip)), align=LOW),
            hip,
            along,
            side,
        ) + at(b.Sphere(9), ball)
        platform -= at(b.Sphere(9), ball) + at(
            b.Box(20, 20, 30, align=LOW), ball, -along
        )
        made.add(f"carriage{leg}", carriage - hole)
        made.add(f"leg{leg}", link - hole)
        made.buy(f"pin{leg}", at(rod(4, 24), hip - 12 * side, side))
        made.join("base", f"carriage{leg}", "prismatic", None, Z)
        made.join(f"carriage{leg}", f"leg{leg}", "revolute", hip, side)
        made.join(f"leg{leg}", "platform", "spherical", ball)
    made.add("base", base)
    made.add("platform", platform)
    return made


def finger() -> Made:
    """A palm, a finger of one solid with two notch flexures, and a pad, screwed."""
    made = Made()
    palm = b.Box(60, 60, 15, align=TOP)
    body = b.Box(16, 20, 90, align=LOW) + at(b.Box(40, 20, 8, align=LOW), (0, 0, 0))
    for z in (25.0, 55.0):
        for x in (-8.0, 8.0):
            body -= at(rod(7, 40), (x, -20, z), Y)
    pad = at(b.Box(6, 20, 20), (11, 0, 76))
    for x in (-14.0, 14.0):
        palm -= at(rod(1.65, 12), (x, 0, -12))
        body -= at(rod(2.25, 20), (x, 0, -5))
        made.buy(f"M4x16{x:g}", at(screw(4, 16), (x, 0, 8)))
    body -= at(rod(1.25, 10), (-2, 0, 76), X)
    pad -= at(rod(1.7, 20), (0, 0, 76), X)
    made.buy("M3x10", at(screw(3, 10), (14, 0, 76), X))
    made.add("palm", palm)
    made.add("finger", body)
    made.add("pad", pad)
    made.join("palm", "finger", "fixed")
    made.join("finger", "pad", "fixed")
    return made


def hexagon(flats: float, height: float) -> Any:
    return b.extrude(b.RegularPolygon(flats / np.sqrt(3.0), 6), height)


def lever() -> Made:
    """An axle bolted on a plate with a lever on it behind a circlip, 0.1 mm of play on either side of the lever."""
    made = Made()
    axle = (
        rod(6, 20)
        + rod(9, 4)
        + b.Cylinder(4, 22, align=TOP)
        - at(ring(5.5, 8, 1.2), (0, 0, 14.2))
    )
    made.add("Platte", b.Box(80, 60, 10, align=TOP) - at(rod(4.2, 30), (0, 0, -20)))
    made.add("Achse", axle)
    made.add(
        "Hebel",
        at(b.Box(90, 20, 10, align=LOW), (30, 0, 4.1)) - at(rod(6.05, 40), (0, 0, -5)),
    )
    made.buy(
        "Ring", at(ring(5.5, 8, 1.2) - at(b.Box(16, 3.3, 4), (8, 0, 0)), (0, 0, 14.2))
    )
    made.buy("Scheibe", at(ring(4.2, 8, 1.6), (0, 0, -11.6)))
    made.buy("Mutter", at(hexagon(13, 6.5) - rod(4, 20), (0, 0, -18.1)))
    made.join("Platte", "Achse", "fixed")
    made.join("Achse", "Hebel", "revolute", (0, 0, 0), Z)
    return made


def dovetail() -> Made:
    """A slide on a dovetail with 0.1 mm of play, a plate on it with hexagon bolts and countersunk screws, both through.

    The bolts' nuts stand below the slide; a clevis pin with a head joins the plate and a link.
    """
    made = Made()
    with b.BuildPart() as bed:
        with b.BuildSketch(b.Plane.YZ.offset(-100)):
            b.Polygon(
                (-60, -20),
                (60, -20),
                (60, 0),
                (15, 0),
                (22, 12),
                (-22, 12),
                (-15, 0),
                (-60, 0),
                align=None,
            )
        b.extrude(amount=200)
    with b.BuildPart() as slide:
        with b.BuildSketch(b.Plane.YZ.offset(-30)):
            b.Polygon(
                (-50, 0.1),
                (-15.12, 0.1),
                (-22.12, 12.1),
                (22.12, 12.1),
                (15.12, 0.1),
                (50, 0.1),
                (50, 30),
                (-50, 30),
                align=None,
            )
        b.extrude(amount=60)
    block = slide.part
    plate = at(b.Box(60, 140, 8, align=LOW), (0, 0, 30))
    block -= at(b.Box(60, 24, 20, align=LOW), (0, -40, 0)) + at(
        b.Box(60, 24, 20, align=LOW), (0, 40, 0)
    )
    for x in (-20.0, 20.0):
        block -= at(rod(3.3, 60), (x, 40, 0)) + at(rod(2.1, 60), (x, -40, 0))
        plate -= at(rod(3.3, 60), (x, 40, 0)) + at(
            b.Cone(2.75, 5.5, 2.75, align=TOP), (x, -40, 38)
        )
        plate -= at(rod(2.75, 60), (x, -40, 0))
        made.buy(
            f"bolt{x:g}", at(hexagon(10, 4) + b.Cylinder(3, 26, align=TOP), (x, 40, 38))
        )
        made.buy(f"nut{x:g}", at(hexagon(10, 5) - rod(3, 20), (x, 40, 15)))
        sunk = b.Cone(2.5, 5, 2.5, align=TOP) + b.Cylinder(2.5, 16, align=TOP)
        made.buy(f"sunk{x:g}", at(sunk, (x, -40, 37.75)))
    link = at(b.Box(20, 80, 6, align=LOW), (0, 90, 38)) - at(rod(4.05, 60), (0, 62, 0))
    plate -= at(rod(4.05, 60), (0, 62, 0))
    made.buy("clevis", at(rod(4, 14) + at(rod(6.5, 2), (0, 0, 14)), (0, 62, 30)))
    made.add("bed", bed.part)
    made.add("slide", block)
    made.add("plate", plate)
    made.add("link", link)
    made.join("bed", "slide", "prismatic", None, X)
    made.join("slide", "plate", "fixed")
    made.join("plate", "link", "revolute", (0, 62, 0), Z)
    return made


def gears() -> Made:
    """Two wheels on studs of a plate, side by side: their rims touch, which is no joint."""
    made = Made()
    plate = b.Box(200, 100, 10, align=TOP)
    for name, x in (("wheel_a", -30.0), ("wheel_b", 30.0)):
        plate += at(rod(6, 20), (x, 0, 0))
        made.add(name, at(rod(30, 12) - rod(6, 12), (x, 0, 0)))
        made.join("plate", name, "revolute", (x, 0, 0), Z)
    made.add("plate", plate)
    return made


def shoulder() -> Made:
    """An arm on a shoulder screw, its thread in a tapped hole."""
    made = Made()
    bolt = (
        rod(9, 6)
        + b.Cylinder(6, 10.2, align=TOP)
        + at(b.Cylinder(5, 12, align=TOP), (0, 0, -10.2))
    )
    made.add(
        "base",
        b.Box(80, 60, 20, align=TOP) - at(b.Cylinder(4.25, 14, align=TOP), (0, 0, 1)),
    )
    made.add("arm", at(b.Box(120, 30, 10, align=LOW), (40, 0, 0)) - rod(6.01, 40))
    made.buy("bolt", at(bolt, (0, 0, 10.2)))
    made.join("base", "arm", "revolute")
    return made


def case() -> Made:
    """A case of three pieces, whose screws are missing, with a horn on the shaft in its lid."""
    made = Made()
    holes = [at(rod(0.8, 9), (x, y, 0)) for x in (-17.0, 17.0) for y in (-8.5, 8.5)]
    made.add("bottom", b.Box(40, 20, 8, align=LOW) - holes)
    made.add(
        "middle",
        at(b.Box(40, 20, 20, align=LOW) - b.Box(30, 12, 80), (0, 0, 8))
        - [at(h, (0, 0, 8)) for h in holes],
    )
    made.add("lid", at(b.Box(40, 20, 8, align=LOW) - rod(4, 20), (0, 0, 28)))
    made.add(
        "horn",
        at(
            rod(4, 8)
            + at(rod(10, 4), (0, 0, 8))
            + at(b.Box(30, 8, 4, align=LOW), (0, 0, 8)),
            (0, 0, 28),
        ),
    )
    for first, second, kind in (
        ("bottom", "middle", "fixed"),
        ("middle", "lid", "fixed"),
        ("lid", "horn", "revolute"),
    ):
        made.join(first, second, kind)
    return made


def ball_stud() -> Made:
    """A ball stud, its thread in a tapped hole, in the socket of a rod end with a thread in a rod and a lock nut."""
    made = Made()
    end = (
        b.Sphere(13)
        + rod(7, 18)
        - b.Sphere(8)
        - at(b.Cylinder(10, 30, align=TOP), (0, 0, -3.5))
    )
    made.add(
        "plate",
        at(b.Box(60, 60, 15, align=TOP), (0, 0, -16))
        - at(b.Cylinder(3.4, 12, align=TOP), (0, 0, -16)),
    )
    made.add(
        "stud",
        b.Sphere(8) + b.Cylinder(4, 27, align=TOP) + at(rod(6.5, 4), (0, 0, -16)),
    )
    made.add("end", end + at(rod(4, 18), (0, 0, 18)))
    made.buy("nut", at(hexagon(13, 5) - rod(4, 9), (0, 0, 19)))
    made.add("rod", at(rod(7.5, 90) - rod(3.4, 60), (0, 0, 24)))
    for first, second, kind in (
        ("plate", "stud", "fixed"),
        ("stud", "end", "spherical"),
        ("end", "rod", "fixed"),
    ):
        made.join(first, second, kind)
    return made


def bushed() -> Made:
    """A stud in a crank, a flanged bushing in a coupler on it, a circlip at its end."""
    made = Made()
    made.add("crank", b.Box(90, 22, 16, align=TOP) - at(rod(5, 20), (0, 0, -18)))
    made.buy("stud", at(rod(5, 28), (0, 0, -16)) - at(ring(4.2, 6, 1.1), (0, 0, 10.1)))
    made.buy("bush", ring(5, 7, 10) + ring(5, 10, 1))
    made.add("coupler", at(b.Box(90, 22, 9, align=LOW), (30, 0, 1)) - rod(7, 20))
    made.buy("clip", at(ring(4.2, 8, 1) - at(b.Box(16, 4, 4), (8, 0, 0)), (0, 0, 10.1)))
    made.join("crank", "coupler", "revolute", (0, 0, 0), Z)
    return made


def spindle() -> Made:
    """A flanged shaft in two bearings with a ring between them, under a lid whose small screws have coarse holes.

    A washer and a screw hold the lower bearing: with the lid's screws they are no bearing of rings and rollers.
    """
    made = Made()
    lid = at(ring(15, 26, 3.5), (0, 0, 30))
    house = b.Box(80, 80, 30, align=LOW) - rod(16, 30)
    for number, turn in enumerate(np.deg2rad([0, 120, 240])):
        x = 21.5 * np.cos(turn)
        y = 21.5 * np.sin(turn)
        house -= at(rod(0.8, 9), (x, y, 22))
        lid -= at(rod(1.3, 9), (x, y, 28))
        made.buy(f"screw{number}", at(screw(2, 9), (x, y, 33.5)))
    made.add("house", house)
    made.add("lid", lid)
    made.add(
        "shaft",
        at(rod(9, 29), (0, 0, 1))
        + at(rod(11.5, 5), (0, 0, 30))
        + at(rod(30, 8), (0, 0, 35))
        - rod(2.1, 14),
    )
    for z in (0.0, 21.0):
        made.buy(f"ring{z:g}", at(ring(9, 16, 9), (0, 0, z)))
    made.buy("spacer", at(ring(13, 16, 12), (0, 0, 9)))
    made.buy("washer", at(ring(2.7, 12, 2), (0, 0, -1)))
    made.buy("end", at(screw(5, 12), (0, 0, -1), -Z))
    made.join("house", "lid", "fixed")
    made.join("house", "shaft", "revolute", (0, 0, 0), Z)
    return made


def slotted(bore: float, radius: float, width: float) -> Any:
    """A round nut with four slots, its thread drawn with the radius of its bore."""
    slot = b.Box(0.4 * radius, 0.3 * radius, 3 * width)
    ways = ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))
    return ring(bore, radius, width) - [
        at(slot, radius * np.array(way), Z, way) for way in ways
    ]


def locked() -> Made:
    """A shaft in a bearing that a slotted round nut holds on it, its thread of the bearing's radius."""
    made = Made()
    made.add("house", b.Box(80, 80, 30, align=LOW) - rod(23.5, 30))
    made.add("shaft", rod(10, 60) + at(rod(14, 20), (0, 0, -20)))
    made.buy("bearing", ring(10, 23.5, 14))
    made.buy("piece", at(slotted(10, 16, 6), (0, 0, 14)))
    made.join("house", "shaft", "revolute", (0, 0, 0), Z)
    return made


def gib() -> Made:
    """A slide on a dovetail, one side of which is a strip that a screw without a head holds in the slide."""
    made = Made()

    def extrude(length: float, *points: tuple[float, float]) -> Any:
        with b.BuildPart() as part:
            with b.BuildSketch(b.Plane.YZ.offset(-0.5 * length)):
                b.Polygon(*points, align=None)
            b.extrude(amount=length)
        return part.part

    bed = (
        (-90, -40),
        (90, -40),
        (90, 0),
        (35, 0),
        (47, 20),
        (-47, 20),
        (-35, 0),
        (-90, 0),
    )
    slide = (
        (-85, 0),
        (-35, 0),
        (-47, 20),
        (55, 20),
        (43, 0),
        (85, 0),
        (85, 35),
        (-85, 35),
    )
    made.add("bed", extrude(400, *bed))
    made.add("slide", extrude(160, *slide) - at(rod(2.5, 60), (0, 40, 10), Y))
    made.add(
        "strip",
        extrude(160, (35, 0), (43, 0), (55, 20), (47, 20))
        - at(rod(2.6, 30), (0, 45, 10), Y),
    )
    made.buy("grub", at(rod(3, 22), (0, 55, 10), Y) + at(rod(2.5, 10), (0, 46, 10), Y))
    made.join("bed", "slide", "prismatic", None, X)
    made.join("bed", "strip", "prismatic", None, X)
    made.join("slide", "strip", "fixed")
    return made


def column() -> Made:
    """A headed shaft with a hexagon nut in a bearing, which a turned housing and a circlip in its groove hold."""
    made = Made()
    made.add(
        "house", rod(30, 40) - rod(17, 13) - rod(12, 60) - at(rod(18, 1), (0, 0, 12))
    )
    made.buy("bearing", ring(8, 17, 12))
    made.buy("clip", at(ring(14, 18, 1) - at(b.Box(16, 6, 4), (16, 0, 0)), (0, 0, 12)))
    made.add("shaft", at(rod(8, 30), (0, 0, -1)) + at(rod(20, 10), (0, 0, -11)))
    made.buy("piece", at(hexagon(24, 10) - rod(8, 30), (0, 0, 12)))
    made.join("house", "shaft", "revolute", (0, 0, 0), Z)
    return made


def drive() -> Made:
    """A carriage on a rod in a bushing between circlips; a nut of a spindle on it with screws of rounded heads."""
    made = Made()
    bores = [at(rod(12, 60), (0, 50, -9)), at(rod(14, 60), (0, -30, -9))]
    carriage = b.Box(60, 140, 40, align=LOW) - bores
    nut = rod(14, 40) + at(rod(26, 8), (0, 0, 40)) - at(rod(8, 99), (0, 0, -9))
    for number, (x, y) in enumerate(((20, 0), (0, 20), (-20, 0), (0, -20))):
        nut = nut - at(rod(2.7, 9), (x, y, 40))
        carriage = carriage - at(rod(2.1, 20), (x, y - 30, 25))
        head = at(b.Sphere(6) - at(b.Box(20, 20, 20, align=TOP), (0, 0, 2)), (0, 0, -2))
        made.buy(
            f"piece{number}", at(head + b.Cylinder(2.5, 20, align=TOP), (x, y - 30, 48))
        )
    made.buy("bush", at(ring(8, 12, 30), (0, 50, 5)))
    for z in (3.5, 35.0):
        carriage -= at(rod(13, 1.5), (0, 50, z))
        made.buy(
            f"clip{z:g}",
            at(ring(10, 13, 1.5) - at(b.Box(16, 4, 9), (12, 0, 0)), (0, 50, z)),
        )
    made.add("nut", at(nut, (0, -30, 0)))
    made.add("spindle", at(rod(8, 300), (0, -30, -150)))
    made.add("guide", at(rod(8, 300), (0, 50, -150)))
    made.add("carriage", carriage)
    made.join("nut", "carriage", "fixed")
    made.join("nut", "spindle", "cylindrical", (0, -30, 0), Z)
    made.join("guide", "carriage", "cylindrical", (0, 50, 0), Z)
    return made


def jackshaft() -> Made:
    """A plain shaft in bearings of two housings on a plate, one of rings and balls."""
    made = Made()
    plate = b.Box(240, 100, 12, align=TOP)
    for name, x in (("left", -50), ("right", 50)):
        house = at(b.Box(12, 60, 70, align=LOW), (x, 0, 0)) - at(
            rod(14, 30), (x - 15, 0, 40), X
        )
        for y in (-22, 22):
            house = house - at(rod(2.5, 14), (x, y, 0))
            plate = plate - at(rod(3.3, 40), (x, y, -30))
            made.buy(f"screw {name} {y}", at(screw(6, 24), (x, y, -12), -Z))
        made.add(name, house)
        made.join("plate", name, "fixed")
        made.join(name, "shaft", "revolute", (0, 0, 40), X)
    made.buy("bearing", at(ring(6, 14, 8), (-54, 0, 40), X))
    groove = at(b.Torus(10, 2.05), (50, 0, 40), X)
    made.buy("inner", at(ring(6, 8.6, 8), (46, 0, 40), X) - groove)
    made.buy("outer", at(ring(11.4, 14, 8), (46, 0, 40), X) - groove)
    for number, turn in enumerate(np.deg2rad(range(0, 360, 45))):
        made.buy(
            f"ball {number}",
            at(b.Sphere(2), (50, 10 * np.cos(turn), 40 + 10 * np.sin(turn))),
        )
    made.add("shaft", at(rod(6, 130), (-65, 0, 40), X))
    made.add("plate", plate)
    return made


SMALL = (
    shoulder,
    case,
    ball_stud,
    bushed,
    spindle,
    gib,
    locked,
    column,
    drive,
    jackshaft,
)
ALL = {
    "five-bar": five_bar,
    "delta": delta,
    "hexapod": hexapod,
    "slider": slider,
    "3-prs": three_prs,
    "finger": finger,
}
ALL |= {"lever": lever, "dovetail": dovetail, "gears": gears}


def _box(x: Any, y: Any, z: Any) -> Any:
    """A box between two numbers along each axis."""
    low, high = np.array([x, y, z], float).T
    return b.Pos(*((low + high) / 2)) * b.Box(*(high - low))


def _along_y(radius: float, x: float, z: float, y: Any) -> Any:
    """A cylinder along y between two numbers."""
    cylinder = b.Rot(90, 0, 0) * b.Cylinder(radius, y[1] - y[0])
    return b.Pos(x, sum(y) / 2, z) * cylinder


def gantry() -> Made:
    """A cross table: rails screwed to a base, carriages, a beam, two rods of 10 mm in blocks, a head."""
    made = Made()
    base = _box((-200, 200), (-150, 150), (-30, 0))
    beam = _box((-30, 30), (-140, 140), (28, 68))
    for k, y in enumerate((-110, 110), 1):

        def profile(length: float, y: float = y) -> Any:
            half = length / 2
            rail = _box((-half, half), (y - 7.5, y + 7.5), (0, 15))
            for side in ((y - 7.5, y - 5.5), (y + 5.5, y + 7.5)):
                rail -= _box((-half, half), side, (6, 10))
            return rail

        rail = profile(380)
        for x in (-150, 0, 150):
            rail -= b.Pos(x, y, 7.5) * b.Cylinder(2.25, 15)
            base -= b.Pos(x, y, -10) * b.Cylinder(2, 20)
            screw_ = b.Pos(x, y, 2.5) * b.Cylinder(2, 25)
            made.buy(
                f"screw_rail{k}_{x}", screw_ + b.Pos(x, y, 16.5) * b.Cylinder(3.5, 3)
            )
        made.add(f"rail_x{k}", rail)
        carriage = _box((-30, 30), (y - 17, y + 17), (5, 28)) - profile(60)
        carriage -= _box((-30, 30), (y - 5.5, y + 5.5), (0, 15))
        for x in (-20, 20):
            carriage -= b.Pos(x, y, 24) * b.Cylinder(2.1, 8)
            beam -= b.Pos(x, y, 48) * b.Cylinder(2.6, 40)
            screw_ = b.Pos(x, y, 44) * b.Cylinder(2.1, 48)
            made.buy(f"screw_beam{k}_{x}", screw_ + b.Pos(x, y, 70) * b.Cylinder(4, 4))
        made.add(f"carriage_x{k}", carriage)
    made.add("base", base)
    made.add("beam", beam)
    for k, y in enumerate((-130, 130), 1):
        block = _box((30, 60), (y - 10, y + 10), (28, 68))
        for z in (36, 60):
            block -= _along_y(5, 45, z, (y - 10, y + 10))
        made.add(f"endblock{k}", block)
    head = _box((32, 90), (-25, 25), (30, 66))
    for k, z in enumerate((36, 60), 1):
        made.add(f"rod{k}", _along_y(5, 45, z, (-140, 140)))
        head -= _along_y(5.02, 45, z, (-25, 25))
    made.add("head", head)
    return made
