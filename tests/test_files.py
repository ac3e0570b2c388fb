"""An output folder is complete or absent, and only ours is replaced."""

import json
import os

import pytest

from stiffscope.errors import InputError
from stiffscope.files import check_output, staged_folder, to_json, write_json


def fill(target, **contents) -> None:
    with staged_folder(target) as folder:
        for name, text in contents.items():
            (folder / name).write_text(text)


def test_output_is_replaced_as_a_whole(tmp_path):
    fill(tmp_path / "a" / "out", old="1", same="1")
    fill(tmp_path / "a" / "out", same="2")
    assert sorted(os.listdir(tmp_path / "a" / "out")) == ["manifest.json", "same"]
    assert os.listdir(tmp_path / "a") == ["out"]
    assert json.loads((tmp_path / "a" / "out" / "manifest.json").read_text())["files"] == ["same"]


def test_failure_leaves_what_was_there(tmp_path):
    fill(tmp_path / "out", kept="1")
    with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "out") as folder:
        (folder / "half").write_text("")
        raise KeyboardInterrupt
    assert sorted(os.listdir(tmp_path / "out")) == ["kept", "manifest.json"]
    assert os.listdir(tmp_path) == ["out"]


def test_what_a_killed_run_left_is_cleared(tmp_path):
    (tmp_path / ".out.partial-999999999-abc").mkdir()
    (tmp_path / f".out.partial-{os.getpid()}-abc").mkdir()
    fill(tmp_path / "out", done="1")
    assert sorted(os.listdir(tmp_path)) == [f".out.partial-{os.getpid()}-abc", "out"]


@pytest.mark.parametrize("foreign", [True, False])
def test_a_file_that_is_not_ours_is_not_deleted(tmp_path, foreign):
    if foreign:
        (tmp_path / "out").mkdir()
    else:
        fill(tmp_path / "out", result="1")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt.*did not write"):
        fill(tmp_path / "out", result="2")
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_impossible_targets_are_refused_early(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for target, why in [(tmp_path / "file", "is a file"), (tmp_path / "file" / "out", "is a file")]:
        with pytest.raises(InputError, match=why):
            check_output(target)
    monkeypatch.chdir(tmp_path)
    for here in (".", "..", tmp_path):
        with pytest.raises(InputError, match="the one you are in"):
            check_output(here)
    with pytest.raises(InputError, match="cannot be written"):
        check_output("/proc/out")


def test_a_file_of_its_own_is_not_in_an_output_folder(tmp_path):
    fill(tmp_path / "out", result="1")
    (tmp_path / "link").symlink_to(tmp_path / "out")
    for file in (tmp_path / "out" / "a.json", tmp_path / "link" / "deep" / "a.json"):
        with pytest.raises(InputError, match=r"a\.json: is in .*out, which is replaced as a whole"):
            check_output(tmp_path / "out", None, str(file))
    check_output(tmp_path / "out", None, "-", tmp_path / "a.json")


def test_json_is_strict_and_readable(tmp_path, capsys):
    import numpy as np

    text = to_json({"matrix": np.eye(2), "bad": float("nan"), "path": tmp_path})
    assert json.loads(text) == {"matrix": [[1, 0], [0, 1]], "bad": None, "path": str(tmp_path)}
    assert "[1.0, 0.0]" in text
    assert to_json([-0.0, np.array([-0.0, -1.0])]) == "[\n  0.0,\n  [0.0, -1.0]\n]\n"
    write_json("-", {"a": 1})
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    write_json(tmp_path / "a.json", {"a": 1})
    assert os.listdir(tmp_path) == ["a.json"]
    for where in ("none", "a.json"):  # neither is a folder
        with pytest.raises(InputError, match="cannot be written"):
            write_json(tmp_path / where / "a.json", {})
    with pytest.raises(InputError, match="give a file"):
        write_json("/", {})


def test_an_output_folder_behind_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "now").symlink_to(tmp_path / "real")
    with staged_folder(tmp_path / "now") as folder:
        (folder / "a").write_text("a")
    assert (tmp_path / "real" / "a").read_text() == "a"
    assert sorted(os.listdir(tmp_path)) == ["now", "real"]
    with pytest.raises(InputError, match="cannot be written"):
        check_output(tmp_path / ("y" * 300))


def test_a_link_is_followed_and_a_pipe_is_written_to(tmp_path):
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    write_json(tmp_path / "link.json", {"a": 1})
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text()) == {"a": 1}
    ours, theirs = os.pipe()
    write_json(f"/dev/fd/{theirs}", {"a": 2})
    assert json.loads(os.read(ours, 100)) == {"a": 2}
