"""How to mesh and solve a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiffscope.errors import InputError

MOST_LAYERS = 6  # of thin elements at singular edges; the thinnest has a 4000th of the size
KINDS = ("rigid", "distributed")  # of couplings between a loaded face and its reference point
SOLVERS = ("auto", "direct", "multigrid")
MOST_MODES = 150  # of the condensed model


@dataclass(frozen=True)
class Settings:
    """How to mesh and solve; the defaults suit a part that is neither thin-walled nor full of tiny features.

    Attributes
    ----------
    size, envelope : element length and the mesher's distance from the surface, m; None chooses them from the part.
    interface : coupling of the loaded faces: "rigid" (one body) or "distributed" (a linear traction).
    layers : 1 to 6 thin layers of elements around the borders of fixed faces and re-entrant edges.
    tolerance : relative error bound required of every significant entry, 1e-3 for 0.1 %; None accepts one mesh's.
    foundation : stiffness per unit of area under the clamped faces, N/m³; None is a rigid clamp.
    time_limit : seconds allowed to the whole experiment, half as long again with a tolerance. Parts that would take
        far longer are refused beforehand, refinement keeps its last mesh, and commands end whatever takes longer.
    most_unknowns : degrees of freedom of the cubic solution beyond which refinement stops.
    solver : "direct" (a factorization), "multigrid", or "auto", the faster of the two.
    threads : the mesher's threads; 0 takes all processors, or this process's share of them.
    modes : number of fixed-interface modes of the condensed model; None takes all below ``highest_frequency``, or by
        default those of ``stiffscope.fea.dynamics``, with which it has the six lowest clamped modes of the part.
    highest_frequency : Hz.
    """

    size: float | None = None
    envelope: float | None = None
    interface: str = "rigid"
    layers: int = 1
    tolerance: float | None = None
    foundation: float | None = None
    time_limit: float = 300.0
    most_unknowns: int = 2_000_000
    solver: str = "auto"
    threads: int = 0
    modes: int | None = None
    highest_frequency: float | None = None

    def __post_init__(self) -> None:
        """Raise InputError for values out of range."""
        for name in ("size", "envelope"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"mesh.{name}: expected a positive length, got {value!r} m")
        if self.interface not in KINDS:
            raise InputError(f"interface: expected {' or '.join(KINDS)}, got {self.interface!r}")
        if self.solver not in SOLVERS:
            raise InputError(f"solver: expected {', '.join(SOLVERS[:-1])} or {SOLVERS[-1]}, got {self.solver!r}")
        if not (np.isfinite(self.time_limit) and self.time_limit > 0):
            raise InputError(f"mesh.time_limit: expected positive seconds, got {self.time_limit!r}")
        if self.tolerance is not None and not 1e-6 <= self.tolerance < 1:
            raise InputError(
                f"tolerance: expected a fraction from 1e-6 to below 1 (0.1 % is 1e-3), got {self.tolerance!r}"
            )
        if self.foundation is not None and not (np.isfinite(self.foundation) and self.foundation > 0):
            raise InputError(f"foundation: expected a positive stiffness per area in N/m3, got {self.foundation!r}")
        if not self.most_unknowns >= 1:
            raise InputError(f"mesh.most_unknowns: expected a positive number, got {self.most_unknowns!r}")
        if not 1 <= self.layers <= MOST_LAYERS:
            raise InputError(f"mesh.layers: expected 1 to {MOST_LAYERS}, got {self.layers!r}")
        self._check_modes()

    def _check_modes(self) -> None:
        if self.modes is not None and not 0 <= self.modes <= MOST_MODES:
            raise InputError(f"mesh.modes: expected 0 to {MOST_MODES}, got {self.modes!r}")
        if self.highest_frequency is not None:
            if not (np.isfinite(self.highest_frequency) and self.highest_frequency > 0):
                raise InputError(
                    f"mesh.highest_frequency: expected a positive frequency, got {self.highest_frequency!r} Hz"
                )
            if self.modes is not None:
                raise InputError("mesh.highest_frequency: expected this or mesh.modes, got both")
