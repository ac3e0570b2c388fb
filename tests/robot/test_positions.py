"""Every key of a TOML file has its line."""

import tomllib

from stiffscope.robot.file.positions import line_of, positions
from stiffscope.robot.library import ROBOTS

AWKWARD = '''a."b.c" = {x=1, y=[1,
 2, {z="""
# ]
q"""}], w='#'} # c
"q\\"u".r = 2
[[t]]
n = 1
[t.s]
m = 1979-05-27T07:32:00Z
[[t]]
[[t.u]]
f = -1.5e3
"" = 1
[x.y.z]
[x]
k = [[1, 2],
 [3]]
'''


def keys(data, key=()):
    if key:
        yield key
    for name, value in (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    ):
        yield from keys(value, (*key, name))


def test_the_scanner_sees_what_the_parser_sees():
    for text in [AWKWARD, *(path.read_text() for path in ROBOTS.glob("*.toml"))]:
        found = positions(text)
        assert set(found) == set(keys(tomllib.loads(text)))
        lines = text.splitlines()
        for key, line in found.items():
            assert (
                not isinstance(key[-1], str)
                or key[-1].replace('"', '\\"') in lines[line - 1]
            )


def test_lines_of_an_awkward_file():
    found = positions(AWKWARD)
    assert found["a", "b.c", "y", 2, "z"] == 2
    assert found["a", "b.c", "w"] == 4
    assert found["t", 1, "u", 0, "f"] == 12
    assert (found["x",], found["x", "y"], found["x", "k", 1]) == (15, 14, 17)
    assert line_of(found, ("t", 0, "s", "absent", 3)) == 8


def test_lines_of_a_long_file_are_found():
    text = "\n".join(
        f'[bodies."leg{i}.arm"]\npart = "arm"\ntip = ["= 0.18 + a", 0, 0] # c'
        for i in range(7000)
    )
    assert positions(text)["bodies", "leg6999.arm", "tip", 2] == 21000
