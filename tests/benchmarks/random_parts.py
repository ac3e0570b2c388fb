"""Random links and sliders: bores, end fittings, ribs, fillets, bolt holes, pads; random interfaces."""

from stiffscope.cad import link, slider
from stiffscope.cad.solid import build
from stiffscope.errors import InputError


def draw(rng):
    """Return a random part and its interface, from NumPy's generator; parts that cannot be are drawn again."""
    while True:
        try:
            part = _link(rng) if rng.random() < 0.35 else _slider(rng)
        except InputError:
            continue
        return part, str(rng.choice(["rigid", "distributed"]))


def _link(rng):
    radius = rng.uniform(8e-3, 25e-3)
    length = rng.uniform(0.1, 0.5)
    bore = 2 * radius * rng.uniform(0.3, 0.75) if rng.random() < 0.6 else 0.0
    fitted = rng.random() < 0.4
    return build(
        link.LinkParameters(
            length,
            radius,
            bore,
            fitting_radius=radius * rng.uniform(1.15, 1.5) if fitted else 0.0,
            fitting_length=length * rng.uniform(0.08, 0.2) if fitted else 0.0,
        )
    )


def _slider(rng):
    depth = rng.uniform(60e-3, 140e-3)
    width = rng.uniform(0.12, 0.32)
    ribs, holes, pads = rng.random(3) < 0.5
    return build(
        slider.SliderParameters(
            depth,
            width,
            thickness=rng.uniform(12e-3, 30e-3),
            rib_count=int(rng.integers(1, 4)) if ribs else 0,
            rib_thickness=rng.uniform(8e-3, 16e-3),
            rib_height=rng.uniform(10e-3, 25e-3),
            rib_length=depth * rng.uniform(0.5, 0.85),
            fillet=rng.uniform(3e-3, 6e-3) if ribs and rng.random() < 0.4 else 0.0,
            hole_count=int(rng.integers(1, 5)) if holes else 0,
            hole_diameter=rng.uniform(6e-3, 14e-3),
            hole_offset=depth * rng.uniform(0.2, 0.4),
            pad_height=rng.uniform(4e-3, 12e-3) if pads else 0.0,
            pad_width=rng.uniform(20e-3, 32e-3),
            pad_spacing=width * rng.uniform(0.2, 0.32),
        )
    )
