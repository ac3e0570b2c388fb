"""Time from a STEP assembly to its proposed joints, over the number of solids."""

from __future__ import annotations

import time
from collections import Counter

import build123d as b
import pytest

from stiffscope.cad.assembly import read_assembly
from stiffscope.cad.contacts import find_contacts
from stiffscope.imports.contact_joints import find_joints
from stiffscope.imports.hardware import find_hardware
from tests.imports import assemblies

pytestmark = pytest.mark.slow


@pytest.mark.benchmark
@pytest.mark.parametrize("axes", [5, 11, 23])
def test_seconds_to_the_joints_of_a_machine(axes, tmp_path):
    """Slides of 22 solids side by side on a floor: 111, 243, 507 solids."""
    one = assemblies.slider()
    made = assemblies.Made()
    for number in range(axes):
        for name, solid in one.solids.items():
            made.add(f"{name}_{number}", b.Pos(0, 500 * number, 0) * solid)
    made.add(
        "floor",
        b.Pos(0, 250 * axes, -30)
        * b.Box(400, 500 * axes + 500, 20, align=assemblies.TOP),
    )
    made.write(tmp_path / "machine.step")
    start = time.perf_counter()
    solids = read_assembly(tmp_path / "machine.step")
    contacts = find_contacts(solids)
    joints, _ = find_joints(solids, contacts, find_hardware(solids, contacts, {}))
    seconds = time.perf_counter() - start
    print(
        f"{len(solids)} solids, {len(contacts)} contacts, {len(joints)} joints: {seconds:.1f} s"
    )
    assert Counter(joint.kind for joint in joints) == {
        "fixed": 7 * axes,
        "prismatic": 4 * axes,
    }  # a bed lies on the floor
    assert seconds < 60.0
