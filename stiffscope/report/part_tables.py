"""Tables of parts: experiments, compliances, interfaces, elements, faces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.experiments.comparison import compare
from stiffscope.report.numbers import (
    TWIST,
    WRENCH,
    ZERO,
    ZERO_NOTE,
    find_resolved,
    percent,
    point,
    ratio,
    relative,
    with_bound,
)
from stiffscope.report.terminal import show_line, show_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stiffscope.experiments.comparison import Comparison
    from stiffscope.experiments.experiments import PartResult
    from stiffscope.fea.experiment import Experiment
    from stiffscope.robot.file.description import RobotFile
    from stiffscope.vjm.elements.machine_elements import MachineElement


def show_parts(results: Sequence[PartResult]) -> None:
    """Show mesh, mass, error bound and stage times of each part, and notes on unmet tolerances."""
    sizes = ("nodes", "tetrahedra", "volume error", "mass kg", "bound", "wanted")
    groups = (("part",), sizes, ("cad s", "mesh s", "solve s", ""))
    rows = []
    for result in results:
        facts = result.facts
        mesh = facts["mesh"]
        seconds = facts["seconds"]
        wanted = facts["tolerance"]
        error = f"{100 * (facts['volume'] / facts['cad_volume'] - 1):+z.4f} %"
        counts = (
            f"{mesh['nodes']:,}",
            f"{mesh['tetrahedra']:,}",
            error,
            f"{facts['mass']:.3f}",
        )
        bounds = (
            percent(100 * facts["relative_bound"], 2),
            percent(100 * wanted) if wanted else "",
        )
        times = (f"{seconds[stage]:.1f}" for stage in ("cad", "mesh", "solve"))
        how = "reused" if result.reused else f"computed in {result.seconds:.1f} s"
        rows.append((result.name, *counts, *bounds, *times, how))
    show_table("Parts", groups, rows)
    for result in results:
        if result.note:
            show_line(f"{result.name}: {result.note}\n")


def show_compliance(robot: RobotFile, result: PartResult) -> None:
    """Show a part's compliance with beam theory and published values; a STEP solid's alone."""
    if len(result.experiment.reference_points) > 1:
        show_each_interface(result)
    elif result.own_shape:
        show_comparison(compare(robot, result.name, result))
    else:
        show_matrices(
            {f"Compliance of the {result.name}, SI": (result.compliance, result.error)}
        )
        show_line("No comparison with beam theory: the solid comes from a STEP file\n")


def show_comparison(comparison: Comparison) -> None:
    """Show FEA, beam theory and the published matrix side by side."""
    beams = ("Timoshenko", "FEA/T"), ("Euler-B.", "FEA/EB")
    groups = (("entry", "unit"), ("FEA", "± 95 %"), *beams, ("published", "FEA/publ."))
    rows = []
    for e in comparison.entries:
        cells = [f"{e.fea:.6g}", relative(e.error, e.fea)]
        for v in (e.timoshenko, e.euler_bernoulli, e.published):
            cells += ("", "") if v is None else (f"{v:.5g}", ratio(e.fea, v))
        rows.append((e.name, e.unit, *cells))
    show_table(f"Compliance of the {comparison.part}, clamped at one end", groups, rows)
    for finding in comparison.findings:
        show_line(f"  {finding}.")
    show_line("")


def show_matrices(matrices: Mapping[str, tuple[Any, Any]]) -> None:
    """Show compliances (6, 6) and bounds, SI, by title; a dot stands for entries within bounds."""
    rows: list[Sequence[str]] = []
    for title, (matrix, error) in matrices.items():
        shown = np.where(find_resolved(matrix, error), matrix, np.nan)
        here = [
            (name, *format_cells(row, ".5g"))
            for name, row in zip(TWIST, shown, strict=True)
        ]
        show_table(title, (("",), WRENCH[:3], WRENCH[3:]), here)
        rows += here
    explain_zeros(rows)


def show_element(kind: str, element: MachineElement) -> None:
    """Show a machine element's stiffness, rolling element loads, source and limits."""
    k = np.where(np.abs(element.stiffness) > 0.0, element.stiffness, np.nan)
    rows = [
        (name, *format_cells(row, ".5g")) for name, row in zip(WRENCH, k, strict=True)
    ]
    groups = (("",), TWIST[:3], TWIST[3:])
    show_table(f"Stiffness of the {kind}, x along its axis; SI", groups, rows)
    if len(element.loads):
        loads = element.loads
        angle = np.degrees(element.angles)
        carried = f"{len(loads)}, carrying {loads.min():.4g} to {loads.max():.4g} N"
        angles = f"contact angles {angle.min():.4g} to {angle.max():.4g} degrees"
        show_line(f"Rolling elements: {carried}, {angles}")
    show_line(f"Source: {element.source}")
    for note in (
        *element.notes,
        "at rest or slow; rings, housing, carriage and rail rigid",
    ):
        show_line(f"Valid: {note}")


def show_experiment(experiment: Experiment) -> None:
    """Show the compliance (6, 6) at the first interface's reference point with bounds, SI."""
    matrix = experiment.compliance
    error = experiment.error
    clear = find_resolved(matrix, error)
    rows = [
        (
            name,
            *(
                with_bound(matrix[i, j], error[i, j]) if clear[i, j] else ZERO
                for j in range(6)
            ),
        )
        for i, name in enumerate(TWIST)
    ]
    where = f"twist per unit wrench at ({point(experiment.reference_point)}) mm"
    title = f"{experiment.part}, {experiment.interface}: {where}; m/N, m/(N·m), rad/N, rad/(N·m)"
    show_table(title, (("",), WRENCH[:3], WRENCH[3:]), rows)
    explain_zeros(rows)
    bound = f"{experiment.relative_bound:.2%}"
    show_line(f"Largest relative bound {bound}, mass {experiment.mass:.4g} kg")
    if experiment.note:
        show_line(experiment.note)


def show_each_interface(result: PartResult) -> None:
    """Show the compliance at each loaded interface, and how to get the coupled matrix."""
    tested = result.experiment
    points = tested.reference_points
    compliance = tested.full_compliance
    error = tested.full_error
    matrices = {}
    for k, place in enumerate(points):
        rows = slice(6 * k, 6 * k + 6)
        where = f"{tested.interfaces[k + 1]}, ({point(place, 5)}) mm"
        title = f"Compliance of the {result.name} at {where}, loaded alone; SI"
        matrices[title] = compliance[rows, rows], error[rows, rows]
    show_matrices(matrices)
    together = (
        f"All {len(points)} interfaces together: {len(compliance)} x {len(compliance)}"
    )
    show_line(
        f"Clamped: {tested.interfaces[0]}. {together}, with --json or --superelement\n"
    )


def show_faces(file: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Show the faces of a solid, and how to select them in a robot file."""
    columns = ("area mm²", "centroid mm", "normal or axis", "radius mm")
    groups = (("index", "kind"), *((name,) for name in columns))
    cells = []
    for row in rows:
        centroid = ", ".join(f"{c:z.6g}" for c in row["centroid_mm"])
        axis = ", ".join(f"{c:z.4g}" for c in row["axis"] or ())
        radius = f"{row['radius_mm']:g}" if row["radius_mm"] else ""
        area = f"{row['area_mm2']:.6g}"
        cells.append((str(row["index"]), row["kind"], area, centroid, axis, radius))
    show_table(f"Faces of {file}", groups, cells)
    show_line("Choose faces by geometry in a robot file, or by index:")
    show_line(f'  [parts.NAME]\n  shape = "step"\n  file = "{file}"')
    show_line(
        '  clamped = [{ kind = "plane", normal = [-1, 0, 0], position = "min x" }]'
    )
    show_line('  loaded = [{ kind = "cylinder", radius = "8 mm" }, { index = 3 }]')


def format_cells(values: Iterable[float], form: str) -> list[str]:
    """Format numbers, e.g. as ".5g"; NaN (zero within its bound) becomes the zero sign."""
    return [ZERO if np.isnan(v) else f"{v:{form}}" for v in values]


def explain_zeros(rows: Iterable[Sequence[str]]) -> None:
    """Explain the zero sign if a table contains one."""
    if any(ZERO in row for row in rows):
        show_line(f"  {ZERO_NOTE}\n")
