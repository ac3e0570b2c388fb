"""The virtual lab: its mechanics against the verified table, its effects against their stated semantics."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from stiffscope.errors import InputError
from stiffscope.gap.campaign_io import write_campaign
from stiffscope.gap.lab.assembly import locate, respond, stiffness
from stiffscope.gap.lab.faults import OUTSIDE, inject
from stiffscope.gap.lab.machine import Drive, beam, biglide, section_of
from stiffscope.gap.lab.measuring import Noise, Plan, default_plan, measure, workspace
from stiffscope.gap.readings import load_campaign
from stiffscope.robot.vocabulary import LINKS, VOCABULARY

SOUND = biglide()
QUIET = Noise(displacement=0.0, rotation=0.0, stiffness=0.0, stated=None)
MIRROR = np.diag([-1.0, 1, 1, 1, -1, -1])  # the plane x = 0
HOME = np.array([[0.0, 0.0, 0.35]])
EXAMPLES = {
    ("gravity", "robot"): {},
    ("payload", "platform"): {"mass": 12.0, "x": 0.02, "y": -0.03, "z": 0.05},
    ("actuator-stiffness", "limb1"): {"factor": 0.8},
    ("actuator-stiffness", "limbs"): {"factor": 0.8},
    ("actuator-stiffness", "stage"): {"factor": 0.8},
    ("joint-compliance", "joints"): {"radial": 5e-9, "axial": 1e-8, "tilting": 1e-5},
    ("link-stiffness", "links"): {"factor": 0.9},
    ("link-stiffness", "limb2.link3"): {"factor": 0.7},
    ("rigid-ends", "links"): {"length": 0.03},
    ("slider-compliance", "sliders"): {"factor": 2.0},
    ("guide-compliance", "carriages"): {"lateral": 5e-9, "vertical": 5e-9, "angular": 1e-6},
    ("base-compliance", "base"): {"x": 1e-9, "y": 1e-9, "z": 1e-9, "rx": 1e-7, "ry": 1e-7, "rz": 1e-7},
    ("platform-compliance", "platform"): {"x": 1e-8, "z": 1e-8, "ry": 1e-6},
    ("backlash", "stage"): {"half_width": 1e-5},
    ("encoder-offset", "limb1"): {"offset": 1e-4},
    ("link-length", "limb1.link2"): {"error": 5e-5},
    ("thermal", "links"): {"temperature": 8.0},
    ("instrument-misalignment", "instrument"): {"rx": 0.01, "ry": -0.02, "rz": 0.03},
    ("displacement-scale", "instrument"): {"factor": 1.05},
    ("force-scale", "instrument"): {"factor": 0.95},
    ("one-soft-slider", "limb2"): {"factor": 4.0},
    ("one-loose-bearing", "limb1.link2.joint_a"): {"radial": 2e-8},
    ("one-soft-guide", "limb1"): {"angular": 2e-6},
    ("stage-guide", "stage"): {"rx": 1e-6, "rz": 1e-6},
    ("cable-chain", "platform"): {"x": 2e4, "y": 2e4, "z": 1e4},
    ("hardening-drive", "limbs"): {"cubic": 1e16},
    ("drive-friction", "limb1"): {"force": 60.0},
    ("bowed-link", "limb2.link1"): {"curvature": 1e-3},
    ("screw-pitch", "limbs"): {"relative": 2e-4},
    ("platform-width", "platform"): {"error": 1e-4},
    ("drifting-sensor", "instrument"): {"x": 1e-5, "rz": 5e-5},
    ("gain-drift", "instrument"): {"relative": 0.1},
    ("cross-talk", "z->x"): {"share": 0.05},
    ("coarse-converter", "instrument"): {"x": 1e-5, "rx": 5e-5},
    ("wrench-off-centre", "instrument"): {"x": 0.02},
    ("bad-session", "instrument"): {"relative": 0.1},
}


def seen(machine, plan=None):
    """All three kinds of reading, noiseless, by kind: (p, m, 6), (p, 6), (p, 6)."""
    plan = plan or default_plan(SOUND, np.random.default_rng(3), poses=4, stiffness=True, sessions=2)
    c = measure(machine, plan, QUIET, np.random.default_rng(0))
    parts = [c.value[c.kind == kind] for kind in range(3)]
    p, m = len(plan.poses), len(plan.wrenches)
    return parts[0].reshape(p, m, 6), parts[1].reshape(-1, 6), parts[2].reshape(-1, 6)


def at_angle(degrees):
    d = SOUND.dimensions
    return np.array([[0, 0, d.l1 + d.l2 + d.L * np.sin(np.deg2rad(degrees))]])


@pytest.mark.parametrize(
    ("angle", "rigid_slider", "expected"),
    [
        (36, False, [23.82111, 1.96743, 12.574307, 1.464912, 0.141031, 2.819319, 0.922902, 0.325959]),
        (66, False, [17.883256, 1.96691, 90.215325, 3.442252, 0.699246, 0.759309, 2.918568, 0.494572]),
        (36, True, [24.63093, 1.969098, 13.001783, 1.495549, 0.147504, 2.874351, 0.868302, 0.318888]),
    ],
)
def test_stiffness_is_that_of_the_verified_table(angle, rigid_slider, expected):
    machine = replace(SOUND, sliders=np.zeros((2, 6, 6))) if rigid_slider else SOUND
    k = stiffness(machine, at_angle(angle))[0] / 1e6
    assert np.array([*np.diag(k), k[0, 4], k[1, 3]]) == pytest.approx(expected, abs=6e-7)
    k[[0, 4, 1, 3], [4, 0, 3, 1]] = 0
    assert np.abs(k - np.diag(np.diag(k))).max() < 1e-8


def test_the_platform_sags_and_the_weight_pulls_the_limbs_together():
    """Sag 10.8 µm; thrust (W/2 + 3w/2) cot q in each drive."""
    response = respond(SOUND, HOME)
    assert response.dead[0] * 1e6 == pytest.approx([0, 0, 10.8, 0, 0, 0], abs=0.05)
    q = locate(SOUND, HOME).angles[0, 0]
    thrust = (SOUND.platform_mass + 3 * 2 * SOUND.link_mass / 2) / 2 * SOUND.acceleration / np.tan(q)
    assert response.dead_force[0] == pytest.approx([thrust, -thrust, 0], rel=1e-6, abs=1e-4)


def test_mirrored_machine_answers_mirrored():
    poses = workspace(SOUND.dimensions, 6, np.random.default_rng(1))
    mirrored = poses * [-1, 1, 1]
    left = inject(SOUND, "actuator-stiffness", "limb1", {"factor": 0.7})
    left = inject(left, "link-length", "limb1.link2", {"error": 1e-4})
    left = inject(left, "one-soft-slider", "limb1", {"factor": 3.0})
    right = inject(SOUND, "actuator-stiffness", "limb2", {"factor": 0.7})
    right = inject(right, "link-length", "limb2.link2", {"error": 1e-4})
    right = inject(right, "one-soft-slider", "limb2", {"factor": 3.0})
    one, other = respond(left, poses), respond(right, mirrored)
    assert np.allclose(one.compliance, MIRROR @ other.compliance @ MIRROR, rtol=1e-7, atol=1e-16)
    assert np.allclose(one.dead, other.dead @ MIRROR, rtol=1e-7, atol=1e-12)
    assert np.allclose(one.shift, other.shift @ MIRROR, rtol=1e-7, atol=1e-12)


def test_compliance_is_symmetric_positive_and_blind_to_the_stage():
    poses = workspace(SOUND.dimensions, 8, np.random.default_rng(2))
    c = respond(SOUND, poses).compliance
    assert np.allclose(c, np.swapaxes(c, 1, 2), rtol=1e-6, atol=1e-15)
    assert (np.linalg.eigvalsh(c) > 0).all()
    assert np.allclose(c, respond(SOUND, poses * [1, 0, 1]).compliance, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("effect", [e for e in EXAMPLES if e[0].endswith(("compliance", "guide", "bearing"))])
def test_more_compliance_only_softens(effect):
    """Every reading of K stays under the sound machine's, in the sense of matrices."""
    poses = workspace(SOUND.dimensions, 5, np.random.default_rng(4))
    softer = stiffness(inject(SOUND, *effect, EXAMPLES[effect]), poses)
    excess = np.linalg.eigvalsh(stiffness(SOUND, poses) - softer)
    assert (excess > -1e-6 * excess.max()).all()
    assert excess.max() > 0


def test_every_word_and_every_fault_can_be_planted_and_seen():
    assert {effect for effect, _ in EXAMPLES} == {*VOCABULARY, *OUTSIDE}
    plan = default_plan(SOUND, np.random.default_rng(3), poses=4, stiffness=True, sessions=2)
    start = replace(SOUND, gravity=False)
    before = np.concatenate([part.ravel() for part in seen(start, plan)])
    for (effect, place), parameters in EXAMPLES.items():
        base = SOUND if effect == "backlash" else start
        reference = np.concatenate([part.ravel() for part in seen(base, plan)])
        after = np.concatenate([part.ravel() for part in seen(inject(base, effect, place, parameters), plan)])
        assert np.isfinite(after).all(), effect
        assert not np.allclose(after, reference, rtol=1e-4, atol=0), effect
    assert np.isfinite(before).all()


def test_loads_show_where_they_act():
    """Weights move the unloaded platform only; a platform's compliance yields to the applied wrench only."""
    for effect, place in [("payload", "platform"), ("encoder-offset", "limb1"), ("thermal", "links")]:
        d, e, _ = seen(inject(SOUND, effect, place, EXAMPLES[effect, place]))
        assert np.allclose(d, seen(SOUND)[0], rtol=2e-3, atol=1e-9)
        assert not np.allclose(e, seen(SOUND)[1], atol=1e-7)
    d, e, _ = seen(inject(SOUND, "platform-compliance", "platform", {"z": 1e-8}))
    assert np.allclose(e, seen(SOUND)[1], atol=1e-12)
    plan = Plan(HOME, np.array([[0, 0, 100.0, 0, 0, 0]]))
    before, after = seen(SOUND, plan), seen(inject(SOUND, "platform-compliance", "platform", {"z": 1e-8}), plan)
    assert after[0][0, 0] - before[0][0, 0] == pytest.approx([0, 0, 1e-6, 0, 0, 0], abs=1e-12)


def test_instrument_acts_on_what_is_read():
    d, e, k = seen(SOUND)
    d2, e2, k2 = seen(inject(SOUND, "displacement-scale", "instrument", {"factor": 1.1}))
    assert np.allclose(d2, 1.1 * d)
    assert np.allclose(e2, 1.1 * e)
    assert np.allclose(k2 / k, 1 / 1.1)
    d3, e3, k3 = seen(inject(SOUND, "force-scale", "instrument", {"factor": 1.1}))
    assert np.allclose(d3, 1.1 * d)
    assert np.allclose(e3, e)
    assert np.allclose(k3 / k, 1 / 1.1)
    turned = seen(inject(SOUND, "instrument-misalignment", "instrument", {"rz": 0.01}))[0]
    assert np.allclose(turned[..., 0], d[..., 0] - 0.01 * d[..., 1])
    assert np.allclose(turned[..., 4], d[..., 4] + 0.01 * d[..., 3])


def test_geometry_errors_are_exact_rigid_kinematics():
    """Both carriages out by e: z from the circle; one link set longer: M where the circles meet."""
    bare = replace(SOUND, gravity=False)
    e = 2e-3
    both = inject(inject(bare, "encoder-offset", "limb1", {"offset": e}), "encoder-offset", "limb2", {"offset": e})
    q = locate(SOUND, HOME).angles[0, 0]
    depth = np.sqrt(0.25 - (0.5 * np.cos(q) + e) ** 2) - 0.5 * np.sin(q)
    plan = Plan(HOME, np.zeros((0, 6)))
    assert seen(both, plan)[1][0] == pytest.approx([0, 0, depth, 0, 0, 0], abs=1e-12)
    one = seen(inject(bare, "encoder-offset", "limb2", {"offset": e}), plan)[1][0]
    assert one[0] == pytest.approx(e / 2, rel=1e-12)
    moved = seen(inject(bare, "encoder-offset", "stage", {"offset": e}), plan)[1][0]
    assert moved == pytest.approx([0, e, 0, 0, 0, 0], abs=1e-12)
    hot = seen(inject(bare, "thermal", "links", {"temperature": 10.0}), plan)[1][0]
    assert hot[2] == pytest.approx(10 * 11.7e-6 * 0.5 / np.sin(q), rel=1e-3)


def test_single_links_errors_add_up_to_that_of_all():
    bare, plan = replace(SOUND, gravity=False), Plan(HOME, np.zeros((0, 6)))
    singles = sum(seen(inject(bare, "link-length", link, {"error": 1e-6}), plan)[1][0] for link in LINKS)
    assert singles == pytest.approx(seen(inject(bare, "link-length", "links", {"error": 1e-6}), plan)[1][0], abs=1e-11)


def test_backlash_shifts_towards_the_force_and_not_without_one():
    b = 8e-6
    plan = Plan(HOME, np.array([[0, 400.0, 0, 0, 0, 0], [0, -400.0, 0, 0, 0, 0], [0, 0, 300, 0, 0, 0]]))
    before, after = seen(SOUND, plan), seen(inject(SOUND, "backlash", "stage", {"half_width": b}), plan)
    assert (after[0] - before[0])[0, :, 1] == pytest.approx([b, -b, 0], abs=1e-13)
    assert np.allclose(after[1], before[1], atol=1e-12)
    d, e, _ = seen(inject(SOUND, "backlash", "limb1", {"half_width": b}), plan)
    shift = e[0] - seen(SOUND, plan)[1][0]
    q = locate(SOUND, HOME).angles[0, 0]
    assert shift[:3] == pytest.approx([b / 2, 0, b / 2 / np.tan(q)], rel=1e-6)
    assert (d - before[0])[0, :2] == pytest.approx(np.zeros((2, 6)), abs=1e-12)


def test_a_tied_drive_hangs_in_its_gap():
    """With a cable that holds the platform, a small force cannot push a wide gap to its end."""
    tied = inject(SOUND, "cable-chain", "platform", {"y": 2e5})
    slack = inject(tied, "backlash", "stage", {"half_width": 1e-2})
    plan = Plan(HOME, np.array([[0, 100.0, 0, 0, 0, 0]]), deviations=False)
    assert seen(slack, plan)[0][0, 0, 1] == pytest.approx(100 / 2e5, rel=1e-4)


def test_nonlinear_drives():
    plan = Plan(HOME, np.array([[0, f, 0, 0, 0, 0] for f in (-500.0, 50.0, 500.0)]), deviations=False)
    linear = seen(SOUND, plan)[0][0, :, 1]
    hard = seen(inject(SOUND, "hardening-drive", "stage", {"cubic": 1e16}), plan)[0][0, :, 1]
    e = hard[2] - linear[2] + 500 / 1.27e7
    assert 1.27e7 * e + 1e16 * e**3 == pytest.approx(500, rel=1e-6)
    assert hard[0] == pytest.approx(-hard[2])
    stuck = seen(inject(SOUND, "drive-friction", "stage", {"force": 60.0}), plan)[0][0, :, 1]
    assert linear - stuck == pytest.approx(np.array([-60, 50, 60]) / 1.27e7, rel=1e-6)


def test_rigid_ends_and_sections_follow_beam_theory():
    section = np.array([1.0, 0.3, 0.3, 2.0, 5.0, 5.0]) * 1e-6
    c = beam(0.5, section)
    assert section_of(c, 0.5) == pytest.approx(section)
    ends = inject(SOUND, "rigid-ends", "links", {"length": 0.05}).links[0, 0]
    assert ends[0, 0] / SOUND.links[0, 0][0, 0] == pytest.approx(0.8)
    e_i = 0.5 / SOUND.links[0, 0][5, 5]
    assert ends[1, 1] == pytest.approx((0.45**3 - 0.05**3) / (3 * e_i))


def test_readings_are_as_noisy_as_they_say():
    plan = default_plan(SOUND, np.random.default_rng(5), stiffness=True)
    true = measure(SOUND, plan, QUIET, np.random.default_rng(0))
    c = measure(SOUND, plan, Noise(spread=0.5), np.random.default_rng(7))
    z = (c.value - true.value) / c.sigma
    assert len(c) == 12 * (10 + 2) * 6
    assert z.std() == pytest.approx(1, abs=0.08)
    assert c.sigma[c.kind == 0].std() > 1e-7
    rough = measure(SOUND, plan, Noise(outliers=0.05, missing=0.2, stated=None), np.random.default_rng(7))
    assert len(rough) == pytest.approx(0.8 * len(c), rel=0.06)
    assert np.isnan(rough.sigma).all()


def test_a_measured_campaign_survives_its_file(tmp_path):
    plan = default_plan(SOUND, np.random.default_rng(5), stiffness=True, sessions=3)
    c = measure(SOUND, plan, Noise(shuffle=True, missing=0.1), np.random.default_rng(7))
    write_campaign(c, tmp_path)
    back = load_campaign(tmp_path)
    assert np.array_equal(back.value, c.value)
    assert np.array_equal(back.poses[back.pose], c.poses[c.pose])
    assert [back.session_names[k] for k in back.session] == [c.session_names[k] for k in c.session]


@pytest.mark.parametrize(
    ("effect", "place", "parameters", "expected"),
    [
        ("rust", "base", {}, "effect: expected one of gravity, payload"),
        ("backlash", "limbs", {"half_width": 1e-6}, "backlash, place: expected one of stage, limb1, limb2"),
        ("backlash", "stage", {"width": 1e-6}, "backlash, width: expected one of half_width"),
        ("actuator-stiffness", "stage", {"factor": -1.0}, "factor: expected a finite number"),
        ("rigid-ends", "links", {"length": 0.3}, "rigid-ends, length: expected 0 to 0.25 m"),
    ],
)
def test_refuses_what_cannot_be_planted(effect, place, parameters, expected):
    with pytest.raises(InputError, match=expected):
        inject(SOUND, effect, place, parameters)


def test_refuses_a_pose_out_of_reach():
    with pytest.raises(InputError, match="pose: expected carriages within"):
        stiffness(SOUND, np.array([[0.4, 0, 0.35]]))


def test_fea_slider_where_the_nominal_has_a_beam():
    k = stiffness(biglide("fea"), HOME)[0] / stiffness(SOUND, HOME)[0]
    assert 0.97 < k[0, 0] < 1.03
    assert k[3, 3] < 0.95


def test_lab_imports_no_mechanics_of_the_diagnosis():
    code = (
        "import sys, stiffscope.gap.lab.measuring, stiffscope.gap.lab.faults, stiffscope.gap.campaign_io;"
        "rooms = [m.split('.')[1:] for m in sys.modules if m.startswith('stiffscope.')];"
        "shared = {'quantities', 'campaign', 'readings', 'campaign_header', 'table', 'campaign_io', 'lab'};"
        "known = {'robot': {'vocabulary'}, 'gap': shared, 'errors': set(), 'data': set()};"
        "bad = [m for m in rooms if m[0] not in known or {*m[1:2]} - known[m[0]]];"
        "sys.exit(' '.join(map(str, bad)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_drives_are_ideal_by_default():
    assert all(d == Drive(1.27e7) for d in SOUND.drives)
