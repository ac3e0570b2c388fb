"""Settings of meshing and solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiffscope.cad.checks import require

MOST_LAYERS = (
    6  # of thin elements at singular edges; the thinnest is 1/4000 of the size
)
KINDS = ("rigid", "distributed")  # couplings of a loaded face to its reference point
SOLVERS = ("auto", "direct", "multigrid")
MOST_MODES = 150  # of the condensed model


@dataclass(frozen=True)
class Settings:
    """Settings of meshing and solution; defaults suit parts without thin walls and tiny features.

    Attributes
    ----------
    size, envelope : element length and the mesher's distance from the surface, m; None: automatic.
    interface : coupling of the loaded faces: "rigid" (one body) or "distributed" (linear traction).
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
        for field, value, valid, unit in (
            ("mesh.size", self.size, "a positive length", " m"),
            ("mesh.envelope", self.envelope, "a positive length", " m"),
            ("mesh.time_limit", self.time_limit, "positive seconds", ""),
            (
                "foundation",
                self.foundation,
                "a positive stiffness per area in N/m3",
                "",
            ),
            (
                "mesh.highest_frequency",
                self.highest_frequency,
                "a positive frequency",
                " Hz",
            ),
        ):
            positive = value is None or (np.isfinite(value) and value > 0)
            require(positive, field, valid, f"{value!r}{unit}")
        require(
            self.interface in KINDS,
            "interface",
            " or ".join(KINDS),
            repr(self.interface),
        )
        check_solver(self.solver)
        fraction = "a fraction from 1e-6 to below 1 (0.1 % is 1e-3)"
        valid = self.tolerance is None or 1e-6 <= self.tolerance < 1
        require(valid, "tolerance", fraction, repr(self.tolerance))
        most = self.most_unknowns
        require(most >= 1, "mesh.most_unknowns", "a positive number", repr(most))
        few = 1 <= self.layers <= MOST_LAYERS
        require(few, "mesh.layers", f"1 to {MOST_LAYERS}", repr(self.layers))
        few = self.modes is None or 0 <= self.modes <= MOST_MODES
        require(few, "mesh.modes", f"0 to {MOST_MODES}", repr(self.modes))
        one = self.modes is None or self.highest_frequency is None
        require(one, "mesh.highest_frequency", "this or mesh.modes", "both")


def check_solver(name: str) -> None:
    """Raise InputError for an unknown solver."""
    valid = f"{', '.join(SOLVERS[:-1])} or {SOLVERS[-1]}"
    require(name in SOLVERS, "solver", valid, repr(name))
