"""Faults of the measuring chain between the machine and a number in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.lab.machine import Machine
    from stiffscope.lab.rotations import Array

Parameters = Mapping[str, float]

ROTATIONS = ("rx", "ry", "rz")


def name_parameters(parameters: Parameters, *names: str) -> Array:
    """Return parameters in the order of names; zero if a name is empty or missing."""
    return np.array([parameters.get(name, 0.0) for name in names])


def change_instrument(machine: Machine, **changes: Any) -> Machine:
    """Return the machine with a changed instrument."""
    return replace(machine, instrument=replace(machine.instrument, **changes))


def turn_instrument(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Rotate the whole instrument or one channel by small angles."""
    known = machine.instrument.rotations
    rotation = known.get(place, 0.0) + name_parameters(parameters, *ROTATIONS)
    return change_instrument(machine, rotations={**known, place: rotation})


def multiply(
    machine: Machine, place: str, factor: float, what: str = "factors"
) -> Machine:
    """Multiply recorded numbers of the instrument or a channel, or scale its motions.

    Parameters
    ----------
    machine, place
        The machine so far, and "instrument" or a channel.
    factor
        Factor besides the present one.
    what
        "factors" on the recorded numbers, for a wrong unit or sign; or "scales" of motions.
    """
    known = getattr(machine.instrument, what)
    return change_instrument(
        machine, **{what: {**known, place: factor * known.get(place, 1.0)}}
    )


def slip_channel(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Shift the readings of a channel from one row of the table on."""
    step = parameters.get("row", 0.0), parameters["jump"]
    return change_instrument(machine, steps={**machine.instrument.steps, place: step})


def leak_channel(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Add a share of one channel to another."""
    source, sink = place.split("->")
    leak = (source, sink, parameters["share"])
    return change_instrument(machine, crosstalk=(*machine.instrument.crosstalk, leak))


def read_pair(parameters: Parameters) -> tuple[float, float]:
    """Return the sizes for displacements and rotations."""
    return parameters.get("displacement", 0.0), parameters.get("rotation", 0.0)
