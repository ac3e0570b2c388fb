"""Derivatives of parts beside central differences of experiments on new meshes, every parameter 2 % up and down."""

import dataclasses
import time

import pytest

from stiffscope.cad import link, slider
from stiffscope.cad.materials import STEEL
from stiffscope.fea.experiment import examine, specimen_of
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
