"""Expressions are arithmetic and nothing else."""

import math
from pathlib import Path

import pytest

from stiffscope.errors import InputError
from stiffscope.robot.file.expressions import (
    MOST_CHARACTERS,
    check_names,
    is_expression,
    parse,
)
from stiffscope.robot.reader import read_robot


def value(text, **names):
    expression = parse(text)
    check_names(expression, names)
    return expression.value(names)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("= 0.18 + a*cos(th)", 0.18 + 0.2 * math.cos(0.3)),
        ("=2**3**2", 512),
        ("=-2**2", -4),
        ("=(1 + 2)*-3", -9),
        ("=sqrt(4) + sin(pi/2) + tan(0)", 3),
        ("=asin(1) + acos(1) + atan(1)", 0.75 * math.pi),
        ("= atan2(1, -1)", 0.75 * math.pi),
        ("=1_000/1e3", 1),
        (" = a\n + 1", 1.2),
    ],
)
def test_values(text, expected):
    assert is_expression(text)
    assert value(text, a=0.2, th=0.3) == pytest.approx(expected, rel=1e-15)


def test_a_name_with_a_dot_is_a_part_s_parameter():
    assert parse("= 2*arm.length").value({"arm.length": 0.22}) == 0.44


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("=__import__('os')", "expected only"),
        ("=a.__class__", 'got "a.__class__"'),
        ("=abs(a)", "expected only"),
        ("=sin(*a)", "expected only"),
        ("=sin(x=a)", "expected only"),
        ("=[a][0]", "expected only"),
        ("=a if a else a", "expected only"),
        ("=(lambda: a)()", "expected only"),
        ("=True", "expected only"),
        ("=1j", "expected only"),
        ("='a'", "expected only"),
        ("=a//2", "expected only"),
        ("=a % 2", "expected only"),
        ("=sin(a).real", "expected only"),
        ("=a^2", r"a power is \*\*"),
        ("=sin", "without its argument"),
        ("=atan2(1)", r"expected 2 arguments of atan2, got 1"),
        ("=aa", 'did you mean "a"'),
        ("=1/0", "division by zero"),
        ("=sqrt(-1)", "real value"),
        ("=(-8)**(1/3)", "real value"),
        ("=asin(2)", "real value"),
        ("=9**9**9**9", "out of range"),
        ("=1e308*10", "too large"),
        ("=1e999", "too large"),
        ("=1" + "0" * 400, "up to 1e308"),
        ("=", "such as"),
        ("=a b", "such as"),
        ("=1;2", "such as"),
        ("=" + "1+" * 150 + "1", "levels"),
        ("=" + "(" * 240 + "1" + ")" * 240, "such as|simpler"),
        ("=" + "1" * (MOST_CHARACTERS + 1), "characters"),
    ],
)
def test_anything_else_is_refused_in_one_line(text, message):
    with pytest.raises(ValueError, match=message) as refused:
        value(text, a=0.2)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith("expected ")


ROD = """
[parameters]
a = "300 mm"
m = "5 kg"
th = "25 deg"
f = 0.1
[parts.rod]
shape = "rod"
radius = "10 mm"
material = "steel"
compliance = "beam"
length = "= LENGTH"
[bodies.rod]
part = "rod"
base = [0, 0, 0]
tip = ["= rod.length", 0, 0]
[joints.root]
between = ["ground", "rod.base"]
type = "revolute"
at = [0, 0, 0]
axis = [0, 0, "= a"]
drive = { stiffness = "24 kN*m/rad" }
[tool]
body = "rod.tip"
at = ["= rod.length", 0, 0]
pose = ["y"]
"""


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ("m", "length: expected a length .* which is a mass"),
        ("th", "length: expected a length .* which is an angle"),
        ("2*m/3", "length: expected a length .* a mass"),
        ("a**2", "length: expected a length .* an area"),
        ("sqrt(m*a)", r"length: expected a length .* in m\^0.5 kg\^0.5"),
        ("a + m", "length: expected .* one kind"),
        ("a*cos(a)", "length: expected an angle or a plain number, got cos"),
        ("atan2(a, a)", "length: .* an angle"),
        ("a", ""),
        ("a - 0.1", ""),
        ("0.3*cos(th)", ""),
        ("a*th", ""),
        ("a*f + f", ""),
        ("sqrt(a**2 + 4*a*a)", ""),
        ("m/15", ""),
        ("f", ""),
        ("a**f", ""),
        ("1 - f", ""),
    ],
)
def test_expressions_carry_what_their_names_measure(text, refusal):
    robot = ROD.replace("LENGTH", text)
    if not refusal:
        assert read_robot(Path("r.toml"), robot).parts["rod"].length > 0.0
        return
    with pytest.raises(InputError, match=rf"^r\.toml:12: parts\.rod\.{refusal}"):
        read_robot(Path("r.toml"), robot)
