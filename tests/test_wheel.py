"""The wheel, installed beside its dependencies in an environment of its own and used from an empty folder."""

import json
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest

import stiffscope as ss

pytestmark = [pytest.mark.slow, pytest.mark.extended]

ROOT = Path(__file__).parents[1]
SOURCES = ("stiffscope", "cad", "fea", "vjm", "data")


def call(*command, cwd: Path) -> str:
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """Folder of an environment: the wheel is installed, the libraries are those of this environment."""
    folder = tmp_path_factory.mktemp("wheel")
    copy = folder / "sources"
    for name in SOURCES:
        shutil.copytree(
            ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "README.md"):
        shutil.copyfile(ROOT / name, copy / name)
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    call(
        *pip,
        "wheel",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
        folder,
        copy,
        cwd=folder,
    )
    shutil.rmtree(copy)
    venv.create(folder / "env", with_pip=False)
    (wheel,) = folder.glob("*.whl")
    call(
        *pip,
        "--python",
        folder / "env",
        "install",
        "--no-deps",
        "--no-index",
        wheel,
        cwd=folder,
    )
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site(folder / "env") / "libraries.pth").write_text("\n".join(libraries) + "\n")
    return folder / "env"


def site(environment: Path) -> Path:
    return next(environment.glob("**/site-packages"))


def test_site_packages_gets_the_package_and_nothing_else(installed):
    names = {
        path.name
        for path in site(installed).iterdir()
        if path.suffix not in {".dist-info", ".pth"}
    }
    assert names == {"stiffscope"}


def test_all_data_and_all_code_are_in_it(installed):
    for source in SOURCES:
        target = (
            site(installed) / "stiffscope" / ("" if source == "stiffscope" else source)
        )
        files = [
            path
            for path in (ROOT / source).rglob("*")
            if path.is_file() and "__pycache__" not in path.parts
        ]
        assert files
        for path in files:
            assert (
                target / path.relative_to(ROOT / source)
            ).read_bytes() == path.read_bytes()


def test_it_works_from_an_empty_folder(installed, tmp_path):
    python = next(installed.glob("*/python"))
    told = call(
        python, "-c", "import stiffscope.cad as c; print(c.__file__)", cwd=tmp_path
    )
    assert Path(told.strip()).is_relative_to(installed)
    told = call(
        python,
        "-m",
        "stiffscope",
        "stiffness",
        "biglide",
        "--components",
        "published",
        "--json",
        "-",
        cwd=tmp_path,
    )
    robot = ss.load_robot("biglide")
    expected = ss.stiffness(ss.assemble(robot, "published"), list(robot.poses.values()))
    off = np.abs(np.array(json.loads(told)["stiffness"]) - expected)
    assert (
        off.max() < 1e-12 * np.abs(expected).max()
    )  # zeros are rounding, another one in each process
    assert call(python.with_name("stiffscope"), "--version", cwd=tmp_path).startswith(
        "stiffscope "
    )
    assert list(tmp_path.iterdir()) == []
