"""Identifiability of the faults of a case from noise-free readings."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from stiffscope.gap.effects.vocabulary import word_of
from stiffscope.lab.blind.cases import Fault
from stiffscope.lab.faults import KNOWN
from stiffscope.lab.measuring import Noise, true_readings
from stiffscope.lab.signatures import (
    Signatures,
    fit_residual,
    orthonormal_basis,
    project_out,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stiffscope.lab.blind.laboratory import Lab
    from stiffscope.lab.closure import Located
    from stiffscope.lab.measuring import Plan, Readings
    from stiffscope.lab.rotations import Array

VISIBLE = (
    8.0  # least size of a fault's signature over all readings, standard deviations
)
_ALIKE = (
    4.0  # largest indistinguishable difference over all readings, standard deviations
)
_SAME = 1e-4  # relative residual of a signature fitted by an equivalent one
_IMITATORS = 3  # most known effects that together may mimic an outside one
_TWINS = 2  # most other effects in the named group of a true one
_IDLE = {"load", "row"}  # change nothing alone: load of a knee, row of a slip
_KEPT = {"mass", *_IDLE}  # fixed in signatures, as is the mass of a payload


class Bench(Protocol):
    """A way of measuring a lab's machine, without noise."""

    @property
    def words(self) -> list[str]:
        """Known effects that it may show."""
        ...

    @property
    def sensors(self) -> tuple[str, ...]:
        """Sensors or points that may be faulty."""
        ...

    @property
    def frame(self) -> Array:
        """Columns (r, k) over the noise of what is the instruments', and no cause."""
        ...

    def find_change(self, fault: Fault) -> Array:
        """Return the change (r,) of readings by a fault, over their noise."""
        ...

    def list_steps(self, effect: str, place: str) -> list[Fault]:
        """Return small steps of an effect's parameters; none if `find_columns` has their changes."""
        ...

    def find_columns(self, effect: str, place: str) -> Array | None:
        """Return changes (r, k) by units of an effect's parameters, over the noise; None if nonlinear."""
        ...


class ReadingBench:
    """Readings of a plan."""

    def __init__(self, lab: Lab, plan: Plan, located: Located) -> None:
        self._lab = lab
        self._plan = plan
        self._located = located
        self._sound = self._read(())
        self._elements = Signatures(lab.sound, plan, located, self._sound, Noise())
        self.sensors = tuple(sensor.name for sensor in plan.sensors)
        self.words = [
            w for w in lab.words() if plan.frame is None or not KNOWN[w].of_readings
        ]
        self.frame = self._elements.frame

    def _read(self, faults: Sequence[Fault]) -> Readings:
        machine = self._lab.with_faults(faults)
        return true_readings(machine, self._plan, self._located)

    def find_change(self, fault: Fault) -> Array:
        """Return the change (r,) of readings by a fault, over their noise."""
        change = self._read((fault,)).value - self._sound.value
        return change / self._elements.sigma

    def list_steps(self, effect: str, place: str) -> list[Fault]:
        """Return small steps of an effect's parameters, if it says some."""
        return [Fault(effect, place, dict(step)) for step in KNOWN[effect].steps]

    def find_columns(self, effect: str, place: str) -> Array | None:
        """Return changes (r, k) by units of an effect's parameters, over the noise; None if nonlinear."""
        softer = self._lab.softer(effect, place)
        return self._elements.find_columns(effect, place, softer)


class Judge:
    """Decides whether noise-free readings distinguish a case's faults from all other effects."""

    def __init__(self, lab: Lab, bench: Bench) -> None:
        self.lab = lab
        self._bench = bench
        self._frame = orthonormal_basis(bench.frame)
        self.sensors = bench.sensors
        self.words = bench.words
        self._own: dict[str, Array] = {}
        self._spans: dict[str, Array] = {}
        self._vain: dict[str, bool] = {}

    def _signature(self, fault: Fault) -> Array:
        """Return the changes of readings (r,) by a fault alone, over their noise."""
        key = repr(fault)
        if key not in self._own:
            change = self._bench.find_change(fault)
            self._own[key] = project_out(change[:, None], self._frame)[:, 0]
        return self._own[key]

    def _columns(self, fault: Fault) -> Array:
        """Return columns (r, k) of changes by a fault's effect for any parameters."""
        columns = self._isolate_fault(fault.effect, fault.place)
        if columns is not None:
            return np.hstack([columns, self._signature(fault)[:, None]])
        if fault.name not in self._spans:
            given = fault.parameters
            kept = {n: v for n, v in given.items() if n in _KEPT}
            each = [
                replace(fault, parameters=kept | {n: given[n]})
                for n in given
                if n not in _IDLE
            ]
            self._spans[fault.name] = np.stack(
                list(map(self._signature, each or [fault])), axis=1
            )
        return self._spans[fault.name]

    def _isolate_fault(self, effect: str, place: str) -> Array | None:
        steps = self._bench.list_steps(effect, place)
        if steps:
            return np.stack([self._signature(step) for step in steps], axis=1)
        columns = self._bench.find_columns(effect, place)
        return None if columns is None else project_out(columns, self._frame)

    @cached_property
    def _all_columns(self) -> dict[str, Array]:
        """Columns (r, k) of all known effects that have some, at all places."""
        everywhere = self.lab.everywhere(self.sensors).items()
        listed = {name: each for name, each in everywhere if each[0] in self.words}
        found = {name: self._isolate_fault(*each) for name, each in listed.items()}
        return {name: columns for name, columns in found.items() if columns is not None}

    def can_decide(self, faults: Sequence[Fault]) -> bool:
        """Return whether every fault is identifiable beside the others; see `draw_case`."""
        if any(self._is_hopeless(fault) for fault in faults):
            return False
        for fault in reversed(faults):  # the last one is new
            signature = self._signature(fault)
            others = [self._columns(other) for other in faults if other is not fault]
            beside = orthonormal_basis(
                np.hstack([np.zeros((len(signature), 0)), *others])
            )
            left = project_out(signature[:, None], beside)[:, 0]
            seen = np.linalg.norm(left) >= VISIBLE
            if not seen or len(self._find_alike(fault, left, beside)) > _TWINS:
                return False
        return True

    def distance(self, fault: Fault) -> tuple[float, float]:
        """Return norms of a fault's signature, and of its rest after the closest known effects."""
        left = self._signature(fault)
        size = float(np.linalg.norm(left))
        basis = np.zeros((len(left), 0))
        columns = list(self._all_columns.values())
        for _ in range(_IMITATORS):
            if not columns or not np.linalg.norm(left) >= VISIBLE:
                break
            spans = [orthonormal_basis(project_out(each, basis)) for each in columns]
            best = max(spans, key=lambda span: float(np.linalg.norm(span.T @ left)))
            basis = np.hstack([basis, best])
            left = project_out(left[:, None], best)[:, 0]
        return size, float(np.linalg.norm(left))

    def _is_hopeless(self, fault: Fault) -> bool:
        """Return whether a fault of any size is invisible or indistinguishable in such readings."""
        if fault.name not in self._vain:
            columns = self._isolate_fault(fault.effect, fault.place)
            vain = columns is not None and not columns.any()
            if columns is not None and not vain and columns.shape[1] == 1:
                large = columns[:, 0] * (_ALIKE / _SAME / np.linalg.norm(columns))
                vain = (
                    len(self._find_alike(fault, large, np.zeros((len(large), 0))))
                    > _TWINS
                )
            self._vain[fault.name] = vain
        return self._vain[fault.name]

    def _find_alike(self, fault: Fault, left: Array, beside: Array) -> set[str]:
        """Return other effects that mimic a fault with no more parameters than it has.

        left: its signature (r,) with the campaign's other faults projected out; beside: orthonormal
        basis (r, k) of these.
        """
        others = dict(self._all_columns)
        others.pop(self.lab.canonical(fault.name), None)
        if fault.effect != "part-compliance":  # too flexible
            others = {
                n: each for n, each in others.items() if word_of(n) != "part-compliance"
            }
        most = len(fault.parameters)
        rest = {n: project_out(columns, beside) for n, columns in others.items()}
        return {
            n
            for n, columns in rest.items()
            if fit_residual(left, columns, most) < _ALIKE
        }
