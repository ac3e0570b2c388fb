"""A robot of one part: it stands on a slide along its own x, and its tip is the tool."""

from stiffscope.robot.reader import read_robot

DRIVE = 1e7  # N/m
LENGTH = 0.060
DEPTH = 0.010
WIDTH = 0.020  # m, of the bar in `bar.step`

ROBOT = """
name = "one"

[parts."bar 1"]
{part}

[bodies.arm]
part = "bar 1"
base = [0, 0, 0]
tip  = ["{length} mm", 0, 0]
y    = [0, 1, 0]

[joints.slide]
between = ["ground", "arm.base"]
type  = "prismatic"
at    = [0, 0, 0]
axis  = [1, 0, 0]
drive = {{ stiffness = 1e7, range = ["-50 mm", "50 mm"] }}

[tool]
body = "arm.tip"
at   = ["{length} mm", 0, 0]
pose = ["x"]

[gravity]
direction = [0, 0, -1]

[poses]
home = ["{length} mm"]
"""
STEP = (
    'shape = "step"\nfile = "bar.step"\nmaterial = "steel"\nmesh = { size = "10 mm" }'
)
ROD = 'shape = "rod"\nlength = "60 mm"\nradius = "6 mm"\nmaterial = "steel"\nmesh = { size = "8 mm" }'
PLATE = 'shape = "plate"\ndepth = "60 mm"\nwidth = "90 mm"\nthickness = "10 mm"\nmaterial = "steel"'
MATRIX = f'shape = "matrix"\nmatrix = {[[1e-8 * (i == j) for j in range(6)] for i in range(6)]}\nmass = "80 g"'


def one_part(folder, part, length=60.0, name="robot.toml"):
    """The robot, its file in a folder."""
    (folder / name).write_text(text := ROBOT.format(part=part, length=length))
    return read_robot(folder / name, text)


def write_bar(path, shift=0.0):
    """A square bar along x as a STEP file; its clamped face is at x = `shift` (m)."""
    from build123d import Align, Box, Pos, export_step

    bar = Pos(1e3 * shift, 0, 0) * Box(
        1e3 * LENGTH,
        1e3 * WIDTH,
        1e3 * DEPTH,
        align=(Align.MIN, Align.CENTER, Align.CENTER),
    )
    export_step(bar, str(path))
