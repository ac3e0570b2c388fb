"""Numbers with units become SI; what is not one is refused with an example."""

import math

import pint
import pytest

from stiffscope import data
from stiffscope.robot.file import quantities as q


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("500 mm", q.LENGTH, 0.5),
        ("20mm", q.LENGTH, 0.02),
        ("2 µm", q.LENGTH, 2e-6),
        ("1_000 mm", q.LENGTH, 1.0),
        (".5 m", q.LENGTH, 0.5),
        (0.02, q.LENGTH, 0.02),
        (1, q.LENGTH, 1.0),
        ("1 in", q.LENGTH, 0.0254),
        ("211 GPa", q.MODULUS, 211e9),
        ("211 kN/mm^2", q.MODULUS, 211e9),
        ("12.7 N/um", q.STIFFNESS, 12.7e6),
        ("11.7e-6 1/K", q.EXPANSION, 11.7e-6),
        ("11.7 um/m/K", q.EXPANSION, 11.7e-6),
        ("7.85 g/cm³", q.DENSITY, 7850.0),
        ("2 min", q.DURATION, 120.0),
        ("0.3", q.NUMBER, 0.3),
    ],
)
def test_values(text, dimension, value):
    assert q.to_si(text, dimension) == pytest.approx(value, rel=1e-14)


def test_a_value_is_the_same_number_in_every_unit():
    for n in range(1, 200):
        assert q.to_si(f"{n} mm", q.LENGTH) == n / 1000
        assert q.to_si(f"{n / 10} %", q.NUMBER) == n / 1000


@pytest.mark.parametrize(
    "bad",
    [
        "",
        "mm",
        "nan mm",
        "inf mm",
        "1e999 mm",
        "0 mm",
        "-3 mm",
        "5",
        "3 foo",
        "3 m/0",
        "3 mm; x",
        "1/0 m",
        "3 N m",
        "3 m^2",
        True,
        None,
        [1],
        {"a": 1},
        float("nan"),
        10**400,
        "3 m**9999999",
        "3 mm mm",
    ],
)
def test_refusals_are_one_line_with_an_example(bad):
    with pytest.raises(
        ValueError, match='expected a length such as "20 mm"'
    ) as refused:
        q.to_si(bad, q.LENGTH)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize(
    ("text", "noun"),
    [
        ("24 kN*m/rad", "a torsional stiffness"),
        ("5 N*m", "a moment"),
        ("5 N*mm/mrad", "a torsional stiffness"),
    ],
)
def test_what_is_per_radian_is_named_so(text, noun):
    with pytest.raises(ValueError, match=f"which is {noun}$"):
        q.to_si(text, q.STIFFNESS)


@pytest.mark.parametrize(
    ("text", "dimension", "why"),
    [
        ("5e4 N*m*rad", q.TORSION, "which has radians to the power 1"),
        ("5e4 N*m/rad/rad", q.TORSION, "which has radians to the power -2"),
        ("5 N*m/rad", q.MOMENT, "which is a torsional stiffness"),
        ("5 mm*deg", q.LENGTH, "which has radians to the power 1"),
        ("60 rpm", q.FREQUENCY, "which has radians to the power 1"),
        ("60 %", q.ANGLE, 'and "%" is not a unit'),
        ("0,5 kg", q.MASS, "which has a decimal comma; write a point"),
        ("30 deg", q.NUMBER, "which is an angle"),
        ("60 ppm", q.ANGLE, 'and "ppm" is not a unit'),
    ],
)
def test_radians_are_counted_and_shares_are_no_angles(text, dimension, why):
    with pytest.raises(
        ValueError, match=f"expected {dimension.noun} such as .*, got .*, {why}$"
    ):
        q.to_si(text, dimension, sign="any")


def test_radians_may_be_left_out():
    assert q.to_si("2 mm/m", q.ANGLE) == 0.002
    assert q.to_si("5 kN*m", q.TORSION) == 5000.0
    assert q.to_si("5 J/turn", q.TORSION) == pytest.approx(5.0 / math.tau)
    assert q.to_si("2e-6 1/(N*m)", q.TILTING) == 2e-6


def test_several_values_each_have_their_unit():
    wrench = (*[q.FORCE] * 3, *[q.MOMENT] * 3)
    assert q.several("100 N, 0,-2e3 ,0,0 N*m,5 N*mm", *wrench) == pytest.approx(
        (100, 0, -2000, 0, 0, 0.005)
    )
    for bad, message in (
        ("1 m,0,0,0,0,0", "a force such as .* which is a length"),
        ("1,2", "expected 6 values"),
    ):
        with pytest.raises(ValueError, match=message):
            q.several(bad, *wrench)


def test_usual_units_are_what_pint_says(monkeypatch):
    def answer(unit, si):
        try:
            return q.to_si(f"7.3 {unit}", q.Dimension("a value", si), sign="any")
        except ValueError as error:
            return str(error)

    pairs = [(unit, si) for unit in q.USUAL for si in q.SI]
    ours = [answer(*pair) for pair in pairs]
    assert (
        sum(isinstance(each, float) for each in ours) == len(q.USUAL) + 1
    )  # N*m as torsion
    monkeypatch.setattr(q, "USUAL", {})
    q._factor.cache_clear()
    assert [answer(*pair) for pair in pairs] == ours


def test_our_units_are_those_of_pints_own_list():
    """One of each unit, in SI, read from both lists."""
    ours = pint.UnitRegistry(str(data.FOLDER / "units.txt"))
    pints = pint.UnitRegistry()
    names = [
        str(name)
        for name in ours
        if str(name).isidentifier() and str(name) not in {"pi", "π"}
    ]
    assert len(names) > 50
    for name in names:
        quantities = [
            registry.Quantity(1.0, name).to_base_units() for registry in (ours, pints)
        ]
        base = pints.Quantity(1.0, str(quantities[0].units)).to_base_units()
        assert quantities[0].magnitude * base.magnitude == pytest.approx(
            quantities[1].magnitude, rel=1e-12
        ), name
