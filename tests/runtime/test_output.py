"""An output folder is complete or absent, and only ours is replaced."""

import errno
import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from stiffscope.errors import InputError, StiffscopeError
from stiffscope.runtime.output import (
    check_json,
    check_output,
    copy_files,
    overwrite,
    owner,
    remove_copied,
    scratch_folder,
    staged_folder,
    to_json,
    write_json,
)

DEAD = f"999999999-{owner().partition('-')[2]}"


def fill(target, **contents) -> None:
    with staged_folder(target) as folder:
        for name, text in contents.items():
            (folder / name).write_text(text)


def test_output_is_replaced_as_a_whole(tmp_path):
    fill(tmp_path / "a" / "out", old="1", same="1")
    fill(tmp_path / "a" / "out", same="2")
    assert sorted(os.listdir(tmp_path / "a" / "out")) == ["manifest.json", "same"]
    assert os.listdir(tmp_path / "a") == ["out"]
    assert json.loads((tmp_path / "a" / "out" / "manifest.json").read_text())[
        "files"
    ] == ["same"]
    fill(tmp_path / "out", **{"a\udcff": "1"})  # a name that is no UTF-8
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["files"] == [
        "a\udcff"
    ]


def test_failure_leaves_what_was_there(tmp_path):
    fill(tmp_path / "out", kept="1")
    with pytest.raises(KeyboardInterrupt), staged_folder(tmp_path / "out") as folder:
        (folder / "half").write_text("")
        raise KeyboardInterrupt
    assert sorted(os.listdir(tmp_path / "out")) == ["kept", "manifest.json"]
    assert os.listdir(tmp_path) == ["out"]


def test_what_a_killed_run_left_is_cleared(tmp_path):
    ours = owner()
    (tmp_path / f".out.partial-{DEAD}").mkdir()
    (tmp_path / f".out.partial-{ours}").mkdir()
    fill(tmp_path / "out", done="1")
    assert sorted(os.listdir(tmp_path)) == [f".out.partial-{ours}", "out"]


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
    for target, why in [
        (tmp_path / "file", "a file"),
        (tmp_path / "file" / "out", "a file"),
    ]:
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
        with pytest.raises(
            InputError,
            match=r"a\.json: expected a file outside .*out, which is replaced as a whole",
        ):
            check_output(tmp_path / "out", None, str(file))
    check_output(tmp_path / "out", None, "-", tmp_path / "a.json")
    (tmp_path / "round.json").symlink_to(tmp_path / "round.json")
    with pytest.raises(InputError, match=r"round\.json: cannot be written"):
        check_output(tmp_path / "out", None, tmp_path / "round.json")


def test_json_is_strict_and_readable(tmp_path, capsys):
    import numpy as np

    text = to_json({"matrix": np.eye(2), "bad": float("nan"), "path": tmp_path})
    assert json.loads(text) == {
        "matrix": [[1, 0], [0, 1]],
        "bad": None,
        "path": str(tmp_path),
    }
    assert "[1.0, 0.0]" in text
    assert to_json([-0.0, np.array([-0.0, -1.0])]) == "[\n  0.0,\n  [0.0, -1.0]\n]\n"
    write_json("-", {"a": 1})
    assert json.loads(capsys.readouterr().out) == {"a": 1}
    write_json(tmp_path / "a.json", {"a": 1})
    assert os.listdir(tmp_path) == ["a.json"]
    for where in ("none", "a.json"):  # neither is a folder
        with pytest.raises(InputError, match="cannot be written"):
            write_json(tmp_path / where / "a.json", {})
    with pytest.raises(InputError, match="expected a file to write, got a folder"):
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
    assert json.loads((tmp_path / "real.json").read_text()) == {
        "made_by": "stiffscope",
        "a": 1,
    }
    ours, theirs = os.pipe()
    write_json(f"/dev/fd/{theirs}", {"a": 2})
    assert json.loads(os.read(ours, 100))["a"] == 2


@pytest.mark.parametrize("change", ["saved", "edited", "folder", "link"])
def test_what_the_user_does_while_we_work_is_kept(tmp_path, change):
    out = tmp_path / "out"
    fill(out, page="1", other="1")
    with (
        pytest.raises(
            InputError,
            match=r"out: .*; it stays as it is, and the new results are in .*out\.new",
        ),
        staged_folder(out) as folder,
    ):
        (folder / "page").write_text("2")
        if change == "saved":
            (out / "notes.txt").write_text("mine")
        elif change == "edited":
            (out / "page").write_text("1 and mine")
        elif change == "folder":
            (out / "empty").mkdir()
        else:
            (out / "page").rename(tmp_path / "page")
            (out / "page").symlink_to(tmp_path / "page")
    assert (out / "other").read_text() == "1"
    kept = {"saved": "notes.txt", "edited": "page", "folder": "empty", "link": "page"}[
        change
    ]
    assert os.path.lexists(out / kept)
    assert change != "edited" or (out / "page").read_text() == "1 and mine"
    assert (tmp_path / "out.new" / "page").read_text() == "2"
    fill(tmp_path / "out.new", page="3")  # it is a whole output itself
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_a_file_saved_between_the_looks_brings_the_old_folder_back(
    tmp_path, monkeypatch
):
    out = tmp_path / "out"
    fill(out, page="1")
    rename = Path.rename

    def late(self, goal):
        if self == out:
            (self / "late.txt").write_text("mine")
        return rename(self, goal)

    monkeypatch.setattr(Path, "rename", late)
    with pytest.raises(InputError, match=r'holds "late\.txt"'):
        fill(out, page="2")
    monkeypatch.undo()
    assert (out / "late.txt").read_text() == "mine"
    assert (out / "page").read_text() == "1"
    assert (tmp_path / "out.new" / "page").read_text() == "2"
    assert sorted(os.listdir(tmp_path)) == ["out", "out.new"]


def test_what_a_run_killed_in_the_exchange_left_is_put_right(tmp_path):
    out = tmp_path / "out"
    left = tmp_path / f".out.replaced-{DEAD}"
    fill(out, page="1")
    out.rename(left)
    fill(out, page="2")
    assert sorted(os.listdir(tmp_path)) == ["out"]
    out.rename(left)
    (left / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r'holds "notes\.txt"'):
        fill(out, page="3")  # brought back first: then it holds what is not ours
    assert (out / "notes.txt").read_text() == "mine"


def test_a_stop_while_a_scratch_folder_is_removed_does_not_keep_it(
    tmp_path, monkeypatch
):
    remove = shutil.rmtree
    stops = [KeyboardInterrupt]

    def stopped(*args, **kwargs):
        if stops:
            raise stops.pop()
        remove(*args, **kwargs)

    monkeypatch.setattr(shutil, "rmtree", stopped)
    with pytest.raises(KeyboardInterrupt), scratch_folder(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_scratch_folders_of_dead_processes_are_removed_and_no_others(tmp_path):
    dead = tmp_path / f".stiffscope-scratch-{DEAD}"
    ours = tmp_path / f".stiffscope-scratch-{owner()}"
    other = tmp_path / ".stiffscope-scratch-mine"
    for folder in (dead, ours, other):
        folder.mkdir()
    with scratch_folder(tmp_path) as folder:
        assert folder.is_dir()
    assert {each.name for each in tmp_path.iterdir()} == {ours.name, other.name}


@pytest.mark.skipif(
    os.name == "nt" or getattr(os, "geteuid", lambda: 1)() != 0,
    reason="needs to mount a small disk",
)
def test_a_full_disk_is_one_line_and_nothing_is_left(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk], check=False
    ).returncode:
        pytest.skip("no small disk can be mounted")
    try:
        with (
            pytest.raises(
                StiffscopeError,
                match=r"\(No space left on device\); make room on its disk",
            ),
            staged_folder(disk / "out") as folder,
        ):
            (folder / "large").write_bytes(bytes(1 << 20))
        with pytest.raises(StiffscopeError, match="No space left on device"):
            write_json(disk / "a.json", list(range(100_000)))
        with (
            pytest.raises(
                StiffscopeError,
                match=r"disk/out: the output folder cannot be written \(No space",
            ),
            staged_folder(disk / "out") as folder,
        ):
            write_json(folder / "a.json", list(range(100_000)))
        with (
            pytest.raises(
                StiffscopeError,
                match=r"disk/new: the output folder cannot be written \(No space",
            ),
            staged_folder(disk / "new", new=True) as folder,
        ):
            (folder / "large").write_bytes(bytes(1 << 20))
        with (
            pytest.raises(
                StiffscopeError,
                match=r"disk/out: the output folder cannot be written \(No space",
            ),
            staged_folder(disk / "out"),
        ):
            raise OSError(
                errno.ENOSPC,
                "Can't write data (time = Mon Nov 23\n, filename = ...)",
            )  # of HDF5
        assert os.listdir(disk) == []
        from build123d import Box

        from stiffscope.cad import kernel_files

        (disk / "fill").write_bytes(bytes(60 << 10))
        with pytest.raises(
            OSError, match="No space left on device"
        ):  # the kernel keeps the reason
            kernel_files.write_step(Box(1, 1, 1).wrapped, disk / "a.step")
    finally:
        subprocess.run(["umount", disk], check=True)


def test_what_is_no_copy_stays(tmp_path):
    cases = tmp_path / "out.cases"
    out = tmp_path / "out"
    for name, text in {
        "a/case": "1",
        "a/edited": "1",
        "notes.txt": "mine",
        "b/case": "1",
    }.items():
        (cases / name).parent.mkdir(parents=True, exist_ok=True)
        (cases / name).write_text(text)
    with staged_folder(out) as folder:
        copy_files(cases, folder, ["a/case", "a/edited", "b/case"])
    (tmp_path / "link").symlink_to(cases)
    assert not remove_copied(tmp_path / "link", out)
    assert (cases / "a" / "case").exists()
    (cases / "a" / "edited").write_text("1 and mine")
    assert not remove_copied(cases, out)
    assert {p.relative_to(cases).as_posix() for p in cases.rglob("*")} == {
        "a",
        "a/edited",
        "notes.txt",
    }
    for name in ("a/edited", "notes.txt"):
        (cases / name).unlink()
    assert remove_copied(cases, out)
    assert not cases.exists()


def test_only_json_of_ours_is_replaced_by_json(tmp_path):
    others = {
        "readings.csv": "x,y\n1,2\n",
        "robot.toml": "[tool]\npose = []\n",
        "package.json": '{"a": 1}',
    }
    for name, text in others.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(
            InputError,
            match=rf"{name}: expected a new file or JSON that stiffscope wrote",
        ):
            check_json(tmp_path / name)
        assert (tmp_path / name).read_text() == text
    (tmp_path / "a.json").touch()
    for answer in ({"a": 1}, [{"a": 1}, {"b": 2}], {"a": 2}):
        check_json(tmp_path / "a.json")
        write_json(tmp_path / "a.json", answer)
    overwrite(True)
    check_json(tmp_path / "readings.csv")
    overwrite(False)


def test_what_is_forced_keeps_the_other_files(tmp_path):
    out = tmp_path / "out"
    fill(out, page="1", old="1")
    (out / "deep").mkdir()
    (out / "deep" / "notes.txt").write_text("mine")
    (out / "page").write_text("mine")
    with pytest.raises(InputError, match="--force, which keeps that file"):
        check_output(out)
    overwrite(True)
    fill(out, page="2")
    overwrite(False)
    assert {
        name.name: name.read_text()
        for name in out.rglob("*")
        if name.name in ("page", "notes.txt")
    } == {
        "page": "2",
        "notes.txt": "mine",
    }
    assert not (out / "old").exists()
    assert os.listdir(tmp_path) == ["out"]


def test_a_new_folder_is_never_one_that_is_there(tmp_path):
    with staged_folder(tmp_path / "a" / "new", new=True) as folder:
        (folder / "plan").write_text("1")
    assert [
        p.relative_to(tmp_path).as_posix() for p in sorted(tmp_path.rglob("*"))
    ] == ["a", "a/new", "a/new/plan"]
    with (
        pytest.raises(
            InputError, match=r"late: expected a folder that is not there yet"
        ),
        staged_folder(tmp_path / "late", new=True) as folder,
    ):
        (folder / "plan").write_text("1")
        (tmp_path / "late").mkdir()
    assert not list((tmp_path / "late").iterdir())
    assert sorted(os.listdir(tmp_path)) == ["a", "late"]
