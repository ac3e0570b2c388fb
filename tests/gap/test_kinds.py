"""Every kind of readings says every fact that its consumers ask; one that does not cannot exist."""

from dataclasses import MISSING, fields, replace

import numpy as np
import pytest

from stiffscope.gap.campaign import kinds
from stiffscope.gap.campaign.campaign import Campaign, InstrumentFrame, Sensor
from stiffscope.gap.campaign.kinds.kind import AXES, NO_MODE, Kind, Predictor
from stiffscope.gap.campaign.quantities import QUANTITIES
from stiffscope.gap.effects.effect import Payload
from stiffscope.gap.forward.robot_model import RobotModel
from stiffscope.lab.measuring import RECORDS, Recorded
from stiffscope.robot.mechanism_of import mechanism_of
from stiffscope.robot.nominal import NominalRobot
from stiffscope.robot.part_matrices import part_matrices
from stiffscope.robot.reader import load_robot

PUSH = np.array([30.0, -20.0, 10.0, 1.0, 2.0, -1.0])
FRAMED = [
    Sensor(
        f"smr.{axis}",
        "platform",
        tuple(np.eye(3)[k]),
        (0.03, 0.04, -1.0),
        "position",
        frame="tracker",
        target="smr",
    )
    for k, axis in enumerate("xyz")
]


def test_every_fact_of_a_kind_is_said_and_none_has_a_default():
    for kind in kinds.KINDS:
        for fact in fields(Kind):
            assert fact.default is MISSING
            assert fact.default_factory is MISSING
            said = {f.name: getattr(kind, f.name) for f in fields(Kind)}
            del said[fact.name]
            with pytest.raises(TypeError, match=fact.name):
                Kind(**said)
        assert all([kind.name, kind.plural, kind.called, kind.quantities])
        assert all(kind.gaps)
        assert kind.noise_group
        for dimension in kind.dimensions:
            assert dimension.noun
            assert dimension.unit
            assert 0.0 < dimension.least < dimension.most
        assert kind.wrench in {"applied", "zero", "none"}
        assert kind.gain_sign in {-1.0, 0.0, 1.0}
        assert kind.force_sign in {-1.0, 0.0, 1.0}
        assert kind.is_positive >= kind.is_relative  # a size that errors relate to


@pytest.mark.parametrize("missing", sorted(Predictor.__abstractmethods__))
def test_a_prediction_that_lacks_an_answer_is_refused(missing):
    said = dict.fromkeys(Predictor.__abstractmethods__ - {missing}, lambda *_: None)
    with pytest.raises(TypeError, match=missing):
        type("Lacking", (Predictor,), said)()


def test_codes_tell_quantity_kind_direction_and_mode():
    names = [quantity.name for quantity in kinds.QUANTITY]
    assert [names[code] for code in kinds.NAMED] == list(QUANTITIES)
    assert len({*QUANTITIES}) == len(QUANTITIES)
    for code, quantity in enumerate(kinds.QUANTITY):
        kind = kinds.KINDS[kinds.KIND_OF[code]]
        assert quantity in kind.quantities
        assert kinds.DIRECTION_OF[code] == quantity.direction
        assert kinds.MODE_OF[code] == quantity.mode
        assert (kind.instrument == "") == (kinds.CHANNEL_OF[code] < len(AXES))
    for kind, codes in zip(kinds.KINDS, kinds.CODE_ALONG.tolist(), strict=True):
        along = [k for k in codes if k >= 0]
        assert all(kinds.QUANTITY[code] in kind.quantities for code in along)
        assert kind.instrument or len(along) == len(AXES)


def test_noise_of_equal_units_is_alike_and_of_others_apart():
    codes = range(len(kinds.QUANTITY))
    units: dict[int, set[str]] = {}
    for code in codes:
        kind = kinds.KINDS[kinds.KIND_OF[code]]
        own = kind.unit(turns=bool(kinds.DIRECTION_OF[code] >= 3))
        noise = "relative" if kind.is_relative else own
        units.setdefault(int(kinds.UNIT_OF[code]), set()).add(noise)
    assert all(len(same) == 1 for same in units.values())
    assert len(set.union(*units.values())) == len(units)


def test_the_laboratory_says_of_every_kind_what_it_records():
    assert set(RECORDS) == {kind.name for kind in kinds.KINDS}
    for fact in fields(Recorded):
        assert fact.default is MISSING
        assert fact.default_factory is MISSING


def test_every_kind_is_predicted_with_its_derivatives():
    robot = load_robot("delta")
    nominal = NominalRobot(mechanism_of(robot, part_matrices(robot, "beam")), robot)
    rows = []
    predicted = [k for k in kinds.KINDS if k.predictor is not None]  # not in blocks
    for kind in predicted:
        number = kinds.number_of(kind)
        for code in np.flatnonzero(number == kinds.KIND_OF)[:3].tolist():
            wrench = {"applied": PUSH, "zero": 0.0 * PUSH, "none": np.nan * PUSH}
            sensor = code - kinds.CODE_ALONG[number, 0] if kind.is_absolute else -1
            rows.append((code, sensor, wrench[kind.wrench]))
    n = len(rows)
    zeros = np.zeros(n, dtype=np.int64)
    campaign = Campaign(
        robot="delta",
        modelled=("gravity",),
        components=None,
        pose_names=("home",),
        poses=np.array([[0.05, -0.02, -1.1]]),
        pose=zeros,
        wrench=np.array([wrench for _, _, wrench in rows]),
        quantity=np.array([code for code, _, _ in rows]),
        value=np.ones(n),
        sigma=np.full(n, 1e-6),
        session_names=("",),
        session=zeros,
        files=("readings.csv",),
        file=zeros,
        line=np.arange(n) + 2,
        sensors=tuple(FRAMED),
        sensor=np.array([sensor for _, sensor, _ in rows]),
        load=zeros - 1,
        frames=(InstrumentFrame("tracker", (0.0,) * 6),),
    )
    model = RobotModel(campaign, nominal)
    prediction = model.predict()
    served = prediction.at.predictors
    assert sorted(np.concatenate([own for _, own in served])) == list(range(n))
    payload = Payload("platform", np.zeros(3), 1.0, np.zeros(3))
    turn = np.kron(np.eye(2), np.cross([1e-3, 0.0, 0.0], np.eye(3)).T)
    element = prediction.at.mechanism.joints[0].name
    read, driven = prediction.find_wrenches(element)
    assert np.isfinite(read).all()
    assert np.isfinite(driven).all()
    for kind in predicted:
        own = np.flatnonzero(campaign.kind == kinds.number_of(kind))
        moves = any(quantity.mode != NO_MODE for quantity in kind.quantities)
        assert moves or prediction.sense[own].any()
        for answer in (
            kind.predictor.read(prediction, own),
            kind.predictor.weigh(prediction, own),
            kind.predictor.load(prediction, own, payload, np.ones(len(own))),
            kind.predictor.turn(prediction, own, turn),
        ):
            assert answer.shape == own.shape
            assert np.isfinite(answer).all()
        for answer in (
            kind.predictor.find_sense(prediction, own),
            kind.predictor.find_drive(prediction, own),
        ):
            assert answer.shape == (len(own), prediction.at.cases)
        alone = replace(model, campaign=model.campaign.select(own)).predict()
        assert alone.plain_readings == pytest.approx(prediction.plain_readings[own])
        assert alone.drive == pytest.approx(prediction.drive[own])
