"""Parts with known answers: exact ones where elasticity has them, theory with its reach where it has not.

NO_POISSON makes clamped ends harmless: pure stretch and pure bending of a straight bar are then exact, whatever
its section, and so are C11, C55, C66 and (Maxwell and Betti) C26 and C35. Torsion of round bars is exact for any ν.
"""

from math import cos, log, pi, sin

import numpy as np

from stiffscope.cad import kernel, link, slider
from stiffscope.cad.faces import FaceSelector
from stiffscope.cad.materials import CFRP_TUBE, STEEL, Material
from stiffscope.cad.solid import build, part_of

NO_POISSON = Material("no-poisson", 200e9, 100e9, 7800.0)


def revolved(profile):
    """Solid of revolution about x of a closed polygon of (x, r) in m."""
    from build123d import Axis, Polyline, make_face, revolve

    corners = [(1e3 * x, 1e3 * r) for x, r in profile]
    return revolve(make_face(Polyline(*corners, close=True)), Axis.X).solid()


def box(low, high):
    from build123d import Align, Box, Pos

    size = [1e3 * (b - a) for a, b in zip(low, high, strict=True)]
    return Pos(*(1e3 * value for value in low)) * Box(*size, align=(Align.MIN,) * 3)


def bar(radius=0.0125, bore=0.0, length=0.2, material=NO_POISSON):
    part = build(link.LinkParameters(length, radius, bore), material)
    inner = bore / 2
    area = pi * (radius**2 - inner**2)
    second = pi * (radius**4 - inner**4) / 4
    exact = {(3, 3): length / (material.shear_modulus * 2 * second)}
    if material is NO_POISSON:
        exact |= _straight(length, material.youngs_modulus, area, second, second)
    return part, exact


def plate(depth=0.085, width=0.32, thickness=0.02):
    part = build(slider.SliderParameters(depth, width, thickness), NO_POISSON)
    about_y = width * thickness**3 / 12
    about_z = thickness * width**3 / 12
    return part, _straight(
        depth, NO_POISSON.youngs_modulus, width * thickness, about_y, about_z
    )


def _straight(length, E, area, about_y, about_z):
    return {
        (0, 0): length / (E * area),
        (4, 4): length / (E * about_y),
        (5, 5): length / (E * about_z),
        (1, 5): length**2 / (2 * E * about_z),
        (2, 4): -(length**2) / (2 * E * about_y),
    }


def stepped(thick=0.020, thin=0.0125, first=0.1, second=0.1, material=STEEL):
    """A shaft with one step: the sums over its halves, which a step makes a little more (see ``test_parts``)."""
    profile = [
        (0, 0),
        (0, thick),
        (first, thick),
        (first, thin),
        (first + second, thin),
        (first + second, 0),
    ]
    part = part_of(revolved(profile), name="stepped bar", material=material)
    E = material.youngs_modulus
    G = material.shear_modulus
    areas, seconds = (
        [f(r) for r in (thick, thin)]
        for f in (lambda r: pi * r**2, lambda r: pi * r**4 / 4)
    )
    return part, {
        (0, 0): first / (E * areas[0]) + second / (E * areas[1]),
        (3, 3): first / (2 * G * seconds[0]) + second / (2 * G * seconds[1]),
        (5, 5): first / (E * seconds[0]) + second / (E * seconds[1]),
    }


def elbow(side=0.01, leg=0.15, material=NO_POISSON):
    """An L of two square legs, clamped at the foot of the one along x, loaded at the end of the one along y."""
    h = side / 2
    solid = (
        box((0, -h, -h), (leg + h, h, h)) + box((leg - h, -h, -h), (leg + h, leg, h))
    ).solid()
    end = [FaceSelector(kind="plane", normal=(0, 1, 0), position="max y")]
    part = part_of(solid, name="elbow", material=material, loaded=end)
    E = material.youngs_modulus
    second = side**4 / 12
    return part, {(5, 5): 2 * leg / (E * second), (0, 5): -1.5 * leg**2 / (E * second)}


def curved(inner=0.09, outer=0.11, width=0.015, angle=pi / 2, material=NO_POISSON):
    """A curved beam in the xy plane, clamped at x = 0, centred on (0, R): exact rotation under a pure moment.

    Timoshenko and Goodier, Theory of Elasticity, art. 29: the end turns by 4 B θ / E, with
    B = 2 M (b² - a²) / N and N = (b² - a²)² - 4 a² b² ln²(b/a), M per unit of width.
    """
    from build123d import Axis, Plane, Rectangle, revolve

    a = inner
    b = outer
    centre = (inner + outer) / 2
    axis = Axis((0, 1e3 * centre, 0), (0, 0, 1))
    solid = revolve(
        Plane.YZ * Rectangle(1e3 * (b - a), 1e3 * width), axis, np.degrees(angle)
    ).solid()
    end = [FaceSelector(kind="plane", normal=(cos(angle), sin(angle), 0))]
    part = part_of(
        solid,
        name="curved beam",
        material=material,
        clamped=[FaceSelector(normal=(-1, 0, 0))],
        loaded=end,
    )
    squares = b**2 - a**2
    N = squares**2 - 4 * a**2 * b**2 * log(b / a) ** 2
    return part, {(5, 5): 8 * squares / N * angle / (material.youngs_modulus * width)}


def cfrp_tube(radius=0.02, bore=0.02, length=0.15):
    """Fibres along the tube: torsion L / (G J) is exact; stretch and bending but for the ends' restraint."""
    part, exact = bar(radius, bore, length, CFRP_TUBE)
    area = pi * (radius**2 - bore**2 / 4)
    second = pi * (radius**4 - bore**4 / 16) / 4
    return part, exact | {
        (0, 0): length / (CFRP_TUBE.axial_modulus * area),
        (5, 5): length / (CFRP_TUBE.axial_modulus * second),
    }


def notched(radius=0.0125, notch=0.003, width=0.004, length=0.12):
    """A round steel bar with a square groove around its middle."""
    x = length / 2 - width / 2
    r = radius - notch
    profile = [
        (0, 0),
        (0, radius),
        (x, radius),
        (x, r),
        (x + width, r),
        (x + width, radius),
    ]
    return part_of(
        revolved([*profile, (length, radius), (length, 0)]), name="notched bar"
    )


def perforated(length=0.1, width=0.04, thickness=0.008, hole=0.016):
    """A steel strip with a round hole through its middle."""
    from build123d import Cylinder, Pos

    strip = box((0, -width / 2, -thickness / 2), (length, width / 2, thickness / 2))
    drilled = strip - Pos(500 * length, 0, 0) * Cylinder(500 * hole, 40)
    return part_of(drilled.solid(), name="strip with a hole")


def imprinted(*borders):
    """A 60 x 80 x 20 mm steel block loaded on the patch of its end face (centred at x = 60 mm) that borders cut out."""
    from build123d import Axis
    from OCP.BRepFeat import BRepFeat_SplitShape

    block = box((0, -0.04, -0.01), (0.06, 0.04, 0.01)).solid()
    face = block.faces().sort_by(Axis.X)[-1]
    cut = BRepFeat_SplitShape(block.wrapped)
    for border in borders:
        cut.Add(border.wrapped, face.wrapped)
    cut.Build()
    far = [
        kernel.distance(one, np.array([60.0, 0.0, 0.0]))
        for one in kernel.faces(cut.Shape())
    ]
    patch = [FaceSelector(index=int(np.argmin(far)))]
    return part_of(
        kernel.solids(cut.Shape())[0], name="block with a patch", loaded=patch
    )


def strip(half=0.015):
    """The patch is the middle one of three strips."""
    from build123d import Edge

    lines = [
        Edge.make_line((60, y, -10), (60, y, 10)) for y in (-1e3 * half, 1e3 * half)
    ]
    return imprinted(*lines)


def disc(radius=0.008):
    """The patch is a disc in the middle."""
    from build123d import Plane, Wire

    return imprinted(Wire.make_circle(1e3 * radius, Plane((60, 0, 0), z_dir=(1, 0, 0))))
