"""Settings of meshing and solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiffscope.errors import InputError

MOST_LAYERS = 6  # of thin elements at singular edges; the thinnest is 1/4000 of the size
KINDS = ("rigid", "distributed")  # couplings of a loaded face to its reference point
SOLVERS = ("auto", "direct", "multigrid")
MOST_MODES = 150  # of the condensed model


@dataclass(frozen=True)
class Settings:
    """Settings of meshing and solution; defaults suit parts without thin walls and tiny features.

    Attributes
    ----------
    size, envelope : element length and the mesher's distance from the surface, m; None: automatic.
    interface : coupling of the loaded faces: "rigid" (one body) or "distributed" (a linear traction).
    layers : 1 to 6 thin layers of elements around the borders of fixed faces and re-entrant edges.
    tolerance : required relative bound of every significant entry (1e-3 is 0.1 %); None: one mesh.
    foundation : stiffness per area under the clamped faces, N/m³; None is a rigid clamp.
    time_limit : seconds for the whole experiment, 1.5 times as many with a tolerance. Parts far
        beyond it are refused, refinement keeps its last mesh, and commands stop anything longer.
    most_unknowns : largest number of degrees of freedom of the cubic solution in refinement.
    solver : "direct" (factorization), "multigrid", or "auto", the faster of the two.
    threads : threads of the mesher; 0 takes all processors, or this process's share of them.
    modes : number of fixed-interface modes of the condensed model; None: all below
        ``highest_frequency``, or else those that reproduce the six lowest clamped modes.
    highest_frequency : upper frequency of these modes, Hz.
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
        """Raise InputError if a value is out of range."""
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
