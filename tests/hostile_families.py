"""Valid files of each kind that a stranger may hand in, small enough to be answered in a second."""

from __future__ import annotations

import io
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from stiffscope.data import FOLDER
from tests.hostile import Family, run, warm

SECTIONS = b"""
name = "bench"
[parameters]
reach = "300 mm"
ratio = 5
[groups]
arms = ["upper", "fore"]
[materials.mine]
youngs_modulus = "70 GPa"
shear_modulus = "26 GPa"
density = "2700 kg/m^3"
[parts.tube]
shape = "tube"
radius = "20 mm"
wall = "2 mm"
length = "= reach"
material = "steel"
compliance = "beam"
[parts.box]
shape = "box"
width = "30 mm"
height = "40 mm"
wall = "2 mm"
length = "= reach - 0.1"
material = "mine"
compliance = "beam"
[parts.link]
shape = "matrix"
matrix = [[1e-9, 0, 0, 0, 0, 0], [0, 2e-7, 0, 0, 0, 1e-6], [0, 0, 2e-7, 0, -1e-6, 0],
  [0, 0, 0, 2e-5, 0, 0], [0, 0, -1e-6, 0, 1.1e-5, 0], [0, 1e-6, 0, 0, 0, 1.1e-5]]
mass = "120 g"
[bodies.base]
mass = "2 kg"
centre = [0, 0, "20 mm"]
inertia = [0.01, 0.01, 0.012, 0, 0, 0]
[bodies.upper]
part = "tube"
base = [0, 0, "50 mm"]
tip = ["= reach", 0, "50 mm"]
y = [0, 1, 0]
[bodies.fore]
part = "box"
base = ["= reach", 0, "50 mm"]
tip = ["= reach", "= reach - 0.1", "50 mm"]
y = [-1, 0, 0]
[bodies.last]
part = "link"
base = ["= reach", "= reach - 0.1", "50 mm"]
tip = ["= reach + 0.1", "= reach - 0.1", "50 mm"]
y = [0, 1, 0]
[joints.rail]
between = ["ground", "base"]
type = "prismatic"
at = [0, 0, 0]
axis = [0, 0, 1]
drive = { stiffness = "100 N/um \xc2\xb1 10 %", range = ["-50 mm", "80 mm"] }
[[joints.rail.bearing]]
kind = "linear-guide"
vertical = "300 N/um"
lateral = "200 N/um"
rails = 2
rail_spacing = "200 mm"
carriages = 2
carriage_spacing = "150 mm"
normal = [0, -1, 0]
[[joints.rail.bearing]]
kind = "ball-screw"
diameter = "20 mm"
length = "600 mm"
nut = "300 N/um"
support = "150 N/um"
[joints.shoulder]
between = ["base", "upper.base"]
type = "revolute"
at = [0, 0, "50 mm"]
axis = [0, 0, 1]
drive = { curve = [["0.1 mrad", "1 N*m"], ["0.5 mrad", "9 N*m"]], backlash = 0, range = ["-60 deg", "80 deg"] }
bearing = { kind = "angular-contact", balls = 16, ball = "12 mm", pitch = "80 mm", angle = "25 deg", preload = "500 N" }
[joints.elbow]
between = ["upper.tip", "fore.base"]
type = "revolute"
at = ["= reach", 0, "50 mm"]
axis = [0, 0, 1]
drive = { gear = { k1 = "24 kN*m/rad", t1 = "20 N*m", k2 = "30 kN*m/rad", t2 = "60 N*m", k3 = "40 kN*m/rad" } }
compliance = { radial = "0.01 um/N", axial = "0.02 um/N", tilting = "2e-6 rad/(N*m)" }
[joints.wrist]
between = ["fore.tip", "last.base"]
type = "fixed"
at = ["= reach", "= reach - 0.1", "50 mm"]
[tool]
body = "last.tip"
at = ["= reach + 0.1", "= reach - 0.1", "50 mm"]
pose = ["x", "y", "z"]
[gravity]
direction = [0, 0, -1]
acceleration = "9.81 m/s^2"
[poses]
home = ["= reach + 0.1", "= reach - 0.1", "50 mm"]
low = ["350 mm", "250 mm", "40 mm"]
"""
STUDY = b"""
robot = "robot.toml"
components = "beam"
method = "grid"
set = ["rail.drive.stiffness=120 N/um"]
constraints = ["mass <= 12 kg", "each >= 1"]
[parameters]
tube.radius = ["15 mm", "30 mm"]
box.wall = { range = ["1 mm", "3 mm"], steps = 2 }
parameters.reach = { values = ["290 mm", "300 mm"] }
tube.material = { values = ["steel", "titanium"] }
[responses]
stiffness = { of = "K_tx", at = ["home"], take = "worst" }
mass = "mass"
each = { of = "K_tx/mass", unit = "N/m/kg", take = "worst" }
gain = { of = "K11 + K_ty", unit = "N/m", at = ["home"] }
first = "f1"
"""
CAMPAIGN = b"""
robot = "robot.toml"
modelled = ["gravity"]
components = "beam"
readings = "readings.csv"
ignore = ["note"]
units = { value = "um", sigma = "um", fx = "N" }
[sensors.gauge]
measures = "displacement"
body = "fore.tip"
at = ["300 mm", "100 mm", "50 mm"]
direction = [0, 0, 1]
against = "ground"
zero = "session"
[loads.hook]
body = "fore.tip"
at = ["300 mm", "100 mm", "50 mm"]
"""
ROWS = (
    (
        "x",
        "y",
        "z",
        "load",
        "fx",
        "fz",
        "sensor",
        "quantity",
        "value",
        "sigma",
        "session",
        "note",
    ),
    (0.4, 0.2, 0.05, "", 100, 0, "", "dx", 4.2, 1, "a", "first"),
    (0.4, 0.2, 0.05, "hook", 0, -100, "gauge", "", -3.5, 1, "a", ""),
    (0.35, 0.25, 0.04, "", 0, 0, "", "ez", 11, 2, "b", ""),
    (0.35, 0.25, 0.04, "", 0, 0, "gauge", "", 0.5, 2, "b", "last"),
)


@cache
def _workbook() -> bytes:
    from openpyxl import Workbook

    book = Workbook()
    whole = io.BytesIO()
    for row in ROWS:
        book.active.append(row)
    book.save(whole)
    return whole.getvalue()


def _robots(name: str) -> bytes:
    return (FOLDER / "robots" / name).read_bytes()


JSON = ("--json", "out.json", "--quiet")
STIFFNESS = ("stiffness", "robot.toml", "--components", "beam", *JSON)
SHEET = {"campaign.toml": CAMPAIGN.replace(b".csv", b".xlsx"), "robot.toml": SECTIONS}


CSV = "\n".join(",".join(map(str, row)) for row in ROWS).encode()
CHECK = ("campaign", "check", ".", *JSON)
IMPORTS = ("--out", "robot.toml", *JSON)
PLAIN = {
    "stewart": Family(
        {"robot.toml": _robots("stewart.toml")}, ("robot.toml",), STIFFNESS
    ),
    "sections": Family({"robot.toml": SECTIONS}, ("robot.toml",), STIFFNESS),
    "check": Family(
        {"robot.toml": SECTIONS}, ("robot.toml",), ("check", "robot.toml", *JSON)
    ),
    "csv": Family(
        {"campaign.toml": CAMPAIGN, "readings.csv": CSV, "robot.toml": SECTIONS},
        ("campaign.toml", "readings.csv"),
        CHECK,
    ),
}
"""Those that need neither CAD nor processes of their own."""


@cache
def families() -> dict[str, Family]:
    """All of them by name; those of solids are built here."""
    from tests.imports.test_import import ARM, FOUR_BAR

    return {
        **PLAIN,
        "study": Family(
            {"study.toml": STUDY, "robot.toml": SECTIONS},
            ("study.toml",),
            ("study", "study.toml", "--out", "out", *JSON),
            ("check", "robot.toml", *JSON),
        ),
        "urdf": Family(
            {"arm.urdf": ARM.encode()}, ("arm.urdf",), ("import", "arm.urdf", *IMPORTS)
        ),
        "mjcf": Family(
            {"bar.xml": FOUR_BAR.encode()},
            ("bar.xml",),
            ("import", "bar.xml", *IMPORTS),
        ),
        "xlsx": Family(
            {**SHEET, "readings.xlsx": _workbook()}, ("readings.xlsx",), CHECK
        ),
        **_of_solids(),
    }


def _of_solids() -> dict[str, Family]:
    from tests.imports.assemblies import LOW, Made, at, b, rod

    with TemporaryDirectory() as folder:
        made = Made()
        made.add("base", b.Box(80, 40, 20, align=LOW) - at(rod(5, 20), (25, 0, 0)))
        bores = at(rod(5, 10), (25, 0, 20)), at(rod(4, 10), (100, 0, 20))
        made.add(
            "arm", at(b.Box(100, 20, 10, align=LOW), (60, 0, 20)) - bores[0] - bores[1]
        )
        made.add("pin", at(rod(5, 30), (25, 0, 0)))
        made.write(Path(folder) / "a.step")
        assembly = (Path(folder) / "a.step").read_bytes()
        b.export_step(b.Box(80, 40, 20), Path(folder) / "p.step")
        part = (Path(folder) / "p.step").read_bytes()
    words = b"""ground = "base"
tool = "arm"
part = ["pin"]
rigid = ["base"]
[joint]
"base/arm" = "revolute"
[material]
"arm" = "steel"
"*" = "aluminium-7075"
[drive]
"base/arm" = "9 kN*m/rad"
"""
    files = {"a.step": assembly, "assembly.toml": words}
    begun, ended = SECTIONS.split(b"[parts.link]")
    step = b'[parts.link]\nshape = "step"\nfile = "p.step"\nmaterial = "steel"\n'
    solid = (begun + step + ended[ended.index(b"[bodies.base]") :]).replace(
        b"reach + 0.1", b"reach + 0.08"
    )
    return {
        "assembly": Family(files, ("assembly.toml",), ("import", "a.step", *IMPORTS)),
        "solids": Family(files, ("a.step",), ("import", "a.step", *IMPORTS)),
        "faces": Family({"p.step": part}, ("p.step",), ("faces", "p.step", *JSON)),
        "step": Family(
            {"p.step": part, "robot.toml": solid},
            ("p.step",),
            ("check", "robot.toml", *JSON),
        ),
    }


if __name__ == "__main__":
    chosen, count, first = (
        families()[sys.argv[1]],
        int(sys.argv[2]),
        int((*sys.argv, "0")[3]),
    )
    whole, codes = warm(chosen), Counter[int]()
    for seed in range(first, first + count):
        case = run(chosen, seed)
        codes[case.code] += 1
        if case.wrong or (case.code == 0 and "--read" in sys.argv):
            same = "same" if case.answer == whole.answer else "differs"
            sys.stdout.write(
                f"[{seed}] {case.wrong or same} | {case.change} | {case.said[-400:].strip()}\n"
            )
            sys.stdout.flush()
    sys.stdout.write(
        f"as it is: {whole.code} {whole.wrong} {whole.said[:300]}\n{dict(codes)}\n"
    )
