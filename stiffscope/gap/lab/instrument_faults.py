"""Faults of the measuring chain between the machine and a number in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from stiffscope.gap.lab.machine import Machine
    from stiffscope.gap.lab.rotations import Array

Parameters = Mapping[str, float]

ROTATIONS = ("rx", "ry", "rz")


def name_parameters(parameters: Parameters, *names: str) -> Array:
    """Return parameters in the order of names; zero if a name is empty or missing."""
    return np.array([parameters.get(name, 0.0) for name in names])


def change_instrument(machine: Machine, **changes: Any) -> Machine:
    """Return the machine with a changed instrument."""
    return replace(machine, instrument=replace(machine.instrument, **changes))


def scale_instrument(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Scale the readings of the whole instrument or of one channel."""
    if place == "instrument":
        return change_instrument(machine, scale=machine.instrument.scale * parameters["factor"])
    return change_instrument(machine, scales={**machine.instrument.scales, place: parameters["factor"]})


def turn_instrument(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Rotate the whole instrument or one channel by small angles."""
    rotation = name_parameters(parameters, *ROTATIONS)
    if place == "instrument":
        return change_instrument(machine, rotation=machine.instrument.rotation + rotation)
    return change_instrument(machine, rotations={**machine.instrument.rotations, place: rotation})


def multiply_numbers(machine: Machine, place: str, factor: float) -> Machine:
    """Multiply recorded numbers, for a wrong unit or a reversed sign."""
    known = machine.instrument.factors
    return change_instrument(machine, factors={**known, place: factor * known.get(place, 1.0)})


def slip_channel(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Shift the readings of a channel from one row of the table on."""
    step = parameters.get("row", 0.0), parameters["jump"]
    return change_instrument(machine, steps={**machine.instrument.steps, place: step})


def leak_channel(machine: Machine, place: str, parameters: Parameters) -> Machine:
    """Add a share of one channel to another."""
    source, sink = place.split("->")
    return change_instrument(machine, crosstalk=(*machine.instrument.crosstalk, (source, sink, parameters["share"])))


def read_pair(parameters: Parameters) -> tuple[float, float]:
    """Return the sizes for displacements and rotations."""
    return parameters.get("displacement", 0.0), parameters.get("rotation", 0.0)
