"""What a robot must have before another program can simulate it: masses, and springs that hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.errors import InputError

if TYPE_CHECKING:
    from stiffscope.vjm.model.mechanism import Mechanism


def check_dynamics(mechanism: Mechanism) -> None:
    """Raise InputError for a robot without masses, or without anything that yields."""
    if not any(body.mass for body in mechanism.bodies):
        cure = "give bodies a mass and a centre, and parts a material or a mass"
        raise InputError(f"bodies: expected masses, got none; {cure}")
    elastic = any(body.elastic is not None for body in mechanism.bodies)
    yields = any(
        joint.drive is not None or joint.spring or joint.compliance is not None
        for joint in mechanism.joints
    )
    changed = (mechanism.base.compliance, mechanism.grip.compliance)
    if elastic or yields or any(each is not None for each in changed):
        return
    if any(joint.type.free for joint in mechanism.joints):
        cure = "give the joints that hold the robot a `drive` with a stiffness, or a `spring`"
        raise InputError(
            f"joints: expected drives or springs, got none; {cure} (`--to urdf` needs none)"
        )
    cure = "give a joint a `bearing` or `compliance`, or a body a `part`"
    raise InputError(
        f"joints: expected something that yields, got a rigid robot; {cure} (`--to urdf` takes it)"
    )
