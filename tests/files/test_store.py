"""`stiffscope cache`, `--json` of every command, and terminals that are narrow, plain or know no UTF-8."""

import json
import os
import re
import subprocess
import sys

import click
import pytest

from stiffscope.cli.main import _guarded, cli
from stiffscope.registry import commands as registered_commands
from stiffscope.runtime.cache import Cache, digest

pytestmark = pytest.mark.slow


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A cache with three results, and things that are none of ours."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(folder))
    for kind, name in (("experiment", "a"), ("experiment", "b"), ("pictures", "c")):
        Cache(folder).put(
            kind,
            digest({"is": name}),
            lambda aside: (aside / "data").write_bytes(bytes(1_000_000)),
        )
    (folder / "mine.txt").write_text("notes")
    stranger = folder / "pictures" / "holiday"
    stranger.mkdir()
    (stranger / "entry.json").write_text(
        '{"kind": "pictures", "key": "another", "files": {}}'
    )
    (folder / "pictures" / "link").symlink_to(stranger, target_is_directory=True)
    return folder


def answer(capsys, *words):
    assert _guarded([*words, "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_cache_is_no_output_folder(root, capsys):
    assert _guarded(["check", "delta", "--out", str(root)]) == 2
    assert "is the folder of the cache; give another" in capsys.readouterr().err


def test_it_says_where_and_how_large(root, capsys):
    assert _guarded(["cache"]) == 0
    said = capsys.readouterr().out
    assert str(root) in said
    assert "3 MB" in said
    found = answer(capsys, "cache")
    assert found["folder"] == str(root)
    assert {kind: each["entries"] for kind, each in found["kinds"].items()} == {
        "experiment": 2,
        "pictures": 1,
    }
    assert all(
        each["bytes"] >= 1e6 * each["entries"] for each in found["kinds"].values()
    )
    listed = answer(capsys, "cache", "list")
    assert [each["made"] for each in listed] == sorted(each["made"] for each in listed)
    assert {each["key"] for each in listed} == {digest({"is": name}) for name in "abc"}


def test_it_removes_what_is_ours_and_nothing_else(root, capsys):
    for command in ("list", "clear"):
        assert _guarded(["cache", command, "--kind", "picture"]) == 2
        assert re.search(
            "--kind.*picture.* is not one of .*experiment.*pictures",
            capsys.readouterr().err,
        )
    assert answer(capsys, "cache", "clear", "--kind", "pictures")["entries"] == 1
    assert Cache(root).get("pictures", digest({"is": "c"})) is None
    assert Cache(root).get("experiment", digest({"is": "a"})) is not None
    assert answer(capsys, "cache", "clear")["bytes"] > 2_000_000
    assert answer(capsys, "cache", "list") == []
    assert (root / "mine.txt").read_text() == "notes"
    assert (root / "pictures" / "holiday" / "entry.json").exists()
    assert (root / "pictures" / "link").is_symlink()


def test_an_absent_cache_is_empty(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("STIFFSCOPE_CACHE", str(tmp_path / "nowhere"))
    assert answer(capsys, "cache")["kinds"] == {}
    assert answer(capsys, "cache", "clear")["entries"] == 0
    assert _guarded(["cache", "list"]) == 0
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("words", [["cache"], ["check", "delta", "--out", "out"]])
def test_a_cache_that_is_nowhere_is_refused(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STIFFSCOPE_CACHE", "~nobody-here/cache")
    assert _guarded(words) == 2
    assert (
        'STIFFSCOPE_CACHE: expected a folder for the cache, got "~nobody-here/cache" without HOME'
        in capsys.readouterr().err
    )


def commands(group=cli, words=()):
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*words, name))
        if not isinstance(command, click.Group) or command.invoke_without_command:
            yield (*words, name), command


def test_the_help_of_all_commands_is_that_of_each():
    said = {name: command.help for name, command in registered_commands().items()}
    assert {
        name: cli.get_command(None, name).help.partition("\n\n")[0] for name in said
    } == said


def test_every_command_has_json():
    listed = list(commands())
    assert len(listed) > 20
    without = [
        words
        for words, command in listed
        if not any("--json" in each.opts for each in command.params)
    ]
    assert without == [("live",)]  # whose answers go to its page


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        (
            ["run", "biglide", "--components", "published", "--out", "OUT"],
            {"parts", "stiffness", "convention"},
        ),
        (
            [
                "frf",
                "biglide",
                "--components",
                "published",
                "--at",
                "Q1",
                "--from",
                "tool:M:z",
                "--to",
                "tool:M:z",
                "--points",
                "9",
                "--out",
                "OUT",
            ],
            {"coords", "data_vars"},
        ),
        (["new", "delta", "OUT"], {"file"}),
        (
            ["campaign", "new", "biglide", "--out", "OUT"],
            {"folder", "readings", "poses"},
        ),
        (
            [
                "deflection",
                "biglide",
                "--components",
                "published",
                "--wrench",
                "1,0,0,0,0,0",
            ],
            {"twist", "convention"},
        ),
    ],
)
def test_json_alone_is_on_standard_output(words, keys, tmp_path, capsys):
    words = [str(tmp_path / "out") if word == "OUT" else word for word in words]
    assert keys <= set(answer(capsys, *words))


NARROW = [
    ["stiffness", "biglide", "--components", "published", "--gravity", "exact"],
    ["deflection", "delta", "--components", "beam", "--wrench", "100,0,0,0,0,0"],
    ["modes", "stewart", "--components", "beam"],
    ["sensitivity", "biglide", "--components", "published"],
    ["check", "orthoglide"],
    ["campaign", "check", "published"],
    ["robots"],
    ["cache"],
]


@pytest.mark.extended
def test_eighty_columns_of_ascii(tmp_path):
    """In a terminal of 80 columns that knows ASCII alone: nothing wider, no colour, no letter beyond."""
    surroundings = {
        **os.environ,
        "COLUMNS": "80",
        "PYTHONIOENCODING": "ascii",
        "NO_COLOR": "1",
        "LC_ALL": "C",
    }
    surroundings["STIFFSCOPE_CACHE"] = str(tmp_path)
    code = "from stiffscope.cli.main import _guarded\n"
    code += f"for words in {NARROW}: print('##'); assert _guarded(words) == 0"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, env=surroundings, check=True
    )
    answers = done.stdout.decode("ascii").split("##\n")[1:]
    for words, said in zip(NARROW, answers, strict=True):
        assert len(said) > 80, words
        assert "?" not in said, words
        assert "nan" not in said.split(), words
        assert "\033" not in said, words
        rules = [line for line in said.splitlines() if line and set(line) <= {"-", " "}]
        assert max(map(len, rules), default=0) <= 80, words


def test_words_are_completed():
    surroundings = {
        **os.environ,
        "_STIFFSCOPE_COMPLETE": "bash_complete",
        "COMP_WORDS": "stiffscope ca",
    }
    command = [sys.executable, "-c", "from stiffscope.cli.main import main; main()"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env={**surroundings, "COMP_CWORD": "1"},
        check=True,
    )
    assert done.stdout.split() == ["plain,cache", "plain,campaign"]
