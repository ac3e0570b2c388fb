"""The command line: exit codes, one line for what is wrong, nothing loaded that is not needed."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from stiffscope.cad.solid import build
from stiffscope.cad.step import write_step
from stiffscope.cli.main import _guarded, cli
from stiffscope.robot.library import find_robot
from stiffscope.robot.reader import load_robot
from stiffscope.runtime.output import staged_folder
from tests.experiments.one_part import MATRIX, one_part

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-c", "from stiffscope.cli.main import main; main()"]


def stiffscope(*arguments, **more) -> subprocess.CompletedProcess:
    environment = {**os.environ, **more.pop("env", {})}
    return subprocess.run(
        [*COMMAND, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        **more,
    )


def answer(capsys, *arguments) -> dict:
    """What a command says as JSON, in this process: nothing is imported anew."""
    assert _guarded([*arguments, "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_help_loads_nothing_heavy():
    heavy = [
        "numpy",
        "scipy",
        "pydantic",
        "pint",
        "rich",
        "pyvista",
        "OCP",
        "matplotlib",
    ]
    code = "import sys; from stiffscope.cli.main import _guarded; _guarded(['--help'])"
    code += "; print(set(sys.argv) & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code, *heavy], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "set()"


@pytest.mark.extended_for("path")
@pytest.mark.parametrize("command", ["live", "gap", "path", "statics.command.run"])
def test_a_command_starts_without_what_only_its_work_needs(command):
    """A page of live stands sooner by the seconds that these take to load."""
    late = ["scipy.signal", "scipy.stats", "OCP", "pyvista", "optuna"]
    module = f"stiffscope.{command}" + ".command" * ("." not in command)
    code = f"import sys, {module}; print(*set(sys.argv) & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code, *late], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def test_version():
    assert stiffscope("--version").stdout.startswith("stiffscope ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["stiffness", "nosuch"],
            "nosuch: expected a robot file or one of biglide, delta, ",
        ),
        (
            ["stiffness", "biglide", "--at", "0,0,3", "--components", "published"],
            "out of reach",
        ),
        (
            ["stiffness", "biglide", "--set", "poses.Q1=[0, 0, 9]"],
            "Q1: expected a pose that the robot reaches, got another: out of reach: the loop through joints.",
        ),
        (["stiffness", "biglide", "--at", "0,0,1e308"], "which is beyond 10000 m"),
        (
            ["stiffness", "biglide", "--set", "parameters.a_min=0.7 m"],
            'joints."limb1.actuator".drive.range: expected a lo',
        ),
        (
            ["stiffness", "delta", "--joints", "leg1.moto=1"],
            'got "leg1.moto"; did you mean "leg1.motor"?',
        ),
        (
            ["stiffness", "delta", "--joints", "leg1.motor=1 mm"],
            'expected an angle such as "25 deg", got "1 mm"',
        ),
        (
            ["stiffness", "delta", "--joints", "leg1.motor"],
            'DRIVE=POSITION,… such as "leg1.motor=10 mm", got "leg1.mo',
        ),
        (
            ["stiffness", "delta", "--joints", "leg1.motor=80 deg"],
            "80 deg is outside its range -45 to 75 deg",
        ),
        (
            ["stiffness", "delta", "--joints", "leg1.motor=0", "--at", "home"],
            "either poses with --at or drives",
        ),
        (
            ["stiffness", "stewart", "--at", "0,0,0.3"],
            "expected X,Y,Z,RX,RY,RZ such as",
        ),
        (
            ["stiffness", "delta", "--gravity", "literal"],
            "--gravity literal: expected the Biglide",
        ),
        (
            ["map", "biglide", "--gravity", "literal", "--out", "out"],
            "--gravity literal: expected none or exact",
        ),
        (
            ["compliance", "delta", "--part", "link"],
            "part: expected one of arm, rod, got 'link'",
        ),
        (["new", "dleta", "mine.toml"], 'did you mean "delta"?'),
        (["import", "nosuch.urdf", "--out", "mine.toml"], "nosuch.urdf"),
        (
            [
                "deflection",
                "biglide",
                "--components",
                "beam",
                "--wrench",
                "1e200,0,0,0,0,0",
            ],
            "got 1e+200, which is beyond 1e+12 N",
        ),
        (
            ["deflection", "biglide", "--wrench", "1 N,0,0,0,0"],
            "--wrench 1 N,0,0,0,0: expected 6 values",
        ),
        (
            ["deflection", "biglide", "--wrench", "1 m,0,0,0,0,0"],
            'a force such as "100 N", got "1 m", which is a length',
        ),
        (
            ["deflection", "biglide", "--wrench", "1,0,0,0,0,5 N"],
            'a moment such as "5 N*m", got "5 N", which is a force',
        ),
        (
            ["stiffness", "biglide", "--set", "effects=3"],
            "--set effects=3: expected NAME.KEY=VALUE such as",
        ),
        (["stiffness", "biglide", "--at", "0,0"], "expected X,Y,Z"),
        (["stiffness", "biglide", "--at", "0,0,nan"], "--at 0,0,nan"),
        (["stiffness", "biglide", "--at", "0,0,3 kg"], "which is a mass"),
        (["stiffness", "biglide", "--components", "guess"], "--components"),
        (
            ["stiffness", "biglide", "--set", "slider.thickness=12kg"],
            "--set slider.thickness",
        ),
        (
            ["stiffness", "biglide", "--set", "link.mesh=3"],
            "--set link.mesh=3: parts.link.mesh: expected a table of size, ",
        ),
        (
            [
                "stiffness",
                "biglide",
                "--set",
                "slider.pads=apart",
                "--set",
                "slider.pad_height=9mm",
            ],
            'got "apart"',
        ),
        (["audit", "--json", ""], "expected a file to write"),
        (
            [
                "deflection",
                "nosuch/x.toml",
                "--wrench",
                "1,0,0,0,0,0",
                "--json",
                "/none/x",
            ],
            "cannot be written",
        ),
        (
            ["import", "x.urdf", "--out", "x.toml", "--json", "./x.toml"],
            "x.toml: expected a file for the JSON alone",
        ),
        (
            ["diagnose", "gauges", "--out", "out", "--adopt", "x", "--json", "x"],
            "x: expected a file for the JSON alone",
        ),
        (["compliance", "biglide"], "--part"),
        (
            ["compliance", "biglide", "--part", "link", "--step", "nosuch.step"],
            "nosuch.step: expected a STEP file, got no file",
        ),
        (["run", "biglide"], "--out"),
        (["run", "biglide", "--out", "/proc/stiffscope"], "cannot be written"),
        (["run", "biglide", "--out", "."], "the one you are in"),
        (
            ["import", "nosuch.step", "--out", "."],
            ".: expected the name of a file to write, got none",
        ),
        (
            ["import", "nosuch.urdf", "--out", "/"],
            "/: expected the name of a file to write, got none",
        ),
        (
            ["new", "delta", "a.toml", "--json", "./a.toml"],
            "a.toml: expected a file for the JSON alone, got one that",
        ),
        (["nosuch"], "No such command"),
        (
            ["stiffnes", "delta"],
            "No such command 'stiffnes'; did you mean \"stiffness\"?",
        ),
        (["campaign", "chek", "x"], 'did you mean "check"?'),
        (
            ["stiffness", "delta", "--at", "0,0,-1000"],
            "numbers without a unit are m and rad",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert _guarded(list(arguments)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert message in err
    assert os.listdir(tmp_path) == []


def test_without_arguments_the_help_is_printed_as_it_is():
    bare = stiffscope()
    asked = stiffscope("--help")
    assert (bare.returncode, bare.stdout) == (2, "")
    assert bare.stderr.strip() == asked.stdout.strip()
    assert len(bare.stderr.splitlines()) > 15


def test_help_names_a_default_without_brackets(capsys):
    assert _guarded(["map", "--help"]) == 0
    assert "[default: exact]" in " ".join(capsys.readouterr().out.split())
    assert _guarded(["stiffness", "--help"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "[default: (none, unless the robot file has adopted gravity)]" in told


def test_poses_and_wrenches_take_units(capsys):
    same = (
        ("0,0,0.35", "100,0,-2000,0,0,0.005"),
        ("0 mm,0 mm,350 mm", "100 N, 0,-2 kN,0 N*m,0,5 N*mm"),
    )
    one, other = (
        answer(
            capsys,
            "deflection",
            "biglide",
            "--at",
            at,
            "--wrench",
            wrench,
            "--components",
            "published",
        )
        for at, wrench in same
    )
    assert np.array(one["twist"]) == pytest.approx(
        np.array(other["twist"]), rel=1e-12, abs=1e-18
    )
    assert one["wrench"] == [100, 0, -2000, 0, 0, 0.005]


@pytest.fixture
def foreign(tmp_path):
    """A working folder with a user's own modules, named as ours, as those of libraries and as Python's."""
    for name in (
        "app",
        "cad",
        "fea",
        "vjm",
        "data",
        "numpy",
        "random",
        "click",
        "skfem",
        "multiprocessing",
    ):
        (tmp_path / f"{name}.py").write_text(
            f"raise RuntimeError('{name}.py of the working folder was imported')"
        )
    (tmp_path / "gap").mkdir()
    (tmp_path / "gap" / "__init__.py").write_text("raise RuntimeError('gap/')")
    return tmp_path


@pytest.mark.extended_for("arguments0", "arguments1")
@pytest.mark.parametrize(
    "arguments",
    [
        ["faces", "part.step", "--json", "-"],
        [
            "compliance",
            "biglide",
            "--part",
            "link",
            "--set",
            "link.mesh.size=60mm",
            "--json",
            "-",
        ],
        ["stiffness", "biglide", "--components", "published", "--json", "-"],
        pytest.param(
            ["diagnose", "published", "--out", "out", "--json", "-"],
            marks=pytest.mark.long,
        ),
        pytest.param(
            [
                "blind",
                "five-bar",
                "--components",
                "beam",
                "--campaigns",
                "1",
                "--out",
                "out",
                "--json",
                "-",
            ],
            marks=pytest.mark.long,
        ),
    ],
)
def test_modules_of_the_working_folder_change_nothing(foreign, arguments):
    if "part.step" in arguments:
        robot = load_robot("biglide")
        write_step(
            build(robot.parts["slider"].parameters(), robot.material("slider")),
            foreign / "part.step",
        )
    environment = {**os.environ, "STIFFSCOPE_CACHE": str(foreign / "cache")}
    command = [sys.executable, "-m", "stiffscope", *arguments, "--quiet"]
    done = subprocess.run(
        command,
        cwd=foreign,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    json.loads(done.stdout)


def test_stiffness_of_the_published_robot_as_json(capsys):
    """Figures of the verified mechanics for Eqs. (28) and (29) at x = y = 0, q = 36 and 66 degrees."""
    heights = [float(0.055 + 0.5 * np.sin(np.radians(q))) for q in (36, 66)]
    at = [word for z in heights for word in ("--at", f"0,0,{z!r}")]
    found = answer(capsys, "stiffness", "biglide", *at, "--components", "published")
    expected = [
        [23.82111, 1.96743, 12.574307, 1.464912, 0.141031, 2.819319],
        [17.883256, 1.96691, 90.215325, 3.442252, 0.699246, 0.759309],
    ]
    assert np.diagonal(found["stiffness"], axis1=1, axis2=2) / 1e6 == pytest.approx(
        np.array(expected), rel=2e-5
    )
    assert found["mobility"] == [0, 0]
    assert np.array(found["sag"]).tolist() == np.zeros((2, 6)).tolist()


def test_no_command_writes_over_its_input(tmp_path, monkeypatch, capsys):
    """Neither over the robot file, even if forced, nor over its folder, even if that is an output of ours."""
    monkeypatch.chdir(tmp_path)
    text = find_robot("stewart").read_text()
    with staged_folder("out") as folder:
        (folder / "robot.toml").write_text(text)
        (folder / "manifest.json").write_text("{}")
    Path("robot.toml").write_text(text)
    Path("link.json").symlink_to("robot.toml")
    Path("round").symlink_to("round")
    assert _guarded(["check", "robot.toml", "--out", "round"]) == 2
    assert (
        "round: the output folder cannot be written (a link that leads back to itself)"
        in capsys.readouterr().err
    )
    for name in ("robot.toml", "link.json", "./out/../robot.toml"):
        assert _guarded(["stiffness", "robot.toml", "--json", name, "--force"]) == 2
        assert (
            f"{name}: expected a file for the JSON alone, got one that the command also"
            in capsys.readouterr().err
        )
    assert _guarded(["map", "out/robot.toml", "--out", "out", "--force"]) == 2
    assert (
        "out/robot.toml: expected a file outside out, which is replaced as a whole"
        in capsys.readouterr().err
    )
    for _ in range(2):
        assert _guarded(["stiffness", "robot.toml", "--json", "k.json", "--quiet"]) == 0
    assert Path("robot.toml").read_text() == Path("out/robot.toml").read_text() == text


def test_sag_under_its_own_weight(capsys):
    words = (
        "stiffness",
        "biglide",
        "--at",
        "0,0,0.35",
        "--components",
        "published",
        "--gravity",
        "exact",
    )
    assert answer(capsys, *words)["sag"][0][2] == pytest.approx(10.8e-6, rel=1e-2)


@pytest.mark.extended_for("15")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_run_leaves_nothing(tmp_path, how):
    environment = {**os.environ, "STIFFSCOPE_CACHE": str(tmp_path / "cache")}
    # shells' background jobs do not
    heeding = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    running = subprocess.Popen(
        [
            *COMMAND[:2],
            f"{heeding}; {COMMAND[2]}",
            "run",
            "biglide",
            "--out",
            str(tmp_path / "out"),
            "--set",
            "link.length=505mm",
        ],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )
    time.sleep(2.5)
    running.send_signal(how)
    _, errors = running.communicate(timeout=20)
    assert running.returncode == 1
    assert errors.strip() == "stiffscope: stopped; nothing half-written is left"
    assert os.listdir(tmp_path) in ([], ["cache"])
    assert not list((tmp_path / "cache").rglob("*.npz"))


def test_poses_by_the_drives(capsys):
    """A robot at the drives' positions that a tool pose needs is where that pose says, and as stiff."""
    drives = answer(capsys, "check", "delta")["poses"]["side"]["drives"]
    joints = ",".join(f"leg{k + 1}.motor={value!r}" for k, value in enumerate(drives))
    one, other = (
        answer(capsys, "stiffness", "delta", *words, "--components", "beam")
        for words in (("--at", "side"), ("--joints", joints))
    )
    for key in ("poses", "tool", "stiffness"):
        found = np.array(other[key])
        expected = np.array(one[key])
        assert found == pytest.approx(
            expected, rel=1e-9, abs=1e-9 * np.abs(expected).max()
        )


@pytest.mark.extended
def test_a_robot_of_ones_own(tmp_path, capsys):
    assert {"biglide", "delta", "stewart"} <= set(answer(capsys, "robots"))
    mine = tmp_path / "mine.toml"
    assert _guarded(["new", "stewart", str(mine)]) == 0
    assert "Next: stiffscope check" in capsys.readouterr().out
    assert _guarded(["check", str(mine), "--out", str(tmp_path / "out")]) == 0
    assert "Mobility at home" in capsys.readouterr().out
    assert {"check.json", "manifest.json"} <= set(os.listdir(tmp_path / "out"))
    assert _guarded(["new", "delta", str(mine)]) == 2
    assert "expected a file that is not there yet" in capsys.readouterr().err


def test_a_simulators_model_becomes_a_robot(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(
        """<robot name="arm"><link name="base"/>
        <link name="upper"><inertial><mass value="2"/><origin xyz="0 0 0.2"/>
        <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    words = [
        "import",
        str(tmp_path / "arm.urdf"),
        "--out",
        str(tmp_path / "arm.toml"),
        "--drive",
        "j=5 kN*m/rad",
    ]
    assert _guarded(words) == 0
    assert "driven: j" in capsys.readouterr().out
    robot = load_robot(tmp_path / "arm.toml")
    assert robot.joints["j"].drive.stiffness == 5e3


def test_a_load_path_of_drives_with_backlash(tmp_path, capsys):
    text = (Path(__file__).parents[1] / "vjm" / "robots" / "stewart.toml").read_text()
    law = 'drive = { curve = [["2 um", "20 N"], ["8 um", "140 N"]], backlash = "4 um" }'
    robot = tmp_path / "loose.toml"
    robot.write_text(text.replace("drive = { stiffness = 20000000.0 }", law))
    found = answer(
        capsys,
        "deflection",
        str(robot),
        "--at",
        "0,0,0.135,0,0,0",
        "--wrench",
        "0,0,300,0,0,0",
        "--steps",
        "2",
    )
    path = found["path"]
    assert path["load"] == [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0]
    z = [each[2] for each in path["twist"][0]]
    assert z[1] == pytest.approx(z[3], rel=1e-12)
    assert z[2] == pytest.approx(-z[6], rel=1e-9)
    assert path["stiffness"][0][0][2][2] == 0.0


def test_what_a_published_matrix_does_not_follow_is_said(caplog):
    words = ["stiffness", "biglide", "--at", "0,0,0.35", "--components", "published"]
    assert (
        _guarded([*words, "--set", "link.radius=30mm"]) == 0
    )  # its formula follows the radius
    assert not caplog.messages
    assert _guarded([*words, "--set", "slider.thickness=25mm"]) == 0
    said = "--set slider.thickness=25mm: changes nothing of the compliance of slider, which is as published"
    assert caplog.messages == [said]


@pytest.mark.parametrize(
    "command", [["stiffness"], ["modes"], ["run", "--out", "{}/out"]]
)
def test_a_robot_without_a_drive_is_refused_by_the_name_of_its_file(
    tmp_path, capsys, command
):
    file = tmp_path / "loose.toml"
    joint = '[joints.j]\nbetween = ["ground", "a"]\ntype = "revolute"\nat = [0, 0, 0]\naxis = [0, 0, 1]\n'
    tool = '[tool]\nbody = "a"\nat = ["30 cm", 0, 0]\npose = ["y"]\n'
    file.write_text(f'name = "loose"\n[bodies.a]\n{joint}{tool}')
    assert (
        _guarded(
            [command[0], str(file), *(word.format(tmp_path) for word in command[1:])]
        )
        == 2
    )
    assert capsys.readouterr().err.startswith(f"stiffscope: {file}: ")


def test_a_matrix_that_contradicts_its_length_is_doubted_once_by_each_command(
    tmp_path, caplog
):
    one_part(tmp_path, MATRIX)
    assert _guarded(["stiffness", str(tmp_path / "robot.toml")]) == 0
    (said,) = caplog.messages
    assert "part bar 1: √(3·C22/C66) = 1.73 m" in said


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        ImportError("a.so: failed to map segment"),
        OSError(12, os.strerror(12)),
    ],
)
def test_a_lack_of_memory_is_told_by_that_name(error, monkeypatch, capsys):
    monkeypatch.setattr(cli, "main", Mock(side_effect=error))
    assert _guarded(["robots"]) == 1
    assert capsys.readouterr().err.startswith(
        "stiffscope: not enough memory; use a machine with more or, where"
    )


def test_a_stop_that_a_library_turns_into_its_own_error_is_a_stop(monkeypatch, capsys):
    """As NumPy's compiled modules do while they are imported."""

    def load(_name):
        try:
            signal.raise_signal(signal.SIGTERM)
        except BaseException as stop:
            raise ImportError("initialization failed") from stop

    former = {
        number: signal.getsignal(number)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    monkeypatch.setattr("stiffscope.cli.main.import_module", load)
    try:
        assert _guarded(["check", "delta"]) == 1
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
    assert (
        capsys.readouterr().err == "stiffscope: stopped; nothing half-written is left\n"
    )
