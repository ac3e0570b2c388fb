"""Places of bodies at home: frames in base axes, and displacements as maps of base coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiffscope.vjm.model.screws import Frame, rotation_of

if TYPE_CHECKING:
    from stiffscope.vjm.model.screws import Array


def compose(outer: Frame, inner: Frame) -> Frame:
    """Return the frame of a frame in a frame, or one displacement after another."""
    return Frame(outer.matrix() @ inner.matrix(), outer.point(inner.origin()))


def invert(frame: Frame) -> Frame:
    """Return the parent in the axes of the child."""
    back = frame.matrix().T
    return Frame(back, -back @ frame.origin())


def relative(parent: Frame, child: Frame) -> Frame:
    """Return a frame in the axes of another."""
    return compose(invert(parent), child)


def displacement(twist: Array, frame: Frame) -> Frame:
    """Return the displacement by a twist (6,) in a frame, as a map of base coordinates."""
    moved = Frame(rotation_of(twist[3:]), twist[:3])
    return compose(compose(frame, moved), invert(frame))
