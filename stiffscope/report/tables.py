"""The tables of the commands: parts, compliances, stiffness, deflection, faces, the audit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.report.compare import compare
from stiffscope.report.numbers import (
    NEGLIGIBLE,
    TWIST,
    WRENCH,
    ZERO,
    ZERO_NOTE,
    coordinates,
    find_resolved,
    percent,
    point,
    pose_values,
    ratio,
    relative,
    with_bound,
)
from stiffscope.report.terminal import show_line, show_table
from stiffscope.vjm.mechanism import DIAGONAL

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.biglide.audit import Finding
    from stiffscope.experiments.assembly import Assembled
    from stiffscope.experiments.interfaces import Comparison as Interfaces
    from stiffscope.experiments.results import PartResult
    from stiffscope.fea.experiment import Experiment
    from stiffscope.report.compare import Comparison
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.machine_elements import MachineElement
    from stiffscope.vjm.modes import Modes
    from stiffscope.vjm.statics import Stiffness

SIX = (DIAGONAL[:3], DIAGONAL[3:])
COUPLINGS = ("K_15", "K_24")
SAG = ("|sag| µm", "sag z µm")


def show_parts(results: Sequence[PartResult]) -> None:
    """Mesh, mass, error bound and stage times of each part; then why a tolerance was not met."""
    groups = (
        ("part",),
        ("nodes", "tetrahedra", "volume error", "mass kg", "bound", "wanted"),
        ("cad s", "mesh s", "solve s", ""),
    )
    rows = []
    for result in results:
        facts = result.facts
        mesh, seconds, wanted = facts["mesh"], facts["seconds"], facts["tolerance"]
        volume_error = facts["volume"] / facts["cad_volume"] - 1
        rows.append(
            (
                result.name,
                f"{mesh['nodes']:,}",
                f"{mesh['tetrahedra']:,}",
                f"{100 * volume_error:+z.4f} %",
                f"{facts['mass']:.3f}",
                percent(100 * facts["relative_bound"], 2),
                percent(100 * wanted) if wanted else "",
                *(f"{seconds[stage]:.1f}" for stage in ("cad", "mesh", "solve")),
                "reused" if result.reused else f"computed in {result.seconds:.1f} s",
            )
        )
    show_table("Parts", groups, rows)
    for result in results:
        if result.note:
            show_line(f"{result.name}: {result.note}\n")


def sources(assembled: Assembled) -> str:
    """Return where the parts' matrices come from, in a few words."""
    return ", ".join(f"{part}: {source}" for part, source in assembled.sources.items()) or "rigid parts"


def show_compliance(robot: RobotFile, result: PartResult) -> None:
    """A part's compliance beside beam theory and the published one; a STEP file's solid has nothing beside it."""
    if len(result.experiment.reference_points) > 1:
        show_each_interface(result)
    elif result.own_shape:
        show_comparison(compare(robot, result.name, result))
    else:
        show_matrix(f"Compliance of the {result.name}, SI", result.compliance, result.error)
        show_line("No beam theory beside it: it is a STEP file's solid, not the robot file's own shape\n")


def show_comparison(comparison: Comparison) -> None:
    """FEA beside beam theory beside the published matrix."""
    groups = [("entry", "unit"), ("FEA", "± 95 %"), ("Timoshenko", "FEA/T"), ("Euler-B.", "FEA/EB")]
    if any(e.published is not None for e in comparison.entries):
        groups.append(("published", "FEA/publ."))
    rows = []
    for e in comparison.entries:
        others = [v for v in (e.timoshenko, e.euler_bernoulli, e.published) if v is not None]
        cells = (cell for v in others for cell in (f"{v:.5g}", ratio(e.fea, v)))
        rows.append((e.name, e.unit, f"{e.fea:.6g}", relative(e.error, e.fea), *cells))
    show_table(f"Compliance of the {comparison.part}, clamped at one end", groups, rows)
    for finding in comparison.findings:
        show_line(f"  {finding}.")
    show_line("")


def show_interfaces(compared: Interfaces) -> None:
    """What each choice of interface changes of each entry, and what the choices are."""
    own = compared.own.choice
    groups = [("entry", "unit"), ("value", "± 95 %"), *((tested.choice.name,) for tested in compared.others)]
    rows = [
        (
            *(e.name, e.unit, f"{e.own:.6g}", relative(e.error, e.own)),
            *(f"{100 * c:+z.1f} ± {100 * b:.2g} %" for c, b in zip(e.changes, e.bars, strict=True)),
        )
        for e in compared.entries
    ]
    show_table(f"Compliance of the {compared.part} ({own.name}), and its change with other interfaces", groups, rows)
    for tested in compared.others:
        choice = tested.choice
        overrides = " ".join(f"--set '{o}'" if " " in o else f"--set {o}" for o in choice.overrides)
        show_line(f"  {choice.name}: {choice.words} ({overrides})")
    for line in compared.left_out:
        show_line(f"  {line}")


def show_stiffness(
    names: Sequence[str], state: Stiffness, bars: Any | None = None, *, title: str = "Stiffness at M"
) -> None:
    """Show the diagonal of K, two couplings and the sag at each pose.

    Parameters
    ----------
    names
        Names of the n poses.
    state
        The robot there.
    bars : (n, 6, 6)
        95 % bounds on the stiffness, propagated from the parts' experiments.
    title
        Line above the table.

    """
    pose = state.configurations.mechanism.tool.pose
    sag = state.sag if np.any(state.sag) else None
    factor, units = _scale(state.finite)
    rows: list[Sequence[str]] = []
    for i, name in enumerate(names):
        matrix = np.asarray(state.matrix[i])
        bound = np.zeros((6, 6)) if bars is None else np.asarray(bars[i])
        shown = np.where(find_resolved(matrix, bound), matrix, np.nan) / factor
        sunk = [] if sag is None else [f"{1e6 * np.linalg.norm(sag[i][:3]):.2f}", f"{1e6 * sag[i][2]:z.2f}"]
        place = pose_values(state.poses[i], pose)
        if len(state.rigid[i]):  # of each direction with all others free, where the tool yields at all
            alone = np.diag(np.asarray(state.finite[i]) / factor)
            cells = [*("rigid" if np.isnan(v) else f"{v:.4f}" for v in alone), "", ""]
            rows.append((name, place, *cells, *sunk))
            continue
        rows.append((name, place, *_cells(_diagonal_and_couplings(shown), ".4f"), *sunk))
        if bars is not None:
            spread = (f"{v:.2g}" for v in _diagonal_and_couplings(bound / factor))
            rows.append(("", "± 95 %", *spread, *("" for _ in sunk)))
    where = coordinates(pose)
    groups = (("pose", where), *SIX, COUPLINGS if sag is None else (*COUPLINGS, *SAG))
    show_table(f"{title} ({units})", groups, rows, prose=(where,) if len(pose) > 3 else ())
    if any(len(each) for each in state.rigid):
        show_line("  rigid: K is infinite there, and the others are 1/C_ii, of each direction with all others free\n")
    _explain_zeros(rows)


def show_full_matrices(names: Sequence[str], state: Stiffness, bars: Any | None = None) -> None:
    """Show K and C (6, 6) at each pose with their 95 % bounds; only C where a direction is rigid.

    Parameters
    ----------
    names
        Names of the n poses.
    state
        The robot there.
    bars : (n, 6, 6)
        95 % bounds on the stiffness; those of C are ``|C| |δK| |C|``, to first order.

    """
    scale = np.full((6, 6), 1e-3)
    scale[:3, :3] = 1e-6
    for i, name in enumerate(names):
        compliance = np.asarray(state.compliance[i])
        bound = np.zeros((6, 6)) if bars is None else np.asarray(bars[i])
        spread = np.abs(compliance) @ bound @ np.abs(compliance)
        if not len(state.rigid[i]):
            rows = _with_bounds(np.asarray(state.matrix[i]), bound, scale, WRENCH)
            show_table(f"K at {name}, N/µm, N/mrad = N·m/mm, N·m/mrad", (("",), TWIST[:3], TWIST[3:]), rows)
        rows = _with_bounds(compliance, spread, np.full((6, 6), 1e6), TWIST)
        show_table(f"C at {name}, µm/N, µm/(N·m), µrad/N, µrad/(N·m)", (("",), WRENCH[:3], WRENCH[3:]), rows)


def _with_bounds(matrix: np.ndarray, bound: np.ndarray, scale: np.ndarray, names: Sequence[str]) -> list[Sequence[str]]:
    clear = find_resolved(matrix, bound)

    def cell(i: int, j: int) -> str:
        value, spread = matrix[i, j] * scale[i, j], bound[i, j] * scale[i, j]
        return (f"{value:.5g} ± {spread:.2g}" if spread else f"{value:.5g}") if clear[i, j] else ZERO

    return [(name, *(cell(i, j) for j in range(6))) for i, name in enumerate(names)]


def _scale(stiffness: Any) -> tuple[float, str]:
    """A power of a thousand in which the least stiffness of the diagonals has digits, and the units with it."""
    diagonals = np.abs(np.diagonal(stiffness, axis1=1, axis2=2))
    least = np.min(diagonals, where=diagonals > NEGLIGIBLE * np.nanmax(diagonals, initial=0.0), initial=np.inf)
    factor, power = next(((f, p) for f, p in ((1e6, "10⁶ "), (1e3, "10³ ")) if least >= 0.1 * f), (1.0, ""))
    return factor, f"{power}N/m, {power}N·m/rad, {power}N"


def _diagonal_and_couplings(matrix: np.ndarray) -> list[float]:
    return [*np.diag(matrix), matrix[0, 4], matrix[1, 3]]


def _cells(values: Iterable[float], form: str) -> list[str]:
    return [ZERO if np.isnan(v) else f"{v:{form}}" for v in values]


def _explain_zeros(rows: Iterable[Sequence[str]]) -> None:
    if any(ZERO in row for row in rows):
        show_line(f"  {ZERO_NOTE}\n")


def show_deflection(
    names: Sequence[str], twist: Any, shares: Mapping[str, Any], wrench: str = "", error: Any = 0.0
) -> None:
    """Deflection (n, 6) of the tool in m and rad with its bounds, and each component's share (n,) of the energy.

    Parameters
    ----------
    names
        Names of the poses (n,).
    twist
        Deflections (n, 6), m and rad.
    shares
        Share (n,) of the strain energy, by component.
    wrench
        Words for the wrench.
    error
        95 % bounds of the same shape; 0 without any.

    """
    groups = (("pose",), ("x µm", "y µm", "z µm"), ("rx µrad", "ry µrad", "rz µrad"))
    halves = np.abs(twist).reshape(-1, 2, 3)
    greatest = np.maximum(halves.max(axis=2, keepdims=True), 1e-3 * halves.max(axis=(1, 2), keepdims=True))
    rounding = NEGLIGIBLE * np.broadcast_to(greatest, halves.shape).reshape(-1, 6)
    shown = np.where(np.abs(twist) > np.maximum(rounding, error), twist, 0.0)
    rows = [(name, *(f"{1e6 * v:.4g}" for v in row)) for name, row in zip(names, shown, strict=True)]
    show_table("Deflection at M" + (wrench and f" under {wrench} N, N·m"), groups, rows)
    order = sorted(shares.items(), key=lambda item: -float(np.max(item[1])))
    parts = [(part, *(f"{100 * v:z.2f}" for v in share)) for part, share in order]
    show_table("Strain energy by component, %", (("component",), *((name,) for name in names)), parts)


def show_modes(names: Sequence[str], found: Modes, title: str) -> None:
    """Natural frequencies at each pose with their bounds, and the elements with most of the strain energy.

    Parameters
    ----------
    names
        Names of the poses (n,).
    found
        Result to show.
    title
        Title.

    """
    rows: list[Sequence[str]] = []
    for i, name in enumerate(names):
        for k, (hertz, bound) in enumerate(zip(found.frequencies[i], found.error[i], strict=True)):
            if not np.isfinite(hertz):
                continue
            shares = {element: float(share[i, k]) for element, share in found.energy.items()}
            most = sorted(shares, key=lambda element: -shares[element])[:3]
            said = ", ".join(f"{element} {100 * shares[element]:.0f} %" for element in most if shares[element] > 0.005)
            spread = f"{bound:.2g}" if bound else ""
            rows.append(("" if k else name, str(k + 1), f"{hertz:.5g}", spread, said or "moves freely"))
    groups = (("pose",), ("mode", "Hz", "± mesh error"), ("strain energy",))
    show_table(title, groups, rows, prose=("strain energy",))
    for remark in found.remarks:
        show_line(remark)


def show_change(names: Sequence[str], old: Any, new: Any, overrides: Sequence[str]) -> None:
    """Diagonals of the stiffnesses (n, 6, 6) before and after `--set`, side by side.

    Parameters
    ----------
    names
        Names of the poses (n,).
    old
        Stiffnesses (n, 6, 6) before.
    new
        Stiffnesses (n, 6, 6) after.
    overrides
        Changes of the file, as `--set` has them.

    """
    factor, units = _scale(old)
    rows = []
    for i, name in enumerate(names):
        before, after = np.diag(old[i]), np.diag(new[i])
        rows.append((name, "before", *(f"{v / factor:z.4f}" for v in before)))
        rows.append(("", "now", *(f"{v / factor:z.4f}" for v in after)))
        rows.append(("", "change", *(f"{100 * (b / a - 1):+z.2f} %" for a, b in zip(before, after, strict=True))))
    show_table(f"Changed: {', '.join(overrides)} ({units.rpartition(',')[0]})", (("pose", ""), *SIX), rows)


def show_matrix(title: str, matrix: Any, error: Any = 0.0) -> None:
    """Show a compliance (6, 6), SI, with a dot for what its error (6, 6) hides.

    Parameters
    ----------
    title
        Title.
    matrix
        Compliance (6, 6), SI.
    error
        95 % bounds of the same shape; 0 without any.

    """
    _explain_zeros(_show_matrix(title, matrix, error))


def show_element(kind: str, found: MachineElement) -> None:
    """A machine element's stiffness, what its rolling elements carry, its source and limits."""
    k = np.where(np.abs(found.stiffness) > 0.0, found.stiffness, np.nan)
    rows = [(name, *_cells(row, ".5g")) for name, row in zip(WRENCH, k, strict=True)]
    show_table(f"Stiffness of the {kind}, x along its axis; SI", (("",), TWIST[:3], TWIST[3:]), rows)
    if len(found.loads):
        angle = np.degrees(found.angles)
        show_line(
            f"Rolling elements: {len(found.loads)}, carrying {found.loads.min():.4g} to {found.loads.max():.4g} N, "
            f"contact angles {angle.min():.4g} to {angle.max():.4g} degrees"
        )
    show_line(f"Source: {found.source}")
    for note in (*found.notes, "at rest or slow; rings, housing, carriage and rail rigid"):
        show_line(f"Valid: {note}")


def _show_matrix(title: str, matrix: Any, error: Any) -> list[Sequence[str]]:
    shown = np.where(find_resolved(matrix, error), matrix, np.nan)
    rows: list[Sequence[str]] = [(name, *_cells(row, ".5g")) for name, row in zip(TWIST, shown, strict=True)]
    show_table(title, (("",), WRENCH[:3], WRENCH[3:]), rows)
    return rows


def show_experiment(experiment: Experiment) -> None:
    """Show the compliance (6, 6) at the first interface's reference point, each entry with its bound, SI."""
    matrix, error = experiment.compliance, experiment.error
    clear = find_resolved(matrix, error)
    rows = [
        (name, *(with_bound(matrix[i, j], error[i, j]) if clear[i, j] else ZERO for j in range(6)))
        for i, name in enumerate(TWIST)
    ]
    title = (
        f"{experiment.part}, {experiment.interface}: twist per unit wrench at "
        f"({point(experiment.reference_point)}) mm; m/N, m/(N·m), rad/N, rad/(N·m)"
    )
    show_table(title, (("",), WRENCH[:3], WRENCH[3:]), rows)
    _explain_zeros(rows)
    show_line(f"Largest relative bound {experiment.relative_bound:.2%}, mass {experiment.mass:.4g} kg")
    if experiment.note:
        show_line(experiment.note)


def show_each_interface(result: PartResult) -> None:
    """The compliance at each of a part's loaded interfaces, and where to find what couples them."""
    tested = result.experiment
    points, compliance, error = tested.reference_points, tested.full_compliance, tested.full_error
    rows: list[Sequence[str]] = []
    for k, place in enumerate(points):
        own = slice(6 * k, 6 * k + 6)
        title = (
            f"Compliance of the {result.name} at {tested.interfaces[k + 1]}, ({point(place, 5)}) mm, loaded alone; SI"
        )
        rows += _show_matrix(title, compliance[own, own], error[own, own])
    _explain_zeros(rows)
    size = len(compliance)
    show_line(
        f"At rest: {tested.interfaces[0]}. All {len(points)} interfaces together: {size} x {size}, with --json or "
        "--superelement\n"
    )


def show_faces(file: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """The faces of a solid, and how a robot file chooses among them."""
    groups = (("index", "kind"), ("area mm²",), ("centroid mm",), ("normal or axis",), ("radius mm",))
    cells = [
        (
            str(row["index"]),
            row["kind"],
            f"{row['area_mm2']:.6g}",
            ", ".join(f"{c:z.6g}" for c in row["centroid_mm"]),
            ", ".join(f"{c:z.4g}" for c in row["axis"] or ()),
            f"{row['radius_mm']:g}" if row["radius_mm"] else "",
        )
        for row in rows
    ]
    show_table(f"Faces of {file}", groups, cells)
    show_line("Choose faces by geometry in a robot file, or by index:")
    show_line(f'  [parts.NAME]\n  shape = "step"\n  file = "{file}"')
    show_line('  clamped = [{ kind = "plane", normal = [-1, 0, 0], position = "min x" }]')
    show_line('  loaded = [{ kind = "cylinder", radius = "8 mm" }, { index = 3 }]')


def show_findings(title: str, findings: Sequence[Finding]) -> None:
    """Published numbers beside what they should be, with a verdict each."""
    groups = (("entry",), ("published", "as published (R1)", "correct", "bound"), ("verdict",))
    rows = [
        (f.entry, *(_number(v) for v in (f.published, f.as_published, f.correct, f.bound)), f.verdict) for f in findings
    ]
    show_table(title, groups, rows, prose=("verdict",))


def _number(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:z.5g}"
