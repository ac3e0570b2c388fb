"""Derivatives of parts beside central differences of experiments on new meshes, every parameter 2 % up and down."""

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

CHANGE = 0.02
NOISE = 1.5e-4  # of a compliance from mesh to mesh, relative
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
    """Rows (parameter, entry, derivative, bound, difference), each times value over compliance."""
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
        value, step = derivative.value, CHANGE * derivative.value
        if key in lengths:
            both = [compliance(variant(key)(value + sign * step), settings) for sign in (1, -1)]
        elif key == "foundation":
            both = [compliance(part, dataclasses.replace(settings, foundation=value + s * step)) for s in (1, -1)]
        else:
            made = [dataclasses.replace(STEEL, **{key: value + sign * step}) for sign in (1, -1)]
            both = [compliance(dataclasses.replace(part, material=each), settings) for each in made]
        difference = (both[0] - both[1]) / (2 * step)
        size = value / experiment.compliance.diagonal()
        for i in range(6):
            one, bound, two = (m[i, i] * size[i] for m in (derivative.compliance, derivative.error, difference[:6, :6]))
            rows.append((key, f"C{i + 1}{i + 1}", one, bound, two))
            print(
                f"{key:14} C{i + 1}{i + 1} {one:9.4f} ± {bound:.4f}  differences {two:9.4f}  {one - two:+.4f}",
                flush=True,
            )
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_derivatives_agree_with_differences_of_experiments_on_new_meshes(name):
    noise = NOISE / CHANGE
    for key, entry, one, bound, two in table(name):
        assert abs(one - two) < max(0.01 * abs(two), bound) + noise, (key, entry)


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
