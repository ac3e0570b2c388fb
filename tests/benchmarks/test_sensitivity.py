"""Derivatives of parts beside central differences of experiments on new meshes, every parameter 2 % up and down.

As two meshes of one part differ, differences are repeated: they have a standard error, and the bars of the experiments.
"""

import dataclasses
import time

import numpy as np
import pytest

from stiffscope.cad import link, slider
from stiffscope.cad.materials import STEEL
from stiffscope.cad.solid import build
from stiffscope.fea.mesh import default_size
from stiffscope.fea.run import run_experiment, specimen_of
from stiffscope.fea.sensitivity import part_sensitivity
from stiffscope.fea.settings import Settings
from stiffscope.fea.solution import solve_specimen
from stiffscope.fea.specimen import mesh_specimen

pytestmark = pytest.mark.slow

CHANGES = (0.019, 0.021)  # of a parameter, each a pair of experiments
SCATTER = 0.005  # rms of derivative less difference, each times value over compliance
SLIDER = slider.SliderParameters()
PARTS = {
    "link": link.LinkParameters(),
    "tube": link.LinkParameters(
        0.3, 0.0125, bore=0.01, fitting_radius=0.018, fitting_length=0.03
    ),
    "slider": SLIDER,
    "full": dataclasses.replace(
        SLIDER,
        rib_count=2,
        rib_pitch=0.14,
        fillet=0.003,
        hole_count=3,
        hole_pitch=0.1,
        pad_height=0.01,
        rib_thickness=0.014,
    ),
    "small": slider.SliderParameters(
        0.06,
        0.09,
        0.012,
        rib_count=1,
        rib_thickness=0.012,
        rib_height=0.012,
        rib_length=0.04,
        fillet=0.004,
        hole_count=2,
        hole_diameter=0.008,
        hole_offset=0.012,
        hole_pitch=0.06,
        pad_height=0.006,
        pad_width=0.012,
        pad_spacing=0.028,
    ),
}


def compliance(part, settings):
    """Diagonals (2, 6) of the compliance and of its error bound."""
    specimen = specimen_of(part, settings)
    mesh = mesh_specimen(
        specimen, size=settings.size, rigid=settings.interface == "rigid"
    )
    solution = solve_specimen(
        specimen, mesh, settings.interface, "auto", settings.foundation
    )
    return np.stack([solution.compliance.diagonal()[:6], solution.error.diagonal()[:6]])


def table(name, only=(), settings=None):
    """Rows (parameter, entry, derivative, its bound, mean difference, its bar), times value over compliance."""
    settings = settings or Settings()
    parameters = PARTS[name]
    part = build(parameters)
    experiment = run_experiment(specimen_of(part, settings), settings)

    def variant(key):
        return lambda value: build(dataclasses.replace(parameters, **{key: value}))

    lengths = parameters.lengths()
    begun = time.perf_counter()
    found = part_sensitivity(
        experiment, part, settings, {k: (v, variant(k)) for k, v in lengths.items()}
    )
    print(
        f"\n{name}: {len(experiment.mesh.points)} nodes, experiment {experiment.seconds}, derivatives {found.seconds}"
    )
    print(f"{name}: all in {time.perf_counter() - begun:.1f} s; notes {found.notes}")
    rows = []
    for key, derivative in found.derivatives.items():
        if key == "density" or (only and key not in only):
            continue
        value = derivative.value

        def tested(key, other):
            if key in lengths:
                return compliance(variant(key)(other), settings)
            if key == "foundation":
                return compliance(part, dataclasses.replace(settings, foundation=other))
            material = dataclasses.replace(STEEL, **{key: other})
            return compliance(dataclasses.replace(part, material=material), settings)

        size = value / experiment.compliance.diagonal()
        pairs = []
        for c in CHANGES:
            (above, one_bar), (below, other_bar) = (
                tested(key, value * (1 + sign * c)) for sign in (1, -1)
            )
            pairs.append(
                np.stack([above - below, one_bar + other_bar]) / (2 * c * value) * size
            )
        (mean, bars) = np.mean(pairs, axis=0)
        spread = np.std(pairs, axis=0, ddof=1)[0] / np.sqrt(len(pairs))
        for i in range(6):
            one, bound = (
                m[i, i] * size[i] for m in (derivative.compliance, derivative.error)
            )
            rows.append((key, f"C{i + 1}{i + 1}", one, bound, mean[i], bars[i]))
            print(
                f"{key:14} C{i + 1}{i + 1} {one:9.4f} ± {bound:.4f}  differences {mean[i]:9.4f} ± {bars[i]:.4f} "
                f"(standard error {spread[i]:.4f})  {one - mean[i]:+.4f}",
                flush=True,
            )
    one, bound, mean, bars = (
        np.array(column) for column in list(zip(*rows, strict=True))[2:]
    )
    off = np.abs(one - mean)
    near = 0.01 * np.abs(mean)
    print(
        f"{name}: {(off <= np.maximum(near, bound)).sum()} of {len(off)} within 1 % or the derivative's bar, "
        f"{(off <= np.maximum(near, bound + bars)).sum()} within 1 % or both bars; "
        f"rms {np.sqrt(np.mean(off**2)):.4f}, worst {off.max():.4f}"
    )
    return rows


@pytest.mark.long
@pytest.mark.parametrize("name", PARTS)
def test_derivatives_agree_with_differences_of_experiments_on_new_meshes(name):
    rows = table(name)
    for key, entry, one, bound, mean, bars in rows:
        assert abs(one - mean) <= max(0.01 * abs(mean), bound + bars), (key, entry)
    assert (
        np.sqrt(np.mean([(one - mean) ** 2 for _, _, one, _, mean, _ in rows]))
        < SCATTER
    )


@pytest.mark.long
def test_derivatives_agree_within_their_bars_with_those_on_a_mesh_twice_as_fine():
    """Sharper than differences, which have the scatter of two meshes in them."""
    parameters = PARTS["small"]
    part = build(parameters)
    specimen = specimen_of(part, Settings())
    size = default_size(
        specimen.volume, sum(face.area for face in specimen.surface.faces)
    )
    dimensions = {
        key: (
            value,
            lambda other, key=key: build(
                dataclasses.replace(parameters, **{key: other})
            ),
        )
        for key, value in parameters.lengths().items()
    }
    found = []
    for length in (None, 0.55 * size):
        settings = Settings(size=length, modes=0)
        experiment = run_experiment(specimen_of(part, settings), settings)
        found.append(
            part_sensitivity(experiment, part, settings, dimensions).derivatives
        )
    scale = experiment.compliance.diagonal()
    offs = []
    bars = []
    for key, (value, _) in dimensions.items():
        one, two = (each[key] for each in found)
        offs.append(value * (one.compliance - two.compliance).diagonal() / scale)
        bars.append(value * (one.error + two.error).diagonal() / scale)
    inside = np.abs(offs) < bars
    print(
        f"\n{inside.mean():.1%} of {inside.size} within their bars, largest difference {np.abs(offs).max():.1e}"
    )
    assert inside.mean() > 0.95
    assert np.abs(offs).max() < 2e-3
