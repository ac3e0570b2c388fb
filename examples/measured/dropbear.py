"""Convert vibration data of a cantilever on a roller whose place is recorded (DROPBEAR).

The data belong to their authors (CC BY-SA 4.0); this script converts your own copy. Clone
https://github.com/High-Rate-SHM-Working-Group/Dataset-8-DROPBEAR-Acceleration-vs-Roller-Displacement, then

    python -m examples.measured.dropbear ".../Slow Postional Displacement/trial data/10steps" --out roller
    stiffscope diagnose roller --out roller/diagnosis
    python -m examples.measured.dropbear ".../10steps" --found roller/diagnosis/diagnosis.json
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.signal import butter, sosfiltfilt

from stiffscope.gap.campaign.writing import number_cells, write_campaign

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SOURCE = """Beam 501 x 51 x 6.66 mm (authors' README), steel; roller 48 to 168 mm from the clamp (their figure).
Converted from High-Rate-SHM-Working-Group/Dataset-8-DROPBEAR, which is the authors'."""
LENGTH = 0.501  # m
THICKNESS = 6.66e-3  # m
YOUNG = 205e9  # Pa
DENSITY = 7850.0  # kg/m³
TRAVEL = (0.048, 0.168)  # m, from the clamp: roller drawn in, and run out
RATE = 5000.0  # Hz
BAND = (15.0, 60.0)  # Hz: about the first frequency
PLACES = 6  # at which the roller rests
NEAR = 0.03  # V: of such a place
LEAST = 3000  # samples of a rest
SETTLED = 200  # samples left out at its start
TAKEN = 4200  # samples, the last one taken
STEP = 1e-2  # of what is known: for derivatives
PLACE = "roller's place"
STRETCH = "roller's travel"
MODULUS = "Young's modulus"
LADDER = ((), (MODULUS,), (PLACE,), (PLACE, STRETCH))
KNOWN = {PLACE: 1e-2, STRETCH: 0.03, MODULUS: 4e9}
"""How well each is known: m and relative, read off a figure; Pa, any steel. Judgement."""


class Rest(NamedTuple):
    """A place at which the roller rests."""

    place: float
    """Distance from the clamp as recorded, m."""
    frequency: float
    """Mean first frequency of all rests there, Hz."""
    sigma: float
    """Scatter of one of them, Hz, as a share of the frequency alike at all places."""


def _find_rests(volts: Array) -> Iterator[tuple[int, slice]]:
    """Yield number of the place and samples of every rest of the roller but the first."""
    smooth = np.convolve(volts, np.full(51, 1 / 51), "valid")
    levels = np.linspace(smooth.min(), smooth.max(), PLACES)
    nearest = np.abs(smooth[:, None] - levels).argmin(axis=1)
    which = np.where(np.abs(smooth - levels[nearest]) < NEAR, nearest, -1)
    ends = (np.flatnonzero(np.diff(which)) + 1).tolist()
    for start, end in zip(ends, [*ends[1:], len(which)], strict=True):
        if which[start] >= 0 and end - start > LEAST:
            yield int(which[start]), slice(start + SETTLED, min(end, start + TAKEN))


def _find_frequency(acceleration: Array) -> float:
    """Return the frequency of the highest peak of a spectrum, Hz."""
    count = 1 << 19  # padded with zeros: a step of 0.01 Hz
    window = np.hanning(len(acceleration))
    spectrum = np.abs(np.fft.rfft(acceleration * window, count))
    return float(np.fft.rfftfreq(count, 1.0 / RATE)[spectrum.argmax()])


def read_rests(folder: Path) -> list[Rest]:
    """Return the roller's places, from the clamp outwards, with the frequencies there."""
    band = butter(4, BAND, btype="band", fs=RATE, output="sos")
    seen: dict[int, list[tuple[float, float]]] = {k: [] for k in range(PLACES)}
    for file in sorted(folder.glob("test*.txt")):
        table = np.loadtxt(file, skiprows=8)
        moved = sosfiltfilt(band, table[:, 1])
        for number, rows in _find_rests(table[:, 2]):
            volts = float(table[rows, 2].mean())
            seen[number].append((volts, _find_frequency(moved[rows])))
    mean = np.array([np.mean(rests, axis=0) for rests in seen.values()])
    variance = [np.var(rests, axis=0, ddof=1)[1] for rests in seen.values()]
    scatter = mean[:, 1] * np.sqrt(np.mean(variance / mean[:, 1] ** 2))
    share = (mean[:, 0] - mean[0, 0]) / (mean[-1, 0] - mean[0, 0])
    places = TRAVEL[0] + share * (TRAVEL[1] - TRAVEL[0])
    return [Rest(*row) for row in np.column_stack([places, mean[:, 1], scatter])]


def first_frequency(place: float, young: float = YOUNG) -> float:
    """Return the first frequency, Hz, of a cantilever pinned at a distance from its clamp, m.

    Up to the pin ``w = A (cosh - cos) + B (sinh - sin)`` of βx; its force adds ``R (sinh - sin)`` of
    β(x - place) beyond. Zero are w at the pin, and w'' and w''' at the end.
    """

    def determinant(beta: float) -> float:
        pin = beta * place
        end = beta * LENGTH
        past = end - pin
        deflection = (np.cosh(pin) - np.cos(pin), np.sinh(pin) - np.sin(pin), 0.0)
        moment = [np.cosh(end) + np.cos(end), np.sinh(end) + np.sin(end)]
        moment.append(np.sinh(past) + np.sin(past))
        shear = [np.sinh(end) - np.sin(end), np.cosh(end) + np.cos(end)]
        shear.append(np.cosh(past) + np.cos(past))
        return float(np.linalg.det(np.array([deflection, moment, shear])))

    tried = np.linspace(1.5, 9.0, 200) / LENGTH
    signs = np.sign([determinant(float(beta)) for beta in tried])
    at = int(np.argmax(signs[1:] != signs[:-1]))
    beta = brentq(determinant, tried[at], tried[at + 1])
    wave = np.sqrt(young * THICKNESS**2 / (12.0 * DENSITY))  # √(EI / ρA), m²/s
    return float(beta**2 * wave / (2.0 * np.pi))


def predict(places: Array, changes: dict[str, float]) -> Array:
    """Return first frequencies (n,), Hz.

    Parameters
    ----------
    places
        Distances (n,) of the roller from the clamp as recorded, m.
    changes
        What differs: how much farther out it is in the middle of its travel, m; relative error of
        the travel; of Young's modulus, Pa.
    """
    middle = 0.5 * (TRAVEL[0] + TRAVEL[1])
    stretch = changes.get(STRETCH, 0.0)
    true = places + changes.get(PLACE, 0.0) + stretch * (places - middle)
    young = YOUNG + changes.get(MODULUS, 0.0)
    return np.array([first_frequency(float(place), young) for place in true])


def convert(rests: list[Rest], folder: Path) -> None:
    """Write the campaign: the model's frequencies and their derivatives at all places but the first."""
    used = rests[1:]
    places = np.array([rest.place for rest in used])
    keys = {
        "pose": [f"{1e3 * rest.place:.0f} mm" for rest in used],
        "quantity": ["f1"] * len(used),
    }
    read = {
        "value": number_cells([rest.frequency for rest in used]),
        "sigma": number_cells([rest.sigma for rest in used]),
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_campaign(folder, {"predictions": "model.csv"}, keys | read, comment=SOURCE)
    nominal = predict(places, {})
    table = keys | {"value": number_cells(nominal)}
    for name, unit in ((PLACE, "m"), (STRETCH, "1"), (MODULUS, "Pa")):
        step = STEP * KNOWN[name]
        slope = (predict(places, {name: step}) - nominal) / step
        table[f"d:{name}[{unit} ± {KNOWN[name]:g}]"] = number_cells(slope)
    with (folder / "model.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))


def fit_plainly(rests: list[Rest], free: tuple[str, ...]) -> tuple[float, float]:
    """Return the relative rms that plain least squares leaves, and the error at the first place."""
    places = np.array([rest.place for rest in rests])
    seen = np.array([rest.frequency for rest in rests])

    def find_errors(values: Array) -> Array:
        changes = {
            name: float(KNOWN[name] * value)
            for name, value in zip(free, values, strict=True)
        }
        return predict(places, changes) / seen - 1.0

    best = np.zeros(len(free))
    if free:
        best = least_squares(lambda values: find_errors(values)[1:], best).x
    left = find_errors(best)
    return float(np.sqrt(np.mean(left[1:] ** 2))), float(left[0])


def predict_first(rests: list[Rest], diagnosis: Path) -> float:
    """Return the relative error at the first place, with what a diagnosis found."""
    found = json.loads(diagnosis.read_text(encoding="utf-8"))["effects"]
    changes = {
        effect["place"]: effect["parameters"]["change"]["value"]
        for effect in found
        if effect["effect"] == "parameter"
    }
    (frequency,) = predict(np.array([rests[0].place]), changes)
    return float(frequency) / rests[0].frequency - 1.0


def main() -> None:
    """Convert the data and show what plain least squares finds, or judge a diagnosis."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, help="folder of the campaign")
    parser.add_argument("--found", type=Path, help="diagnosis.json to judge")
    chosen = parser.parse_args()
    if not list(chosen.data.glob("test*.txt")):
        parser.error(f"{chosen.data}: expected test0.txt to test10.txt in it")
    rests = read_rests(chosen.data)
    if chosen.found is not None:
        error = predict_first(rests, chosen.found)
        print(f"first place, not used: predicted {100 * error:+.2f} % off")
        return
    if chosen.out is not None:
        convert(rests, chosen.out)
    for rest in rests:
        print(f"{1e3 * rest.place:.1f} mm: {rest.frequency:.2f} ± {rest.sigma:.2f} Hz")
    for free in LADDER:
        rms, error = fit_plainly(rests, free)
        what = " and ".join(free) or "nothing"
        print(f"{what} free: {100 * rms:.2f} % rms; first place {100 * error:+.2f} %")


if __name__ == "__main__":
    main()
