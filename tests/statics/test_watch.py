"""`stiffscope run --watch`: a saved file is run again, a bad one is told, and the page says which run it shows."""

import itertools
import re
import shutil
import threading
import time

import numpy as np
import pytest

from stiffscope.cli.main import _guarded
from stiffscope.experiments.watching import (
    changes,
    differences,
    digest_sources,
    sources,
)
from tests.experiments.one_part import MATRIX, ROD, STEP, one_part

pytestmark = pytest.mark.slow


def test_content_decides_what_has_changed(tmp_path):
    one = tmp_path / "one"
    two = tmp_path / "two"
    one.write_text("a")
    two.write_text("b")
    watch = changes([one, two])
    next(watch)
    found = []
    thread = threading.Thread(target=lambda: found.append(next(watch)), daemon=True)
    thread.start()
    one.write_text("a")  # saved, not changed
    shutil.copyfile(two, tmp_path / "aside")
    two.unlink()
    time.sleep(0.3)
    (tmp_path / "aside").rename(two)  # as editors save
    time.sleep(0.3)
    assert thread.is_alive()
    one.write_text("")  # as editors begin to write
    time.sleep(0.3)
    one.write_text("a")
    time.sleep(0.3)
    assert thread.is_alive()
    one.write_text("c")
    thread.join(5)
    assert found == [None]


def test_a_file_that_stays_away_has_changed_and_so_has_it_when_it_is_back(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("stiffscope.experiments.watching.GONE", 0.2)
    solid = tmp_path / "bar.step"
    solid.write_text("a solid")
    watch = changes([solid])
    seen = []
    next(watch)
    thread = threading.Thread(
        target=lambda: seen.extend(solid.exists() for _ in itertools.islice(watch, 2))
    )
    thread.start()
    solid.unlink()
    time.sleep(1.0)
    assert seen == [False]
    solid.write_text("a solid")
    thread.join(5)
    assert seen == [False, True]


def test_sources_and_differences(tmp_path):
    robot = one_part(tmp_path, STEP)
    assert sources(robot) == [tmp_path / "robot.toml", tmp_path / "bar.step"]
    before = one_part(tmp_path, ROD)
    after = one_part(tmp_path, ROD.replace('"6 mm"', '"7 mm"').replace("8 mm", "9 mm"))
    assert differences(before, before) == []
    (tmp_path / "bar.step").write_text("a solid")
    held = digest_sources(robot)
    (tmp_path / "bar.step").write_text("another solid")
    assert differences(robot, robot, held, digest_sources(robot)) == [
        "content of bar.step"
    ]
    assert differences(robot, robot, held, held) == []
    assert differences(before, after) == [
        "bar 1.radius 6 mm → 7 mm",
        "bar 1.mesh.size 8 mm → 9 mm",
    ]


@pytest.fixture
def undrawn(monkeypatch):
    """Pictures take processes of their own, which this does not try."""
    monkeypatch.setattr(
        "stiffscope.statics.command.run.write_pictures", lambda *_: None
    )
    monkeypatch.setattr("stiffscope.statics.command.run.keep_warm", lambda: None)


def test_each_saved_file_is_run_and_a_bad_one_is_told(
    tmp_path, monkeypatch, capsys, undrawn
):
    one_part(tmp_path, MATRIX)
    monkeypatch.setattr(
        "stiffscope.statics.command.run.stiffness_bars",
        lambda *_: np.full((1, 6, 6), 1.5e4),
    )
    file = tmp_path / "robot.toml"
    out = tmp_path / "out"
    text = file.read_text()
    saved = [
        text.replace("stiffness = 1e7", "stiffness = 2e7"),
        text.replace("prismatic", "prismatik"),
        text,
    ]
    states = []

    def edited(_files):
        yield
        for each in saved:
            file.write_text(each)
            yield
            states.append(capsys.readouterr())
        raise KeyboardInterrupt

    monkeypatch.setattr("stiffscope.statics.command.run.changes", edited)
    assert _guarded(["run", str(file), "--out", str(out), "--watch"]) == 0
    changed, bad, back = states
    assert "slide.drive.stiffness 10000000.0 → 20000000.0" in changed.out
    stiffer = (1 / 1e7 + 1e-8) / (1 / 2e7 + 1e-8)  # drive and part in series
    assert f"{100 * (stiffer - 1):+.2f} %" in changed.out
    assert changed.out.partition("before")[2].count("± 95 %") == 2
    assert "robot.toml" in bad.err
    assert 'did you mean "prismatic"' in bad.err
    assert "before" not in bad.out
    assert f"{100 * (1 / stiffer - 1):+.2f} %" in back.out
    state = re.search(r'state: "(.+?)"', (out / "state.html").read_text())
    assert state
    assert f'"{state[1]}") location.reload()' in (out / "report.html").read_text()


def test_a_run_that_is_not_watched_has_no_script_that_reloads(tmp_path, undrawn):
    one_part(tmp_path, MATRIX)
    assert (
        _guarded(
            [
                "run",
                str(tmp_path / "robot.toml"),
                "--out",
                str(tmp_path / "out"),
                "--quiet",
            ]
        )
        == 0
    )
    page = (tmp_path / "out" / "report.html").read_text()
    assert "default-src 'none'" in page
    assert "location.reload" not in page
    assert not (tmp_path / "out" / "state.html").exists()
