"""The documentation and the code refer to each other: every name and every section that is cited exists."""

import importlib
import re
import subprocess
import sys
import tomllib
from functools import reduce
from pathlib import Path

import pytest

from tests.report.browser import CHROMIUM, browser

ROOT = Path(__file__).parents[1]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "CONTRIBUTING.md",
    ROOT / "README.md",
]
ROOMS = ("cad", "fea", "vjm", "stiffscope", "tests", "examples")
SECTION = re.compile(r"^#{2,3} (\d+(?:\.\d+)?) ", re.MULTILINE)
CITED = re.compile(r"docs/theory\.md,?\s+section\s+(\d+(?:\.\d+)?)")


def resolved(name: str) -> object:
    """Import the longest prefix of a dotted name that is a module, and take the rest as attributes."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError as missing:
            if missing.name is None or not f"{name}.".startswith(f"{missing.name}."):
                raise
            continue
        return reduce(getattr, parts[count:], module)
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_name_resolves(page: Path) -> None:
    wrong = []
    for name in sorted(
        set(re.findall(r"\bstiffscope(?:\.\w+)+", page.read_text(encoding="utf-8")))
    ):
        try:
            resolved(name)
        except (ModuleNotFoundError, AttributeError):
            wrong.append(name)
    assert not wrong


def test_an_unknown_name_does_not_resolve() -> None:
    with pytest.raises(AttributeError):
        resolved("stiffscope.errors.NoSuchError")
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        resolved("stiffscope.nowhere.function")


def test_every_cited_section_exists() -> None:
    there = set(SECTION.findall((ROOT / "docs/theory.md").read_text(encoding="utf-8")))
    sources = [path for room in ROOMS for path in (ROOT / room).rglob("*.py")]
    cited = {
        number: path
        for path in [*sources, *PAGES]
        for number in CITED.findall(path.read_text(encoding="utf-8"))
    }
    assert cited
    assert {number: path for number, path in cited.items() if number not in there} == {}


def test_no_numbered_equation_has_lines() -> None:
    """Sphinx splits such ones, and MathJax refuses a number within a split; matrices have \\cr."""
    shown = re.findall(
        r"\$\$.*?\$\$", (ROOT / "docs/theory.md").read_text(encoding="utf-8"), re.DOTALL
    )
    assert [each for each in shown if r"\tag" in each and r"\\" in each] == []


@pytest.mark.slow
def test_the_pages_need_nothing_but_their_extra() -> None:
    """No extension imports what only tests have, at any depth."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]
    extra = project["optional-dependencies"]
    only = {re.split("[<>=]", each)[0] for each in extra["dev"]} - {
        re.split("[<>=]", each)[0] for each in extra["docs"]
    }
    names = sorted(
        name.replace("-", "_")
        for name in only
        if "[" not in name and name not in {"ipython", "setuptools"}
    )
    extensions = sorted(path.stem for path in (ROOT / "docs/extensions").glob("*.py"))
    code = f"import sys; sys.modules.update(dict.fromkeys({names})); sys.path.insert(0, 'docs/extensions')"
    command = [sys.executable, "-c", f"{code}; import {', '.join(extensions)}"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.extended_for("theory")
@pytest.mark.slow
@pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing: apt-get install chromium"
)
@pytest.mark.parametrize("page", ["theory", "glossary"])
def test_every_equation_is_set_by_the_pages_own_mathjax(
    page: str, tmp_path: Path
) -> None:
    source = tmp_path / "docs"
    pages = tmp_path / "pages"
    source.mkdir()
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    (source / "index.md").write_text(text, encoding="utf-8")
    settings = (
        'extensions = ["myst_parser", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]',
        'myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]',
        'suppress_warnings = ["myst"]',
    )
    (source / "conf.py").write_text("\n".join(settings), encoding="utf-8")
    subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", source, pages], check=True, timeout=120
    )
    with browser() as tab:
        tab.open(pages / "index.html")
        tab.run("MathJax.startup.promise.then(() => true)")
        assert tab.run("document.querySelectorAll('mjx-container').length") > 0
        assert tab.run("document.querySelectorAll('mjx-merror').length") == 0
        assert not [
            address for address in tab.requests() if not address.startswith("file:")
        ]


def test_equations_are_numbered_once_and_in_order() -> None:
    numbers = [
        tuple(map(int, pair))
        for pair in re.findall(
            r"\\tag\{(\d+)\.(\d+)\}", (ROOT / "docs/theory.md").read_text()
        )
    ]
    assert numbers == sorted(set(numbers))
    last: dict[int, int] = {}
    for section, number in numbers:
        assert number == last.get(section, 0) + 1
        last[section] = number


def test_changelog_has_the_version() -> None:
    from stiffscope import __version__

    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"version: {__version__}\n" in (ROOT / "CITATION.cff").read_text(
        encoding="utf-8"
    )


QUESTIONS = {
    "What does the first command give me?": "start.md",
    "How do I describe a spherical joint?": "guides/robot.md#how-a-robot-is-described",
    "Which keys does a joint have?": "reference/robot-file.md",
    "How do I start from my CAD assembly?": "guides/assembly.md",
    "My arm is a URDF: how do I begin?": "guides/robot.md",
    "How do I choose the clamped faces of my STEP part?": "guides/part.md",
    "In which axes is a part's matrix?": "guides/part.md#axes",
    "Where does an error bar come from?": "guides/part.md#how-far-to-trust-the-numbers",
    "What is K_tx, and what is kx?": "glossary.md#kx-and-k_tx",
    "What do I put for a bearing?": "guides/bearings.md",
    "How do I model backlash?": "guides/flexure.md#a-drive-that-is-not-linear",
    "Can a platform bend?": "guides/platform.md",
    "What should I change to make it stiffer?": "guides/design.md",
    "How do I optimize a dimension?": "guides/study.md#methods",
    "What are its natural frequencies?": "guides/frequencies.md",
    "Why does my part come out wrong by 0.2 mm?": "guides/path.md",
    "How do I write down my measurements?": "reference/campaign.md",
    "What does the verdict 'ambiguous' mean?": "guides/measurements.md#what-the-answer-says",
    "Is it right? Compared with what?": "validation.md",
    "How do I get the matrices into Ansys or Nastran?": "superelements.md",
}


def _links(page: Path) -> set[str]:
    """Pages and sections that a page links to, from the documentation's root."""
    text = re.sub(
        r"```\{toctree\}.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    found = set()
    for target in re.findall(r"\]\(([\w./-]+\.(?:md|ipynb)(?:#[\w-]+)?)\)", text):
        path, _, section = target.partition("#")
        place = (page.parent / path).resolve().relative_to(ROOT)
        found.add(
            f"{place.relative_to('docs') if place.parts[0] == 'docs' else place}{'#' * bool(section)}{section}"
        )
    return found


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_question_is_answered_two_links_from_the_front_page(question: str) -> None:
    page, _, section = QUESTIONS[question].partition("#")
    first = _links(ROOT / "docs/index.md")
    pages = {each.partition("#")[0] for each in first if ".md" in each}
    second = set().union(
        *(
            _links(ROOT / "docs" / each)
            for each in pages
            if (ROOT / "docs" / each).suffix == ".md"
        )
    )
    assert page in {each.partition("#")[0] for each in first | second}
    headings = re.findall(
        r"^#+ (.+)$", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.MULTILINE
    )
    anchors = {
        re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings
    }
    assert not section or section in anchors


def test_names_of_other_libraries_link_to_their_pages(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs/extensions")
    links = importlib.import_module("cross_links")
    assert (
        links.find_page("ArrayLike")
        == "https://numpy.org/doc/stable/reference/typing.html#numpy.typing.ArrayLike"
    )
    assert (
        links.find_page("xr.Dataset")
        == "https://docs.xarray.dev/en/stable/generated/xarray.Dataset.html"
    )
    assert links.find_page("numpy.nowhere") is None
    assert links.find_page("Mechanism") is None
