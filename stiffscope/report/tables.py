"""Tables on standard output, drawn here alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Table

    from stiffscope.jobs.interfaces import Comparison as Interfaces
    from stiffscope.jobs.results import PartResult
    from stiffscope.report.compare import Comparison
    from stiffscope.vjm.audit import Finding

STIFFNESSES = ("K_tx", "K_ty", "K_tz", "K_rx", "K_ry", "K_rz")


def console() -> Console:
    """Where tables go; wide enough for them when the output is not a terminal."""
    from rich.console import Console

    found = Console(highlight=False)
    return found if found.is_terminal else Console(highlight=False, width=130, color_system=None)


def new_table(title: str, *columns: str) -> Table:
    """A table in the house's form: first column left, the others right."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, title_style="bold")
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    return table


def show_parts(results: Sequence[PartResult]) -> None:
    """One line a part: mesh, mass, bound, stage times, reused or computed; then what tolerance was not met and why."""
    columns = (
        "part",
        "nodes",
        "tetrahedra",
        "volume error",
        "mass kg",
        "bound",
        "wanted",
        "cad s",
        "mesh s",
        "solve s",
    )
    table = new_table("Parts", *columns, "")
    for result in results:
        facts = result.facts
        mesh, seconds, wanted = facts["mesh"], facts["seconds"], facts["tolerance"]
        off = facts["volume"] / facts["cad_volume"] - 1
        table.add_row(
            result.name, f"{mesh['nodes']:,}", f"{mesh['tetrahedra']:,}", f"{100 * off:+.4f} %", f"{facts['mass']:.3f}",
            f"{100 * facts['relative_bound']:.2g} %", f"{100 * wanted:.3g} %" if wanted else "",
            *(f"{seconds[stage]:.1f}" for stage in ("cad", "mesh", "solve")),
            "reused" if result.reused else f"computed in {result.seconds:.1f} s",
        )  # fmt: skip
    console().print(table)
    for result in results:
        if result.note:
            show_line(f"{result.name}: {result.note}\n")


def show_comparison(comparison: Comparison) -> None:
    """FEA beside beam theory beside published."""
    columns = ("entry", "unit", "FEA", "± 95 %", "Timoshenko", "FEA/T", "Euler-B.", "FEA/EB", "published", "FEA/publ.")
    table = new_table(f"Compliance of the {comparison.part}, clamped at one end", *columns)
    for e in comparison.entries:
        pairs = [
            cell for v in (e.timoshenko, e.euler_bernoulli, e.published) for cell in (f"{v:.5g}", _ratio(e.fea, v))
        ]
        table.add_row(e.name, e.unit, f"{e.fea:.6g}", _percent(e.error, e.fea), *pairs)
    out = console()
    out.print(table)
    for finding in comparison.findings:
        out.print(f"  {finding}.", markup=False)
    out.print()


def show_interfaces(compared: Interfaces) -> None:
    """What each choice of interface changes of each entry, and what the choices are."""
    own = compared.own.choice
    names = [tested.choice.name for tested in compared.others]
    title = f"Compliance of the {compared.part} ({own.name}), and what other interfaces change"
    table = new_table(title, "entry", "unit", "value", "± 95 %", *names)
    for e in compared.entries:
        changes = (f"{round(100 * c, 1) + 0:+.1f} ± {100 * b:.2g} %" for c, b in zip(e.changes, e.bars, strict=True))
        table.add_row(e.name, e.unit, f"{e.own:.6g}", _percent(e.error, e.own), *changes)
    out = console()
    out.print(table)
    for tested in compared.others:
        choice = tested.choice
        chosen = " ".join(f"--set '{o}'" if " " in o else f"--set {o}" for o in choice.overrides)
        out.print(f"  {choice.name}: {choice.words} ({chosen})", markup=False, soft_wrap=True)
    for line in compared.left_out:
        out.print(f"  {line}", markup=False, soft_wrap=True)


def show_stiffness(
    names: Sequence[str],
    poses: Any,
    stiffness: Any,
    sag: Any | None = None,
    bars: Any | None = None,
    *,
    title: str = "Stiffness at M",
) -> None:
    """Principal stiffness and the two couplings at each pose, with the bounds that the parts' experiments leave."""
    columns = ["pose", "x, y, z (m)", *STIFFNESSES, "K_15", "K_24"]
    table = new_table(f"{title} (10⁶ N/m, 10⁶ N·m/rad, 10⁶ N)", *columns, *(["sag µm"] if sag is not None else []))
    for i, name in enumerate(names):
        k = np.asarray(stiffness[i]) / 1e6
        entries = [*np.diag(k), k[0, 4], k[1, 3]]
        place = ", ".join(f"{c:.4g}" for c in poses[i])
        table.add_row(
            name, place, *(f"{v:.4f}" for v in entries), *([f"{sag[i][2] * 1e6:.2f}"] if sag is not None else [])
        )
        if bars is not None:
            b = np.asarray(bars[i]) / 1e6
            table.add_row("", "± 95 %", *(f"{v:.2g}" for v in (*np.diag(b), b[0, 4], b[1, 3])))
    console().print(table)


def show_deflection(names: Sequence[str], twist: Any, shares: dict[str, Any], wrench: str) -> None:
    """Deflection of the tool, and each component's share of the strain energy."""
    moved = new_table(
        f"Deflection at M under {wrench} N, N·m", "pose", *("x µm", "y µm", "z µm"), *("rx µrad", "ry µrad", "rz µrad")
    )
    for name, row in zip(names, np.asarray(twist) * 1e6, strict=True):
        moved.add_row(name, *(f"{v:.4g}" for v in row))
    console().print(moved)
    where = new_table("Where it yields: share of the strain energy, %", "component", *names)
    for part, share in sorted(shares.items(), key=lambda item: -float(np.max(item[1]))):
        where.add_row(part, *(f"{100 * v:.2f}" for v in share))
    console().print(where)


def show_change(names: Sequence[str], old: Any, new: Any, overrides: Sequence[str]) -> None:
    """Stiffness before and after `--set`, side by side."""
    table = new_table(f"Changed: {', '.join(overrides)}", "pose", "", *STIFFNESSES)
    for i, name in enumerate(names):
        before, after = np.diag(old[i]), np.diag(new[i])
        table.add_row(name, "before", *(f"{v / 1e6:.4f}" for v in before))
        table.add_row("", "now", *(f"{v / 1e6:.4f}" for v in after))
        table.add_row("", "change", *(f"{100 * (b / a - 1):+.2f} %" for a, b in zip(before, after, strict=True)))
    console().print(table)


def show_matrix(title: str, matrix: Any) -> None:
    """A 6x6 with row and column names."""
    table = new_table(title, "", "fx", "fy", "fz", "mx", "my", "mz")
    for name, row in zip(("vx", "vy", "vz", "ωx", "ωy", "ωz"), np.asarray(matrix), strict=True):
        table.add_row(name, *(f"{v:.5g}" for v in row))
    console().print(table)


def show_each_interface(result: PartResult) -> None:
    """The 6x6 at each of a part's loaded interfaces, and where to find what couples them."""
    points, flexibility = result.facts["reference_points"], np.asarray(result.facts["flexibility"])
    for k, point in enumerate(points):
        place = ", ".join(f"{1e3 * c:.5g}" for c in point)
        own = slice(6 * k, 6 * k + 6)
        show_matrix(
            f"Compliance of the {result.name} at its interface {k + 1}, ({place}) mm, loaded alone; SI",
            flexibility[own, own],
        )
    size = len(flexibility)
    show_line(f"All {len(points)} interfaces together: {size} x {size}, with --json or --superelement\n")


def show_faces(file: str, rows: Sequence[dict[str, Any]]) -> None:
    """The faces of a solid, and how a robot file chooses among them."""
    table = new_table(f"Faces of {file}", "index", "kind", "area mm²", "centroid mm", "normal or axis", "radius mm")
    for row in rows:
        centroid = ", ".join(f"{c:.6g}" for c in row["centroid_mm"])
        axis = ", ".join(f"{c:.4g}" for c in row["axis"]) if row["axis"] else ""
        radius = f"{row['radius_mm']:g}" if row["radius_mm"] else ""
        table.add_row(str(row["index"]), row["kind"], f"{row['area_mm2']:.6g}", centroid, axis, radius)
    out = console()
    out.print(table)
    out.print("Choose faces by geometry in a robot file, or by index:", markup=False)
    out.print(f'  [slider.step]\n  file = "{file}"', markup=False)
    out.print('  clamped = [{ kind = "plane", normal = [-1, 0, 0], position = "min x" }]', markup=False)
    out.print('  loaded = [{ kind = "cylinder", radius = "8 mm" }, { index = 3 }]', markup=False)


def show_line(text: str) -> None:
    """A plain line between tables."""
    console().print(text, markup=False, soft_wrap=True)


def _ratio(value: float, other: float) -> str:
    return f"{value / other:.4g}" if other else "-"


def _percent(error: float, value: float) -> str:
    return f"{100 * abs(error / value):.2g} %" if value else "-"


def show_findings(title: str, findings: Sequence[Finding]) -> None:
    """Published numbers beside what they should be, with a verdict each."""
    table = new_table(title, "entry", "published", "as published (R1)", "correct", "bound")
    table.add_column("verdict", justify="left", overflow="fold")
    for f in findings:
        table.add_row(f.entry, *(_number(v) for v in (f.published, f.as_published, f.correct, f.bound)), f.verdict)
    console().print(table)


def _number(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.5g}"
