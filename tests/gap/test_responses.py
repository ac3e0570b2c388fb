"""Frequency responses in a campaign: how they are read, placed on the robot and predicted, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.errors import InputError
from stiffscope.gap.campaign.measured_responses import load_responses
from stiffscope.gap.campaigns import compare_responses, open_case, rough_mechanism
from stiffscope.gap.diagnose import forward_model
from stiffscope.gap.forward.response_doubts import find_channel_doubts
from stiffscope.gap.forward.response_model import predict_responses
from stiffscope.gap.inference.lack_of_fit import misses_lines
from stiffscope.gap.inference.verdict import find_missed_lines
from stiffscope.gap.response_modes import describe_responses
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.reader import load_robot
from stiffscope.vjm.model.bodies import Body
from stiffscope.vjm.model.joints import Drive
from stiffscope.vjm.statics.analysis import compliance
from tests.vjm import dense_modes

HAMMER = Path(__file__).parents[2] / "examples" / "hammer"
FIVE_BAR = """
robot = "five-bar"

[responses.tap]
file = "tap.csv"
quantity = "receptance"
units = "um/N"
joints = {}
averages = 4
points = { 3 = { body = "left.outer.tip", at = [0, 0.46026661874914765, 0] } }
channels = { H = { force = "3:+x", motion = "3:-y" }, G = { force = "3:+x", motion = "3:+x" } }
"""


def write(folder, replaced=None):
    """Write a campaign of two responses of 1 µm/N at three lines."""
    header = FIVE_BAR
    for old, new in (replaced or {}).items():
        header = header.replace(old, new)
    lines = ["frequency,H.re,H.im,G.re,G.im", "1,1,0,1,0", "2,1,0,1,0", "3,1,0,1,0"]
    (folder / "tap.csv").write_text("\n".join(lines))
    (folder / "campaign.toml").write_text(header)
    return folder


def test_the_simulated_hammer_test_is_that_of_the_model(tmp_path):
    report = tmp_path / "check.json"
    words = ["campaign", "check", str(HAMMER), "--quiet", "--json", str(report)]
    assert _guarded(words) == 0
    facts = json.loads(report.read_text())
    assert facts["readings"] == 0
    tap = facts["responses"]["tap"]
    heard = [row["gap"] for row in tap["responses"] if row["gap"] is not None]
    assert len(heard) == 5  # one of six is noise
    assert max(heard) < 1.0  # dB; the noise is 2 %
    assert tap["modes"][:2] == pytest.approx([58.8, 138.0], abs=0.05)
    assert tap["damping"] == pytest.approx(0.02, abs=0.002)
    assert any("nothing but noise" in doubt for doubt in tap["doubts"])


def compare_changed(change):
    """The hammer test with its first response multiplied, against a model that is right."""
    (compared,) = compare_responses(open_case(HAMMER))
    first, *others = compared.measured.responses
    changed = replace(first, receptance=change * first.receptance)
    measured = replace(compared.measured, responses=(changed, *others))
    return replace(compared, measured=measured)


def test_a_gain_and_a_sign_of_a_channel_are_doubted_and_a_softer_robot_is_not():
    assert find_channel_doubts(compare_changed(1.0)) == []
    (gain,) = find_channel_doubts(compare_changed(1.0 / 9.81))
    assert gain.startswith("1:+z / 1:+z: 0.102 times the model's")
    (sign,) = find_channel_doubts(compare_changed(-1.0))
    assert "opposite to the model's at" in sign
    compared = compare_changed(1.0)
    mechanism = rough_mechanism(load_robot("biglide"), "published")
    for factor in (0.25, 4.0):
        softer = replace(
            mechanism, joints=tuple(scale_drive(j, factor) for j in mechanism.joints)
        )
        predicted = predict_responses(softer, compared.measured, 0.02)
        assert find_channel_doubts(replace(compared, predicted=predicted)) == []


def scale_drive(joint, factor):
    """A joint with a stiffer or softer drive, if it has one."""
    if joint.drive is None:
        return joint
    return replace(joint, drive=Drive(factor * joint.drive.stiffness))


def test_the_page_shows_points_and_both_curves(tmp_path):
    out = tmp_path / "out"
    assert (
        _guarded(["campaign", "check", str(HAMMER), "--quiet", "--out", str(out)]) == 0
    )
    assert (out / "responses_1.png").stat().st_size > 10_000
    assert "predicted" in (out / "responses_1.svg").read_text("utf-8")
    assert "Responses tap" in (out / "report.html").read_text("utf-8")


def test_slow_responses_are_the_compliance_in_the_axes_of_the_file(tmp_path):
    # the axes of the file: its x is y of the robot, its y is -x
    folder = write(tmp_path, {"averages": 'axes = [0, 0, "90 deg"]\naverages'})
    (compared,) = compare_responses(open_case(folder))
    measured = compared.measured
    assert measured.responses[0].receptance == pytest.approx([1e-6] * 3)
    mechanism = measured.configuration.mechanism
    c = compliance(mechanism, measured.configuration)[0]
    cross, own = (values[0].real for values in compared.predicted.receptances)
    assert own == pytest.approx(c[1, 1], rel=1e-3)
    assert cross == pytest.approx(c[0, 1], rel=1e-3, abs=1e-3 * c[1, 1])


def test_the_mass_of_a_sensor_lowers_the_frequencies(tmp_path):
    free = compare_responses(open_case(write(tmp_path)))[0].predicted.modal
    heavy = write(tmp_path, {"5, 0]": '5, 0], mass = "200 g"'})
    loaded = compare_responses(open_case(heavy))[0].predicted.modal
    assert loaded.frequencies[0] < 0.99 * free.frequencies[0]


def model_of(folder):
    """The forward model of a campaign of responses alone."""
    case = open_case(folder)
    nominal = NominalRobot(rough_mechanism(case.robot), case.robot)
    responses = load_responses(folder, case.campaign, case.robot, nominal.mechanism)
    return forward_model(case.campaign, nominal, responses)


def test_responses_alone_have_one_pose_a_set_up(tmp_path):
    campaign = model_of(write(tmp_path)).campaign
    assert campaign.pose_names == ("tap",)
    assert len(campaign.poses) == 1
    assert campaign.find_pose_rows() == ("tap.csv",)  # lines of responses have no rows


def write_lines(folder, first, second):
    """Write a campaign of two responses at as many lines as given."""
    write(folder)
    rows = enumerate(zip(first, second, strict=True), start=1)
    lines = [f"{k},{h},0,{g},0" for k, (h, g) in rows]
    (folder / "tap.csv").write_text(
        "\n".join(["frequency,H.re,H.im,G.re,G.im", *lines])
    )
    return folder


@pytest.mark.parametrize("count", [3, 40])
def test_a_line_of_exactly_zero_tells_nothing(tmp_path, count):
    level = np.linspace(1.0, 2.0, count)
    level[1] = 0.0
    model = model_of(write_lines(tmp_path, level, level))
    lines = model.blocks[0]
    blank = lines.value == 0.0
    assert blank.any()
    assert lines.sigma[blank] == pytest.approx(2e-6)  # the largest line
    assert lines.sigma[~blank].max() < 1e-6
    assert np.isfinite(model.predict().values).all()


def test_a_channel_that_is_zero_everywhere_is_left_out_and_named(tmp_path):
    model = model_of(write_lines(tmp_path, [0.0] * 3, [1.0] * 3))
    assert len(model.campaign) == 2 * 3
    (remark,) = model.remarks(model.noise(), np.zeros(6))
    assert "3:+x to 3:-y is zero at every line" in remark
    with pytest.raises(InputError, match="expected lines other than zero"):
        _ = model_of(write_lines(tmp_path, [0.0] * 3, [0.0] * 3)).campaign


def describe(model, change=lambda measured: measured):
    """Modes by set-up and absolute gaps of a model's responses, which may be changed."""
    model = replace(model, responses=tuple(map(change, model.responses)))
    found = SimpleNamespace(model=model, campaign=model.campaign)
    return describe_responses(found, SimpleNamespace(parameters=()))


def test_the_gap_of_modes_stands_beside_that_of_read_frequencies(tmp_path):
    _, alone = describe(model_of(HAMMER))
    assert set(alone) == {"response", "frequency", "frequency_relative"}
    shutil.copytree(HAMMER, tmp_path / "hammer")
    header = (HAMMER / "campaign.toml").read_text()
    read = 'readings = "read.csv"\nrobot ='
    (tmp_path / "hammer" / "campaign.toml").write_text(header.replace("robot =", read))
    rows = "pose,quantity,value,sigma\nQ1,f1,60,0.5\n"
    (tmp_path / "hammer" / "read.csv").write_text(rows)
    _, both = describe(model_of(tmp_path / "hammer"))
    names = {"response", "mode frequency", "mode frequency_relative"}
    assert set(both) == names
    assert both["mode frequency"].before == alone["frequency"].before > 0.0


def test_a_line_predicted_as_zero_has_the_level_of_the_noise(tmp_path):
    model = model_of(write(tmp_path, {"3:-y": "3:+z"}))  # hardly moves out of the plane
    assert np.abs(model.predict().states[0].lines[0]).max() < 1e-14
    (block,) = model.blocks
    most = 20.0 * np.log10(np.abs(block.value / block.sigma).max())
    modes, gaps = describe(model)
    assert modes["tap"].before == gaps["response"].before
    assert 10.0 < gaps["response"].before <= most < 60.0


def test_modes_are_paired_over_all_lines_of_a_set_up():
    def thin(measured):
        """The same responses, but some of them with every second line."""
        coarse = [halve(each) for each in measured.responses[:2]]
        return replace(measured, responses=(*coarse, *measured.responses[2:]))

    def halve(response):
        return replace(
            response,
            frequency=response.frequency[::2],
            receptance=response.receptance[::2],
            coherence=response.coherence[::2],
        )

    model = model_of(HAMMER)
    whole = describe(model)[0]["tap"].modes
    mixed = describe(model, thin)[0]["tap"].modes
    assert len(mixed) == len(whole) > 0
    for known, other in zip(whole, mixed, strict=True):
        assert other.measured == pytest.approx(known.measured, rel=0.01)
        assert other.before == pytest.approx(known.before, nan_ok=True)
        assert other.mac_before == pytest.approx(
            known.mac_before, abs=0.05, nan_ok=True
        )


def test_lines_left_beyond_their_noise_are_a_reason():
    lines = np.array([False, True, True])
    used = np.array([True, True, True])
    campaign = SimpleNamespace(in_blocks=lines)
    found = SimpleNamespace(campaign=campaign, used_readings=used)
    found.residual = np.array
    assert misses_lines(found, [9.0, 1.0, -1.0]) == ""
    assert "left at 3 times their noise" in misses_lines(found, [0.0, 3.0, -3.0])


def test_certain_effects_that_alone_leave_the_lines_are_not_certain():
    # a hose followed by drives and base, and by two effects too small to be certain
    found = SimpleNamespace(campaign=SimpleNamespace(in_blocks=np.ones(2, dtype=bool)))
    found.used_readings = np.ones(2, dtype=bool)
    found.residual = np.array
    found.best = [1.0, 1.0]
    found.fit_effects = lambda certain: [0.5, 1.0] if "all" in certain else [2.0, 2.0]
    assert find_missed_lines(found, ["all"]) == ""
    assert find_missed_lines(found, []) == ""
    assert "left at 2 times their noise" in find_missed_lines(found, ["drives"])


def test_a_pose_that_lost_its_readings_has_no_row():
    campaign = open_case("gauges").campaign
    rows = campaign.find_pose_rows()
    left = campaign.select(np.flatnonzero(campaign.pose != 1))
    assert left.find_pose_rows() == (rows[0], "", *rows[2:])


WRONG = {
    "a key that is none": (
        {"averages": "average"},
        "campaign.toml:9: responses.tap.average: expected a known key (file, pose",
    ),
    "a file that is not there": ({'"tap.csv"': '"tip.csv"'}, "campaign.toml:5: "),
    "a pose and joints": (
        {"averages": 'pose = "home"\naverages'},
        "expected one of pose, joints, got pose and joints",
    ),
    "a pose of another robot": (
        {"joints = {}": 'pose = "Q1"'},
        "responses.tap.pose: expected one of five-bar's poses",
    ),
    "a drive that is none": (
        {"joints = {}": "joints = { J9 = 1 }"},
        "responses.tap.joints.J9: expected drives among",
    ),
    "a body that is none": (
        {"left.outer.tip": "left.outer.middle"},
        "responses.tap.points.3.body: expected a body or an end of one",
    ),
    "a point without responses": (
        {"{ 3 = {": "{ 4 = { body = 'ground', at = [0, 0, 0] }, 3 = {"},
        "responses.tap.points.4: expected a point of tap.csv (3), got 4",
    ),
    "a response without its point": (
        {"3:-y": "8:-y"},
        "expected all points of tap.csv (3, 8), 8 is missing",
    ),
    "a place that nobody tells": (
        {
            "left.outer.tip": "platform",
            ", at = [0, 0.46026661874914765, 0]": "",
            "five-bar": "biglide",
        },
        "responses.tap.points.3.at: expected a place",
    ),
    "a band without lines": (
        {"averages": 'band = ["5 Hz", "9 Hz"]\naverages'},
        "responses.tap.band: expected lines of tap.csv: H, which has 1 to 3 Hz",
    ),
    "a band the other way round": (
        {"averages": 'band = ["9 Hz", "5 Hz"]\naverages'},
        "the lower first",
    ),
    "averages below one": (
        {"averages = 4": "averages = 0"},
        "responses.tap.averages: expected a whole number of at least 1, got 0",
    ),
    "a unit of another quantity": (
        {"um/N": "m/s^2/N"},
        'responses.tap.units: expected a unit of receptance such as "m/N"',
    ),
    "a quantity that is none": (
        {'"receptance"': '"inertance"'},
        "responses.tap.quantity: expected 'receptance', 'mobility' or 'accelerance'",
    ),
    "a channel without a sign or axis": (
        {"3:-y": "3"},
        'responses.tap.channels.H.motion: expected a point and a direction such as "7:-x"',
    ),
    "a mass of no weight": (
        {"5, 0]": '5, 0], mass = "0 g"'},
        "responses.tap.points.3.mass: expected",
    ),
    "an exponential window in Hz": (
        {"averages": 'exponential = "5 Hz"\naverages'},
        "responses.tap.exponential: expected a duration",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_set_up_is_refused_with_its_line(tmp_path, case):
    replaced, message = WRONG[case]
    folder = write(tmp_path, replaced)
    with pytest.raises(InputError) as refused:
        compare_responses(open_case(folder))
    assert message in str(refused.value)
    assert str(refused.value).startswith("campaign.toml:")
    assert "\n" not in str(refused.value)


def test_a_universal_file_states_its_quantity(tmp_path):
    shutil.copytree(HAMMER, tmp_path / "hammer")
    header = (HAMMER / "campaign.toml").read_text()
    header = header.replace("averages", 'quantity = "mobility"\naverages')
    (tmp_path / "hammer" / "campaign.toml").write_text(header)
    with pytest.raises(
        InputError, match=r"tap\.quantity: expected none: the universal"
    ):
        open_case(tmp_path / "hammer")


HEXAPOD = """
robot = "stewart"

[responses.tap]
file = "tap.csv"
quantity = "accelerance"
pose = "tilted"
channels = { H = { force = "a:+z", motion = "b:-x" }, G = { force = "b:+y", motion = "b:+y" } }

[responses.tap.points]
a = { body = "platform", at = ["40 mm", 0, "0.3 m"], mass = "60 g" }
b = { body = "platform", at = [0, "-50 mm", "0.31 m"] }
"""


def test_a_hexapod_hit_at_a_posture_is_that_of_a_dense_solution(tmp_path):
    lines = ["frequency,H.re,H.im,G.re,G.im"]
    lines += [f"{f},1,0,1,0" for f in (20.0, 45.0, 310.0)]
    (tmp_path / "tap.csv").write_text("\n".join(lines))
    (tmp_path / "campaign.toml").write_text(HEXAPOD)
    case = open_case(tmp_path)
    mechanism = rough_mechanism(case.robot)
    (measured,) = load_responses(tmp_path, case.campaign, case.robot, mechanism)
    found = predict_responses(mechanism, measured, 0.0).receptances
    hit = np.array([0.04, 0.0, 0.3])
    seen = np.array([0.0, -0.05, 0.31])
    platform = next(b for b in mechanism.bodies if b.name == "platform")
    loaded = add_mass(platform, hit, 0.06)
    bodies = tuple(loaded if b is platform else b for b in mechanism.bodies)
    heavier = replace(mechanism, bodies=bodies)
    x, y, z = np.eye(6)[:3]
    ends = [
        (("platform", hit, z), ("platform", seen, -x)),
        (("platform", seen, y), ("platform", seen, y)),
    ]
    pose = case.robot.poses["tilted"]
    for values, (source, target) in zip(found, ends, strict=True):
        expected = dense_modes.receptance(
            heavier, pose, source, target, measured.responses[0].frequency
        )
        assert values.real == pytest.approx(expected, rel=1e-6)


def add_mass(body, at, mass):
    """A rigid body with a point mass: common centre, and inertia about it by parallel axes."""
    own = np.zeros((3, 3)) if body.inertia is None else body.inertia
    way = at - body.centre
    reduced = body.mass * mass / (body.mass + mass)
    inertia = own + reduced * ((way @ way) * np.eye(3) - np.outer(way, way))
    centre = (body.mass * body.centre + mass * at) / (body.mass + mass)
    return Body(body.name, body.mass + mass, centre, inertia)
