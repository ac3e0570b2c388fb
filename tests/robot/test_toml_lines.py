"""Every key, table and list item of a TOML text has its line."""

import subprocess
import sys
import tomllib

import pytest

from stiffscope.data import FOLDER
from stiffscope.errors import InputError
from stiffscope.robot.robot_file import load_robot
from stiffscope.robot.toml_lines import key_lines, line_of

TEXT = '''# "a" = 1
name = "x # no comment ] = "          # [a]
a.b."c.d" = 1.5e3
when = 1979-05-27 07:32:00
text = """
b = 3
\\""" ] ""\"""
raw = \'\'\'
[bodies] \'\'\'
[bodies."leg1.arm"]
base = [
  1,  # one, two
  ["= 0.18 + a*cos(th)", 0],
]
drive = { stiffness = "24 kN", range = [-60,
  80] }
[[effects]]
[effects.parameters]
factor = 0.8
[[effects]]
parameters.factor = 0.9
'q\\' = 1
'''
LINES = {
    ("name",): 2, ("a",): 3, ("a", "b"): 3, ("a", "b", "c.d"): 3, ("when",): 4, ("text",): 5, ("raw",): 8,
    ("bodies",): 10, ("bodies", "leg1.arm"): 10, ("bodies", "leg1.arm", "base"): 11,
    ("bodies", "leg1.arm", "base", 0): 12,
    ("bodies", "leg1.arm", "base", 1): 13, ("bodies", "leg1.arm", "base", 1, 0): 13,
    ("bodies", "leg1.arm", "base", 1, 1): 13, ("bodies", "leg1.arm", "drive"): 15,
    ("bodies", "leg1.arm", "drive", "stiffness"): 15, ("bodies", "leg1.arm", "drive", "range"): 15,
    ("bodies", "leg1.arm", "drive", "range", 0): 15, ("bodies", "leg1.arm", "drive", "range", 1): 16,
    ("effects",): 17, ("effects", 0): 17, ("effects", 0, "parameters"): 18, ("effects", 0, "parameters", "factor"): 19,
    ("effects", 1): 20, ("effects", 1, "parameters"): 21, ("effects", 1, "parameters", "factor"): 21,
    ("effects", 1, "q\\"): 22,
}  # fmt: skip


def paths(value, path=()):
    """All paths into what tomllib reads."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*path, key)
        yield from paths(item, (*path, key))


def test_lines():
    assert key_lines(TEXT) == LINES
    assert set(paths(tomllib.loads(TEXT))) == set(LINES)


@pytest.mark.parametrize("file", sorted(FOLDER.rglob("*.toml")), ids=lambda file: file.name)
def test_every_key_that_tomllib_reads_has_a_line(file):
    text = file.read_text(encoding="utf-8")
    lines = key_lines(text)
    assert set(paths(tomllib.loads(text))) == set(lines)
    for path, line in lines.items():
        if isinstance(path[-1], str):
            assert path[-1] in text.splitlines()[line - 1]


def test_an_absent_key_has_the_line_of_its_table():
    lines = key_lines(TEXT)
    assert line_of(lines, ("effects", 1, "place")) == 20
    assert line_of(lines, ("nosuch", "x")) == 1


def test_a_long_file_is_refused_at_once(tmp_path):
    file = tmp_path / "robot.toml"
    text = (FOLDER / "biglide.toml").read_text(encoding="utf-8")
    poses = "\n".join(f'P{i} = ["0 mm", "1 mm", "{i} mm"]' for i in range(20_000))
    text = text.replace("[poses]", f"[poses]\n{poses}", 1) + "\n[drivee]\nx = 1\n"
    file.write_text(text, encoding="utf-8")
    code = (  # in a process of its own, whose time no measurement of coverage adds to
        "import sys, time; from pathlib import Path; from stiffscope.robot.toml_lines import key_lines;"
        "text = Path(sys.argv[1]).read_text(encoding='utf-8'); begun = time.process_time();"
        "key_lines(text); print(time.process_time() - begun)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.0
    with pytest.raises(InputError, match=rf"robot\.toml:{text.count(chr(10)) - 1}: drivee: unknown key"):
        load_robot(file)
