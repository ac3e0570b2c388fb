"""Universal files: written by pyuff and read to their printed digits, and what is wrong in them told in one line."""

import itertools
import re
import time

import numpy as np
import pytest
import pyuff

from stiffscope.errors import InputError
from stiffscope.responses.uff import read_uff

COUNT = 37
RNG = np.random.default_rng(5)
VALUES = RNG.normal(size=COUNT) + 1j * RNG.normal(size=COUNT)


def write(path, *sets):
    path.unlink(missing_ok=True)
    for each in sets:
        # pyuff loses binary sets when it overwrites, and states half their bytes if complex
        pyuff.UFF(str(path)).write_sets(each, mode="add", force_double=False)
    return path


def function(x, values, **more):
    """A dataset 58 of pyuff: an accelerance by default."""
    return {
        "type": 58,
        "func_type": 4,
        "rsp_node": 7,
        "rsp_dir": -1,
        "ref_node": 1,
        "ref_dir": 3,
        "data": values,
        "x": x,
        "id1": "tap",
        "rsp_ent_name": "NONE",
        "ref_ent_name": "NONE",
        "abscissa_spacing": 1,
        "abscissa_spec_data_type": 18,
        "ord_data_type": 6 if np.iscomplexobj(values) else 4,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 13,
        "binary": 0,
        "byte_ordering": 1,
        "fp_format": 2,
        "n_ascii_lines": 11,
        "n_bytes": 0,
        **more,
    }


EVEN = np.linspace(5.0, 95.0, COUNT)
UNEVEN = np.cumsum(RNG.uniform(0.5, 2.0, COUNT))


@pytest.mark.parametrize(
    ("spacing", "double", "real", "binary"),
    list(itertools.product((0, 1), (False, True), (False, True), (0, 1))),
)
def test_what_pyuff_writes_is_read_to_its_digits(
    tmp_path, spacing, double, real, binary
):
    x = EVEN if spacing else UNEVEN
    values = VALUES.real if real else VALUES
    kind = (2, 4)[double] if real else (5, 6)[double]
    given = function(
        x,
        values,
        abscissa_spacing=spacing,
        ord_data_type=kind,
        binary=binary,
    )
    found = read_uff(write(tmp_path / "a.uff", given))
    (response,) = found.responses
    omega = 2 * np.pi * response.frequency
    # the abscissa is printed with five decimals, and single precision has seven digits
    assert response.frequency == pytest.approx(x, rel=5e-6)
    digits = 1e-11 if double and not binary else 1e-15 if double else 2e-5
    digits += 5e-6 if spacing == 0 or binary else 0.0
    assert -(omega**2) * response.receptance == pytest.approx(values, rel=digits)
    assert str(response.force) == "1:+z"
    assert str(response.motion) == "7:-x"
    assert not response.is_driving_point


def test_units_are_those_of_the_labels_else_of_the_file_else_si(tmp_path):
    units = {
        "type": 164,
        "units_code": 5,
        "units_description": "mm",
        "temp_mode": 1,
        "length": 1000.0,
        "force": 1000.0,
        "temp": 1.0,
        "temp_offset": 273.15,
    }
    plain = function(EVEN, VALUES, ordinate_spec_data_type=8)
    labelled = function(
        EVEN,
        VALUES,
        ordinate_axis_units_lab="um",
        orddenom_axis_units_lab="N",
        ordinate_spec_data_type=8,
    )
    gravity = function(
        EVEN, VALUES, ordinate_axis_units_lab="g", orddenom_axis_units_lab="lbf"
    )
    found = read_uff(write(tmp_path / "a.unv", units, plain, labelled, gravity))
    first, second, third = (each.receptance for each in found.responses)
    # a millimetre per millinewton is a metre per newton
    assert first == pytest.approx(VALUES, rel=1e-4)
    assert second == pytest.approx(1e-6 * VALUES, rel=1e-4)
    of_gravity = 9.80665 / 4.4482216152605 * VALUES
    assert third * (2j * np.pi * EVEN) ** 2 == pytest.approx(of_gravity, rel=1e-4)
    assert found.remarks == ()
    (alone,) = read_uff(write(tmp_path / "b.unv", plain)).remarks
    assert alone.endswith("no units stated: SI assumed")


def test_nodes_lines_shapes_and_coherence_come_along(tmp_path):
    nodes = {
        "type": 15,
        "node_nums": [1, 7],
        "def_cs": [0, 0],
        "disp_cs": [0, 0],
        "color": [0, 0],
        "x": [0.0, 0.5],
        "y": [0.25, 0.0],
        "z": [0.0, -1.0],
    }
    trace = {
        "type": 82,
        "trace_num": 1,
        "n_nodes": 2,
        "color": 0,
        "id": "NONE",
        "nodes": np.array([1, 7]),
    }
    shape = {
        "type": 55,
        "model_type": 1,
        "analysis_type": 2,
        "data_ch": 2,
        "spec_data_type": 8,
        "data_type": 2,
        "n_data_per_node": 3,
        "r1": np.array([1.0, 0.5]),
        "r2": np.array([0.0, 0.25]),
        "r3": np.array([-2.0, 0.0]),
        "load_case": 0,
        "mode_n": 1,
        "freq": 41.5,
        "modal_m": 1.0,
        "modal_damp_vis": 0.02,
        "modal_damp_his": 0.0,
        "node_nums": np.array([1, 7]),
        "id1": "a",
        "id2": "b",
        "id3": "c",
        "id4": "d",
        "id5": "e",
    }
    seen = np.linspace(0.5, 1.0, COUNT)
    coherence = function(EVEN, seen, func_type=6, ordinate_spec_data_type=0)
    found = read_uff(
        write(
            tmp_path / "a.uff", nodes, trace, shape, coherence, function(EVEN, VALUES)
        )
    )
    assert found.points["7"] == pytest.approx([0.5, 0.0, -1.0])
    assert found.lines == (("1", "7"),)
    (mode,) = found.shapes
    assert (mode.frequency, mode.damping) == (41.5, 0.02)
    assert mode.displacement["1"] == pytest.approx([1.0, 0.0, -2.0])
    assert found.responses[0].coherence == pytest.approx(seen, abs=1e-5)


def binary_file(tmp_path, double=True):
    given = function(EVEN, VALUES, binary=1, ord_data_type=6 if double else 5)
    return write(tmp_path / "b.uff", given).read_bytes()


def test_line_ends_changed_by_a_transfer_as_text_are_mended(tmp_path):
    content = binary_file(tmp_path)
    path = tmp_path / "changed.uff"
    for changed in (
        content.replace(b"\n", b"\r\n"),  # the values, too
        content.replace(b"\r\n", b"\n"),
    ):
        path.write_bytes(changed)
        (response,) = read_uff(path).responses
        omega = 2 * np.pi * response.frequency
        assert -(omega**2) * response.receptance == pytest.approx(VALUES, rel=1e-5)


def test_a_delimiter_among_binary_values_ends_no_dataset(tmp_path):
    content = bytearray(binary_file(tmp_path))
    block = b"\n    -1\n"
    at = content.rindex(b"-1") - 200
    content[at : at + len(block)] = block
    path = tmp_path / "b.uff"
    path.write_bytes(bytes(content))
    (response,) = read_uff(path).responses
    assert len(response.frequency) == COUNT


FIRST = re.compile(rb"\n *-?\d\.\d{5}e[+-]\d\d(?= )")
LAST = re.compile(rb"..\n(?=    -1\n$)")  # of the last number
MIDDLE = re.compile(rb"(\n *-?\d\.\d{5}e[+-]\d\d +-?\d\.\d{3})[^\n]*\n")
SOUND = function(EVEN, VALUES, ord_data_type=5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[: len(t) // 2], r"a.uff:3: dataset 58: expected a line of -1"),
        (lambda t: t.replace(b"    58", b"    xx"), r"a.uff:2: expected the number"),
        (lambda t: re.sub(rb"(\n[^\n]*){3}(?=\n    -1\n$)", b"", t), "cut off"),
        (lambda t: FIRST.sub(b"\n" + b"NaN".rjust(13), t, 1), "expected finite values"),
        (lambda t: LAST.sub(b"\n", t, 1), "expected numbers up to the ends"),
        (lambda t: MIDDLE.sub(rb"\1\n", t, 1), "expected numbers up to the ends"),
        (lambda t: t.replace(b"        37 ", b"        30 ", 1), "as many values as"),
        (lambda _: b"nothing of this kind", "expected datasets between lines of -1"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(tmp_path, change, message):
    path = write(tmp_path / "a.uff", SOUND)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputError, match=message) as told:
        read_uff(path)
    assert "\n" not in str(told.value)


def test_numbers_that_are_not_aligned_are_not_cut_off(tmp_path):
    """Written to the left of their columns, without the blanks at the end of a line."""
    path = write(tmp_path / "a.uff", SOUND)
    sound = read_uff(path).responses[0].receptance
    text = path.read_bytes()
    left = re.sub(rb"( +)(-?\d\.\d{5}e[+-]\d\d)", rb"\2\1", text)
    path.write_bytes(re.sub(rb"(?<=e[+-]\d\d) +\n", b"\n", left))
    assert (read_uff(path).responses[0].receptance == sound).all()


@pytest.mark.parametrize("binary", [0, 1])
def test_a_million_lines_are_refused_at_once(tmp_path, binary):
    values = np.full(10**6, 1e-6 + 1e-8j)
    hertz = np.linspace(1.0, 900.0, len(values))
    path = write(tmp_path / "long.uff", function(hertz, values, binary=binary))
    start = time.process_time()
    with pytest.raises(InputError, match="at most 200,000 values, got 1,000,000"):
        read_uff(path)
    assert time.process_time() - start < 5.0


@pytest.mark.parametrize(
    "binary",
    [
        {"binary": 1, "ord_data_type": 5},
        {"binary": 1, "ord_data_type": 6},
        {"binary": 0, "ord_data_type": 6},
    ],
)
def test_values_that_no_instrument_measures_are_refused(tmp_path, binary):
    """Bytes in another order than stated, or numbers beyond all sizes."""
    values = VALUES * (1.0 if binary["binary"] else 1e300)
    path = write(tmp_path / "c.uff", function(EVEN, values, **binary))
    other = path.read_bytes().replace(b"    58b     1", b"    58b     2")
    path.write_bytes(other)
    with pytest.raises(InputError, match="expected finite values from 1e-30 to 1e30"):
        read_uff(path)


def test_a_huge_number_of_values_is_refused(tmp_path):
    path = write(tmp_path / "huge.uff", function(EVEN, VALUES, binary=1))
    stated = f"{COUNT:10d}".encode()
    path.write_bytes(path.read_bytes().replace(stated, b"9999999999", 1))
    with pytest.raises(InputError, match=r"huge.uff:9: dataset 58: expected at most"):
        read_uff(path)
