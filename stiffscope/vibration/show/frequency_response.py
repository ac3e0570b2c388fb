"""A frequency response as a figure, a table and a netCDF file."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any

import numpy as np

from stiffscope.errors import say_count
from stiffscope.report.figures import new_figure, save_figures
from stiffscope.report.page import Chart, Section, Series
from stiffscope.runtime.formats import write_netcdf, write_table
from stiffscope.vjm.model.mechanism import COORDINATES

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from stiffscope.report.run_report import Draft

COLOURS = ("#3b7dbf", "#d9822b", "#5b9a68", "#8e6bb0", "#b5666a", "#4c9c9c")


@dataclass(frozen=True, eq=False)
class Response:
    """Complex receptance ``values`` (p, f) at frequencies ``hertz`` (f,), poses ``names`` (p,)."""

    robot: str
    names: tuple[str, ...]
    hertz: np.ndarray
    values: NDArray[np.complex128]
    source: str
    target: str
    damping: float
    tool: np.ndarray
    """(n, 6) tool poses: x y z in m, rotation vector from home in rad."""

    @property
    def unit(self) -> str:
        """Unit of the receptance in CF spelling."""
        ways = (text.rpartition(":")[2] for text in (self.target, self.source))
        turns, moment = (way.strip().lstrip("+-").startswith("r") for way in ways)
        return f"{'rad' if turns else 'm'} {'N-1 m-1' if moment else 'N-1'}"

    @property
    def written_unit(self) -> str:
        """Unit of the receptance as written in figures."""
        above, _, below = self.unit.partition(" ")
        return f"{above}/{'(N·m)' if 'm-1' in below else 'N'}"


def write(response: Response, folder: Path) -> None:
    """Write frf.png, frf.svg, frf.csv (one line per pose and frequency) and frf.nc."""
    title = f"{response.robot}: response at {response.target} to {response.source}"
    save_figures(folder, {"frf": lambda: figure(response, title)})
    parts = (f"{part} ({response.written_unit})" for part in ("real", "imaginary"))
    z = response.values.ravel()
    count = len(response.hertz)
    columns = {
        "pose": np.repeat(response.names, count),
        "frequency (Hz)": np.tile(response.hertz, len(response.names)),
        **dict(zip(parts, (z.real, z.imag), strict=True)),
        "magnitude": np.abs(z),
        "phase (deg)": np.angle(z, deg=True),
    }
    write_table(columns, folder / "frf", digits=9)
    write_netcdf(as_dataset(response, title), folder / "frf.nc")


def write_page(response: Response, report: Draft) -> None:
    """Write ``report.html`` with the figure from the folder."""
    r = response
    at = f"Displacement at {r.target} for a harmonic force at {r.source}"
    words = "receptance over frequency: magnitude above, phase below"
    drawn = report.figures({"frf.svg": (f"{at}: magnitude and phase by pose", words)})
    facts = [
        f"force at {r.source}",
        f"displacement at {r.target}",
        f"receptance in {r.written_unit}",
        f"damping ratio of every mode {r.damping:g}",
        say_count(len(r.hertz), "frequency", "frequencies"),
    ]
    sections = [Section("Frequency response", (), drawn, charts=[chart_responses(r)])]
    report.write(f"{r.robot}: frequency response", facts, sections)


def chart_responses(response: Response) -> Chart:
    """Return an interactive chart: magnitude in dB, phase and parts, one series per pose."""
    unit = response.written_unit
    series = []
    for k, (name, values) in enumerate(
        zip(response.names, response.values, strict=True)
    ):
        columns = {
            "pose": list(repeat(name, len(values))),
            "frequency, Hz": response.hertz,
            f"magnitude, dB re 1 {unit}": 20.0
            * np.log10(np.maximum(np.abs(values), 1e-300)),
            "phase, deg": np.angle(values, deg=True),
            f"real part, {unit}": values.real,
            f"imaginary part, {unit}": values.imag,
        }
        series.append(Series(name, COLOURS[k % len(COLOURS)], columns, size=3))
    _, x, *y = series[0].columns
    return Chart(
        series, [x], y, "Values at every frequency and pose.", joined=True, log=True
    )


def as_dataset(response: Response, title: str) -> xr.Dataset:
    """Return the response over pose and frequency: real and imaginary part, magnitude and phase."""
    import xarray as xr

    values = response.values
    kinds = {
        "real": (values.real, response.unit, "receptance, real part"),
        "imaginary": (values.imag, response.unit, "receptance, imaginary part"),
        "magnitude": (np.abs(values), response.unit, "receptance, magnitude"),
        "phase": (np.angle(values), "rad", "receptance, phase"),
    }
    variables = {
        name: (("pose", "frequency"), array, {"units": unit, "long_name": words})
        for name, (array, unit, words) in kinds.items()
    }
    places: dict[str, Any] = {
        "frequency": (
            "frequency",
            response.hertz,
            {"units": "Hz", "long_name": "frequency"},
        ),
        "pose": (
            "pose",
            np.array(response.names, dtype=str),
            {"long_name": "tool pose"},
        ),
    }
    for k, axis in enumerate(COORDINATES):
        words = "tool point M" if k < 3 else "rotation vector of the tool from home"
        meant = {"units": "m" if k < 3 else "rad", "long_name": f"{words}, {axis[-1]}"}
        places[f"tool_{axis}"] = ("pose", response.tool[:, k], meant)
    about = {
        "title": title,
        "source": "stiffscope",
        "Conventions": "CF-1.8",
        "force_at": response.source,
        "displacement_at": response.target,
        "modal_damping_ratio": response.damping,
    }
    return xr.Dataset(variables, places, about)


def figure(response: Response, title: str) -> Figure:
    """Draw magnitude and phase over frequency, one line per pose."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    drawn = new_figure(9.0, 6.0, title)
    upper, lower = drawn.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    for k, (name, values) in enumerate(
        zip(response.names, response.values, strict=True)
    ):
        colour = COLOURS[k % len(COLOURS)]
        upper.loglog(response.hertz, np.abs(values), color=colour, lw=1.4, label=name)
        lower.semilogx(response.hertz, np.angle(values, deg=True), color=colour, lw=1.2)
    upper.set_ylabel(f"receptance ({response.written_unit})")
    damped = f"frequency (Hz); modal damping {100 * response.damping:g} %"
    lower.set(xlabel=damped, ylabel="phase (deg)", ylim=(-185, 185))
    lower.set_yticks([-180, -90, 0, 90, 180])
    lower.xaxis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
    lower.xaxis.set_major_formatter(FuncFormatter(lambda hertz, _: f"{hertz:g}"))
    lower.xaxis.set_minor_formatter(NullFormatter())
    for axes in (upper, lower):
        axes.grid(which="both", color="#e3e7eb", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    for text in upper.legend(frameon=False, loc="lower left").get_texts():
        text.set_parse_math(False)
    return drawn
