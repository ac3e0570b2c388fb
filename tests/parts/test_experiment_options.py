"""A wanted tolerance, a foundation and the choice of interfaces, from the command line to the experiment and back."""

import csv
import json

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.errors import InputError
from stiffscope.experiments.orders import order_part
from stiffscope.parts.interfaces import choices
from stiffscope.robot.library import find_robot
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.executor import Here

pytestmark = pytest.mark.slow

COARSE = (
    "slider.mesh.size=40mm",
    "slider.depth=60mm",
    "slider.width=160mm",
    "slider.pad_spacing=45mm",
    "slider.hole_offset=1mm",
)
WORDS = [word for override in COARSE for word in ("--set", override)]


@pytest.fixture(scope="module")
def kitchen(tmp_path_factory):
    """A cache of this module, and experiments made in this process: CAD is imported once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STIFFSCOPE_CACHE", str(tmp_path_factory.mktemp("cache")))
        stages: list[str] = []

        class Told(Here):
            def submit(self, function, /, *words, **more):
                return super().submit(
                    function,
                    *words,
                    **more | {"report": lambda stage, _: stages.append(stage)},
                )

        patch.setattr("stiffscope.runtime.workshop.Processes", Told)
        yield stages


def compliance(capfd, *words: str) -> tuple[dict, str]:
    assert (
        _guarded(
            ["compliance", "biglide", "--part", "slider", *WORDS, *words, "--json", "-"]
        )
        == 0
    )
    out, err = capfd.readouterr()
    return json.loads(out), err


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            'tolerance  = "2 mm"',
            'slider.mesh.tolerance: expected a share such as "0.1 %", got "2 mm", which is a length',
        ),
        ("tolerance  = 0", "slider.mesh.tolerance: .*greater than zero"),
        (
            "tolerance  = 1.5",
            "slider.mesh.tolerance: expected a share from 1e-6 to below 1",
        ),
        (
            "most_unknowns = 0",
            "slider.mesh.most_unknowns: expected a positive whole number",
        ),
        (
            'foundation = "5 N/m"',
            r'slider.foundation: .* per area such as "5000 N/mm\^3", got "5 N/m", which is a stiff',
        ),
    ],
)
def test_refused_by_line_and_field(tmp_path, line, message):
    before, slider = find_robot("biglide").read_text().split("[parts.slider] ")
    key = line.split()[0]
    slider = "\n".join(
        line if old.split()[:1] == [key] else old for old in slider.splitlines()
    )
    text = before + "[parts.slider] " + slider
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        load_robot(tmp_path / "robot.toml")
    assert str(refused.value).startswith(
        f"{tmp_path / 'robot.toml'}:{text[: text.rindex(line)].count(chr(10)) + 1}: "
    )


@pytest.mark.parametrize("text", ["0.1%", "0.1 %", "1e-3"])
def test_tolerance_of_the_command_line_is_for_both_parts(text):
    robot = load_robot("biglide", ["slider.mesh.tolerance=3 %"], text)
    assert [
        order_part(robot, part).settings.tolerance for part in ("link", "slider")
    ] == pytest.approx([1e-3, 1e-3])


@pytest.mark.parametrize("text", ["tight", "0.1%%"])
def test_a_wrong_tolerance_is_one_complaint(text):
    with pytest.raises(
        InputError,
        match=r"^--tolerance \S+: parts.link.mesh.tolerance: expected a share (?!.*more\))",
    ):
        load_robot("biglide", (), text)


def test_numbers_of_absent_features_ask_for_no_new_experiment():
    one, other = (
        order_part(load_robot("biglide", [f"slider.{number}"]), "slider")
        for number in ("rib_height=20mm", "pad_width=40mm")
    )
    assert one == other
    assert one.key() == other.key() == order_part(load_robot("biglide"), "slider").key()


@pytest.mark.extended
def test_tolerance_reaches_the_experiment_and_enters_its_key(kitchen, capfd):
    loose, said = compliance(capfd)
    assert (loose["tolerance"], loose["note"], loose["cached"], said) == (
        None,
        "",
        False,
        "",
    )
    wanted = float(f"{loose['relative_bound'] / 2:.3g}")
    tight, _ = compliance(capfd, "--tolerance", repr(wanted))
    assert not tight["cached"]
    assert "refine" in kitchen
    assert (tight["tolerance"], tight["note"]) == (wanted, "")
    assert tight["relative_bound"] <= wanted
    assert compliance(capfd, "--tolerance", f"{100 * wanted:.3g} %")[0]["cached"]


@pytest.mark.extended
def test_a_tolerance_that_is_not_met_is_told_in_one_line(kitchen, capfd, caplog):
    found, _ = compliance(
        capfd, "--tolerance", "1e-5", "--set", "slider.mesh.most_unknowns=9000"
    )
    assert found["note"].startswith("tolerance 1e-05 not met: the bound of C")
    assert found["relative_bound"] > 1e-5
    assert caplog.messages == [f"slider: {found['note']}"]


@pytest.mark.extended
def test_a_foundation_gives_way_and_the_superelement_holds_the_part(
    kitchen, capfd, tmp_path
):
    rigid, _ = compliance(capfd)
    out = tmp_path / "super"
    soft, _ = compliance(
        capfd, "--set", "slider.foundation=1e11", "--superelement", str(out)
    )
    assert (rigid["foundation"], soft["foundation"]) == (None, 1e11)
    more = np.diag(soft["compliance"]) - np.diag(rigid["compliance"])
    assert more[0] == pytest.approx(1 / (1e11 * 0.16 * 0.02), rel=0.05)
    assert (more > 0).all()
    with np.load(out / "slider.npz", allow_pickle=False) as held:
        assert np.linalg.inv(held["stiffness"][6:12, 6:12]) == pytest.approx(
            np.array(soft["compliance"]), rel=1e-6, abs=1e-18
        )
    assert json.loads((out / "manifest.json").read_text())["files"] == [
        "slider.bdf",
        "slider.mass.mtx",
        "slider.npz",
        "slider.stiffness.mtx",
    ]


@pytest.mark.extended
def test_pads_apart_are_shown_one_by_one(kitchen, capfd, tmp_path):
    apart = (
        "--set",
        "slider.pad_height=9mm",
        "--set",
        "slider.pads=apart",
        "--json",
        str(tmp_path / "apart.json"),
    )
    assert _guarded(["compliance", "biglide", "--part", "slider", *WORDS, *apart]) == 0
    shown = capfd.readouterr().out
    found = json.loads((tmp_path / "apart.json").read_text())
    assert all(name in shown for name in ("link1", "link2", "link3"))
    assert (
        np.shape(found["flexibility"])
        == np.shape(found["flexibility_error"])
        == (18, 18)
    )
    assert np.array(found["flexibility"])[:6, :6] == pytest.approx(
        np.array(found["compliance"])
    )
    assert np.array(found["reference_points"]) == pytest.approx(
        np.array([[0.069, y, 0] for y in (0, 0.045, -0.045)])
    )


@pytest.mark.long
def test_interfaces_of_the_slider(kitchen, capfd, tmp_path):
    assert (
        _guarded(["interfaces", "biglide", "--out", str(tmp_path / "out"), *WORDS]) == 0
    )
    shown = capfd.readouterr().out
    with (tmp_path / "out" / "interfaces.csv").open() as file:
        change = {
            (row["entry"], row["choice"]): float(row["change"])
            for row in csv.DictReader(file)
        }
    names = {choice for _, choice in change}
    assert names == {
        "rigid face, rigid clamp",
        "even traction",
        "three pads",
        "foundation",
    }
    assert all(name in shown for name in names)
    assert (
        "bolt holes: left out; --set slider.hole_offset=1mm: parts.slider.hole_offset: expected"
        in shown
    )
    assert all(
        change["C44", name] > 0.1 for name in names - {"rigid face, rigid clamp"}
    )
    assert change["C11", "foundation"] == pytest.approx(
        1 / 3, rel=0.3
    )  # a layer of 20 mm under 60 mm
    assert (tmp_path / "out" / "interfaces.png").stat().st_size > 20_000


def test_choices_of_any_slider():
    """Bolt holes avoid ribs; what cannot be chosen is not."""
    ribbed = choices(load_robot("biglide", ["slider.rib_count=4"]), "slider")
    assert [c.overrides[0] for c in ribbed if c.name == "bolt holes"] == [
        "slider.hole_count=3"
    ]
    assert [c.name for c in choices(load_robot("biglide"), "link")] == [
        "rigid face",
        "even traction",
        "rigid clamp",
        "foundation",
    ]
