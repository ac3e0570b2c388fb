"""Simulate a hammer test of the Biglide at Q1, and write it as a universal file, tap.uff.

Hits along z at the tool (node 1) and at a corner of the platform (node 2); accelerations there
along z, and at the tool along y. Five averages with 2 % noise. Needs pyuff.
Run: python make_tap.py
"""

from pathlib import Path

import numpy as np
import pyuff

import stiffscope as ss
from stiffscope.vjm.vibration.frequency_response import Port, frequency_response

FREQUENCIES = np.arange(1.0, 301.0)  # Hz
AVERAGES = 5
NOISE = 0.02  # of the mean magnitude near each line
DAMPING = 0.02
CORNER = np.array([0.15, 0.1, 0.0])  # m, from the tool
HITS = ((1, 3), (2, 3))
SENSORS = ((1, 3), (2, 3), (1, 2))
"""Node and direction; 1, 2, 3: x, y, z."""


def simulate():
    """Return accelerance and coherence by sensor and hit."""
    robot = ss.load_robot("biglide")
    machine = ss.assemble(robot, "published")
    found = ss.configure(machine, [robot.poses["Q1"]])
    rng = np.random.default_rng(20261127)
    omega = 2 * np.pi * FREQUENCIES
    measured = {}
    places = {1: machine.tool.at, 2: machine.tool.at + CORNER}
    ends = {
        (node, axis): Port(None, places[node], np.eye(6)[axis - 1])
        for node, axis in {*HITS, *SENSORS}
    }
    for sensor in SENSORS:
        for hit in HITS:
            receptance = frequency_response(
                machine, found, ends[hit], ends[sensor], FREQUENCIES, damping=DAMPING
            )
            accelerance = -(omega**2) * receptance
            scatter = NOISE * np.abs(accelerance) + 1e-4
            noise = rng.normal(size=(2, len(omega))) * scatter / np.sqrt(2 * AVERAGES)
            squared = np.abs(accelerance) ** 2
            coherence = squared / (squared + scatter**2)
            measured[sensor, hit] = (
                accelerance + noise[0] + 1j * noise[1],
                coherence,
            )
    return measured


def describe(kind, sensor, hit, values):
    """Return a dataset 58 as pyuff writes it."""
    of_motion = 12 if kind == 4 else 0
    return {
        "type": 58,
        "func_type": kind,
        "id1": "Biglide at Q1, simulated hammer test",
        "rsp_node": sensor[0],
        "rsp_dir": sensor[1],
        "ref_node": hit[0],
        "ref_dir": hit[1],
        "data": values,
        "x": FREQUENCIES,
        "ord_data_type": 5 if kind == 4 else 2,
        "abscissa_spacing": 1,
        "abscissa_spec_data_type": 18,
        "ordinate_spec_data_type": of_motion,
        "ordinate_axis_units_lab": "m/s^2" if kind == 4 else "NONE",
        "orddenom_spec_data_type": 13 if kind == 4 else 0,
        "orddenom_axis_units_lab": "N" if kind == 4 else "NONE",
    }


def write(path):
    """Write the nodes and all responses with their coherences."""
    path.unlink(missing_ok=True)
    tool = ss.load_robot("biglide").tool.at
    places = np.array([tool, tool + CORNER])
    nodes = {
        "type": 15,
        "node_nums": [1, 2],
        "def_cs": [0, 0],
        "disp_cs": [0, 0],
        "color": [0, 0],
        "x": places[:, 0],
        "y": places[:, 1],
        "z": places[:, 2],
    }
    sets = [nodes]
    for (sensor, hit), (values, coherence) in simulate().items():
        sets += [
            describe(4, sensor, hit, values),
            describe(6, sensor, hit, coherence),
        ]
    for each in sets:
        pyuff.UFF(str(path)).write_sets(each, mode="add", force_double=False)


if __name__ == "__main__":
    write(Path(__file__).with_name("tap.uff"))
