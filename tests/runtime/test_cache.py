"""The cache trusts nothing that it cannot prove and never stops a run."""

import json
import multiprocessing
import os
from pathlib import Path

import pytest

from stiffscope.errors import InputError
from stiffscope.runtime.cache import Cache, cache_folder, code_version, digest

KEY = digest({"part": "slider"})


def write(content: str):
    def fill(folder: Path) -> None:
        (folder / "deep").mkdir()
        (folder / "deep" / "result.json").write_text(content)

    return fill


@pytest.fixture
def cache(tmp_path) -> Cache:
    return Cache(tmp_path / "cache")


def result(cache: Cache) -> str | None:
    folder = cache.get("experiment", KEY)
    return None if folder is None else (folder / "deep" / "result.json").read_text()


def test_keeps_what_was_put(cache):
    assert result(cache) is None
    cache.put("experiment", KEY, write("42"))
    assert result(cache) == "42"


@pytest.mark.parametrize(
    "harm",
    ["tear", "delete", "add", "link", "format", "garbage", "file", "empty", "binary"],
)
def test_damaged_entry_is_absent_and_replaced(cache, harm):
    folder = cache.put("experiment", KEY, write("42"))
    index = folder / "entry.json"
    content = folder / "deep" / "result.json"
    if harm == "tear":
        content.write_text("4")
    elif harm == "delete":
        content.unlink()
    elif harm == "add":
        (folder / "foreign.npz").write_bytes(b"")
    elif harm == "link":
        (folder / "foreign").symlink_to("/etc")
    elif harm == "format":
        index.write_text(json.dumps({**json.loads(index.read_text()), "format": 0}))
    elif harm == "garbage":
        index.write_text('{"format": 1, "files": ')
    elif harm == "binary":
        index.write_bytes(b"\xff\xfe\x00")
    elif harm == "empty":
        index.write_text("[]")
    else:
        folder.rename(folder.with_name("away"))
        folder.write_text("not a folder")
    assert result(cache) is None
    cache.put("experiment", KEY, write("43"))
    assert result(cache) == "43"


def test_an_entry_that_its_reader_refuses_is_absent_and_replaced(cache):
    def read(folder):
        return float((folder / "deep" / "result.json").read_text())

    cache.put("experiment", KEY, write("forty"))
    assert cache.load(["condensed", "experiment"], KEY, read) is None
    cache.put("experiment", KEY, write("43"))
    assert cache.load(["condensed", "experiment"], KEY, read) == 43.0


WHOLE = {
    ".step": b"ISO-10303-21;\nEND-ISO-10303-21;\n",
    ".vtu": b"<VTKFile>\n</VTKFile>\n",
    ".png": b"\x89PNG....IEND\xaeB`\x82",
    ".stl": bytes(80) + (2).to_bytes(4, "little") + bytes(100),
}


@pytest.mark.parametrize("suffix", WHOLE)
def test_a_file_that_is_cut_off_is_absent_though_its_checksum_fits(cache, suffix):
    for content, held in (
        (WHOLE[suffix], True),
        (WHOLE[suffix][:-20], False),
        (b"", False),
    ):
        cache.clear()
        cache.put(
            "experiment",
            KEY,
            lambda folder, content=content: (folder / f"a{suffix}").write_bytes(
                content
            ),
        )
        assert (cache.get("experiment", KEY) is not None) == held


def test_failed_writer_leaves_nothing(tmp_path):
    cache = Cache(tmp_path / "cache", tmp_path)

    def fail(folder: Path) -> None:
        (folder / "half.json").write_text("{")
        raise RuntimeError("killed")

    with pytest.raises(RuntimeError):
        cache.put("experiment", KEY, fail)
    assert result(cache) is None
    assert list(tmp_path.rglob("half.json")) == []


def _put_many(root: str, content: str) -> None:
    for _ in range(20):
        Cache(Path(root)).put("experiment", KEY, write(content))
        assert result(Cache(Path(root))) in {"1", "2"}


def test_two_processes_write_the_same_entry_at_once(cache):
    context = multiprocessing.get_context("spawn")
    both = [
        context.Process(target=_put_many, args=(str(cache.root), text)) for text in "12"
    ]
    for process in both:
        process.start()
    for process in both:
        process.join()
    assert [process.exitcode for process in both] == [0, 0]
    assert result(cache) in {"1", "2"}


@pytest.mark.parametrize(("umask", "mode"), [(0o002, 0o775), (0o077, 0o700)])
def test_the_umask_says_who_may_read_an_entry(cache, umask, mode):
    before = os.umask(umask)
    try:
        cache.put("experiment", KEY, write("42"))
    finally:
        os.umask(before)
    entry = cache.get("experiment", KEY)
    modes = {path.stat().st_mode & 0o777 for path in (entry, entry / "deep")}
    assert modes == {mode}


def test_entries_of_another_user_are_told_once_and_kept(cache, monkeypatch, caplog):
    cache.put("experiment", KEY, write("42"))

    def refuse(path: Path) -> bytes:
        raise InputError(f"{path}: no permission") from PermissionError()

    with monkeypatch.context() as denied:
        denied.setattr("stiffscope.runtime.cache.read_bytes", refuse)
        assert result(cache) is None
        assert result(cache) is None
    assert len([line for line in caplog.messages if "may not read" in line]) == 1
    assert result(cache) == "42"


def test_unwritable_cache_is_done_without(tmp_path):
    (tmp_path / "file").write_text("")
    cache = Cache(tmp_path / "file" / "cache", tmp_path)
    held = cache.put("experiment", KEY, write("42"))
    assert held.is_relative_to(tmp_path)
    assert (held / "deep" / "result.json").read_text() == "42"
    assert cache.get("experiment", KEY) is None


def test_digest_tells_neighbouring_numbers_apart():
    assert digest({"thickness": 0.02}) != digest({"thickness": 0.02 + 2**-53})
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    with pytest.raises(ValueError, match="JSON"):
        digest({"thickness": float("nan")})


def test_code_version_covers_source_and_libraries():
    cad = ("stiffscope.cad",)
    fea = ("stiffscope.fea",)
    assert (
        len(
            {
                code_version(cad, ()),
                code_version(fea, ()),
                code_version(cad, ("numpy",)),
            }
        )
        == 3
    )


def test_environment_chooses_the_folder(tmp_path, monkeypatch):
    monkeypatch.setitem(os.environ, "STIFFSCOPE_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
