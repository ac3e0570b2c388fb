"""A five-bar as CAD assembly machine.step: frame on a foot, cranks on ball bearings, pins, screws.

python examples/assembly/five_bar.py
stiffscope import machine.step --out machine.toml --ground foot --tool coupler_left --material "*=steel" \
        --drive "frame/crank*=9 kN*m/rad"
stiffscope stiffness machine.toml
"""

from __future__ import annotations

import numpy as np
from build123d import (
    Align,
    Box,
    Compound,
    Cylinder,
    Plane,
    SlotCenterToCenter,
    export_step,
    extrude,
)

LOW = (Align.CENTER, Align.CENTER, Align.MIN)
TOP = (Align.CENTER, Align.CENTER, Align.MAX)
LEFT, RIGHT = np.array([-60.0, 0.0]), np.array([60.0, 0.0])


def put(solid, x, y, z=0.0):
    """Move a solid's origin to a point."""
    return Plane(origin=(x, y, z)).location * solid


def link(start, end, low, thick=8.0, width=24.0, bore=4.0):
    """Return a flat link with a bore at each end."""
    length = float(np.linalg.norm(end - start))
    middle = 0.5 * (start + end)
    place = Plane(
        origin=(*middle, low), x_dir=(*((end - start) / length), 0.0), z_dir=(0, 0, 1)
    ).location
    solid = place * extrude(SlotCenterToCenter(length, width), thick)
    for point in (start, end):
        solid -= put(Cylinder(bore, 3 * thick), *point, low)
    return solid


def place_pins():
    """Return the positions (2,) of the pins at the left and right crank, and between couplers."""
    left = LEFT + 100 * np.array([np.cos(2.2), np.sin(2.2)])
    right = RIGHT + 100 * np.array([np.cos(0.9), np.sin(0.9)])
    gap = float(np.linalg.norm(right - left))
    across = np.array([-(right - left)[1], (right - left)[0]]) / gap
    return (
        left,
        right,
        0.5 * (left + right) + np.sqrt(140.0**2 - 0.25 * gap**2) * across,
    )


def build() -> Compound:
    """Return the assembly, mm."""
    left, right, top = place_pins()
    frame = Box(300, 120, 12, align=TOP)
    foot = put(Box(300, 40, 20, align=TOP), 0, -40, -12)
    solids = {}
    for x in (-120.0, 0.0, 120.0):
        frame -= put(Cylinder(2.75, 40), x, -40)
        foot -= put(Cylinder(2.1, 16, align=TOP), x, -40, -12)
        solids[f"screw M5x24 {x:g}"] = put(
            Cylinder(3.75, 5, align=LOW) + Cylinder(2.5, 24, align=TOP), x, -40
        )
    for name, point in (("left", LEFT), ("right", RIGHT)):
        frame -= put(Cylinder(11, 7, align=TOP), *point) + put(Cylinder(6, 40), *point)
        solids[f"bearing 608 {name}"] = put(
            Cylinder(11, 7, align=TOP) - Cylinder(4, 20), *point
        )
        solids[f"axle_{name}"] = put(Cylinder(4, 15, align=LOW), *point, -7)
    solids |= {"frame": frame, "foot": foot}
    solids |= {"crank_left": link(LEFT, left, 0), "crank_right": link(RIGHT, right, 0)}
    solids |= {
        "coupler_left": link(left, top, 8),
        "coupler_right": link(right, top, 16),
    }
    for name, point, low, high in (
        ("left", left, 0, 16),
        ("right", right, 0, 24),
        ("top", top, 8, 24),
    ):
        solids[f"pin_{name}"] = put(Cylinder(4, high - low, align=LOW), *point, low)
    solids["spacer"] = put(Cylinder(7, 8, align=LOW) - Cylinder(4, 40), *right, 8)
    children = []
    for name, solid in solids.items():
        children.append(solid.solid())
        children[-1].label = name
    return Compound(label="five-bar", children=children)


if __name__ == "__main__":
    assembly = build()
    export_step(assembly, "machine.step")
    print(f"machine.step: {len(assembly.children)} solids")
