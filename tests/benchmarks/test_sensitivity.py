"""Derivatives of parts beside central differences of experiments on new meshes, every parameter 2 % up and down.

As two meshes of one part differ, differences are repeated, and have a standard error of their own.
"""

import dataclasses
import time

import numpy as np
import pytest

from stiffscope.cad import link, slider
from stiffscope.cad.materials import STEEL
from stiffscope.fea.experiment import examine, specimen_of
from stiffscope.fea.mesh import default_size
from stiffscope.fea.sensitivity import part_sensitivity
from stiffscope.fea.settings import Settings
from stiffscope.fea.solution import solve_specimen
from stiffscope.fea.specimen import mesh_specimen

CHANGES = (0.0185, 0.0195, 0.0205, 0.0215)  # of a parameter, each a pair of experiments
CERTAIN = 3.0  # standard errors of the mean difference
SLIDER = slider.SliderParameters()
PARTS = {
    "link": (link, link.LinkParameters()),
    "tube": (link, link.LinkParameters(0.3, 0.0125, bore=0.01, fitting_radius=0.018, fitting_length=0.03)),
    "slider": (slider, SLIDER),
    "full": (
        slider,
        dataclasses.replace(
            SLIDER, rib_count=2, rib_pitch=0.14, fillet=0.003, hole_count=3, hole_pitch=0.1, pad_height=0.01,
            rib_thickness=0.014,
        ),
    ),
    "small": (
        slider,
        slider.SliderParameters(
            0.06, 0.09, 0.012, rib_count=1, rib_thickness=0.012, rib_height=0.012, rib_length=0.04, fillet=0.004,
            hole_count=2, hole_diameter=0.008, hole_offset=0.012, hole_pitch=0.06, pad_height=0.006, pad_width=0.012,
            pad_spacing=0.028,
        ),
    ),
}  # fmt: skip


def compliance(part, settings):
    specimen = specimen_of(part, settings)
    mesh = mesh_specimen(specimen, size=settings.size, rigid=settings.interface == "rigid")
    return solve_specimen(specimen, mesh, settings.interface, "auto", settings.foundation).compliance


def table(name, only=(), settings=None):
    """Rows (parameter, entry, derivative, bound, mean difference, its standard error), times value over compliance."""
    settings = settings or Settings()
    module, parameters = PARTS[name]
    part = module.build(parameters)
    experiment = examine(specimen_of(part, settings), settings)

    def variant(key):
        return lambda value: module.build(dataclasses.replace(parameters, **{key: value}))

    lengths = parameters.lengths()
    begun = time.perf_counter()
    found = part_sensitivity(experiment, part, settings, {k: (v, variant(k)) for k, v in lengths.items()})
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
        pairs = [(tested(key, value * (1 + c)) - tested(key, value * (1 - c))) / (2 * c * value) for c in CHANGES]
        pairs = np.array([pair.diagonal()[:6] * size for pair in pairs])
        scatter = np.sqrt(np.mean(pairs.var(axis=0, ddof=1)) / len(pairs))  # of all entries alike, else of 4 values
        errors = np.maximum(pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs)), scatter)
        for i in range(6):
            one, bound = (m[i, i] * size[i] for m in (derivative.compliance, derivative.error))
            two, error = pairs[:, i].mean(), errors[i]
            rows.append((key, f"C{i + 1}{i + 1}", one, bound, two, error))
            print(
                f"{key:14} C{i + 1}{i + 1} {one:9.4f} ± {bound:.4f}  differences {two:9.4f} ± {error:.4f}  "
                f"{one - two:+.4f}",
                flush=True,
            )
    off, allowed, scatter = (
        np.array(column)
        for column in zip(
            *((abs(a - b), max(0.01 * abs(b), bar), error) for _, _, a, bar, b, error in rows), strict=True
        )
    )
    print(
        f"{name}: {(off <= allowed).sum()} of {len(off)} within 1 % or the derivative's bar, "
        f"{(off <= allowed + CERTAIN * scatter).sum()} with {CERTAIN:g} standard errors of the differences; "
        f"rms {np.sqrt(np.mean(off**2)):.4f}, worst {off.max():.4f}"
    )
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_derivatives_agree_with_differences_of_experiments_on_new_meshes(name):
    for key, entry, one, bound, two, error in table(name):
        assert abs(one - two) < max(0.01 * abs(two), bound) + CERTAIN * error, (key, entry)


@pytest.mark.slow
def test_derivatives_agree_within_their_bars_with_those_on_a_mesh_twice_as_fine():
    """Sharper than differences, which have the scatter of two meshes in them."""
    module, parameters = PARTS["small"]
    part = module.build(parameters)
    specimen = specimen_of(part, Settings())
    size = default_size(specimen.volume, sum(face.area for face in specimen.surface.faces))
    dimensions = {
        key: (value, lambda other, key=key: module.build(dataclasses.replace(parameters, **{key: other})))
        for key, value in parameters.lengths().items()
    }
    found = []
    for length in (None, 0.55 * size):
        settings = Settings(size=length, modes=0)
        experiment = examine(specimen_of(part, settings), settings)
        found.append(part_sensitivity(experiment, part, settings, dimensions).derivatives)
    scale = experiment.compliance.diagonal()
    offs, bars = [], []
    for key, (value, _) in dimensions.items():
        one, two = (each[key] for each in found)
        offs.append(value * (one.compliance - two.compliance).diagonal() / scale)
        bars.append(value * (one.error + two.error).diagonal() / scale)
    inside = np.abs(offs) < bars
    print(f"\n{inside.mean():.1%} of {inside.size} within their bars, largest difference {np.abs(offs).max():.1e}")
    assert inside.mean() > 0.95
    assert np.abs(offs).max() < 2e-3
