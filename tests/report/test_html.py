"""Pages and notebook tables: complete, self-contained, and harmless whatever a campaign is called."""

import html
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from stiffscope.gap.diagnosis import Alternative, Effect, Where
from stiffscope.report.gap_figures import draw_figures
from stiffscope.report.html import experiment_html, stiffness_html, write_page
from tests.report.test_terminal import diagnosed, state

HOSTILE = "<script>alert(1)</script>\"'>&amp;<img onload=f()>"
MATHEMATICS = r"$\frac{1$ A_1^"


class Page(HTMLParser):
    """Tags, attributes and text of a page; whatever is opened must be closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.words, self.open = [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in {"meta", "img"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def write(folder, diagnosis, **more):
    figures = draw_figures(diagnosis, folder)
    write_page(folder / "page.html", diagnosis, **{"title": "T", "facts": ["F"]} | more, folder=folder, figures=figures)
    return Page((folder / "page.html").read_text(encoding="utf-8")), figures


def test_the_page_is_complete_and_self_contained(tmp_path):
    page, figures = write(tmp_path, diagnosed(signature_correlation=(("a @ b", "c @ d"), ((1.0, 0.9), (0.9, 1.0)))))
    assert figures == ["waterfall", "residuals", "signatures"]
    sources = [value for name, value in page.attributes if name in {"src", "href"}]
    assert len(sources) == page.tags.count("img") == 3
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)
    text = " ".join(page.words)
    for words in (
        "Identified",
        "4.30 ± 0.10 nm/N",
        "χ² per reading",
        "ln-evidence 16.1 below",
        "distinguishes a from b",
    ):
        assert words in text


@pytest.mark.parametrize("text", [HOSTILE, MATHEMATICS])
def test_a_campaign_cannot_inject_anything(text, tmp_path):
    plain = diagnosed(signature_correlation=(("a @ b", "c @ d"), ((1.0, 0.9), (0.9, 1.0))))
    effect = Effect(text, text, 0.9, 1.0, dict.fromkeys([text], plain.effects[0].parameters["factor"]), (text,))
    hostile = replace(
        plain,
        verdict="ambiguous",
        effects=(effect, effect),
        alternatives=(Alternative(text, text, 0.1, 1.0, text),),
        where=Where({text: 1.0}, {text: 1.0}, (text, text), plain.where.pose, plain.where.unexplained),
        next_measurement=replace(plain.next_measurement, separates=(text, text), pose=text),
        remarks=(text,),
        steps=((text, 1.0), ("noise", 0.5)),
        signature_correlation=((text, f"{text} @ x"), plain.signature_correlation[1]),
    )
    for name in ("plain", "hostile"):
        (tmp_path / name).mkdir()
    page, _ = write(tmp_path / "hostile", hostile, title=text, facts=[text])
    harmless, _ = write(tmp_path / "plain", plain)
    assert set(page.tags) <= set(harmless.tags)
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert sum(text in words for words in page.words) > 8
    for stem in ("waterfall", "residuals", "signatures"):
        figure = (tmp_path / "hostile" / f"{stem}.svg").read_text()
        assert "<script" not in figure
        assert html.escape(text, quote=False) in figure


def experiment():
    matrix = np.diag([5.8e-11, 1.9e-10, 4.3e-9, 1.3e-7, 1.7e-6, 7e-9])
    matrix[0, 1] = matrix[1, 0] = 1e-15
    return SimpleNamespace(
        part=HOSTILE, interface="rigid", compliance=matrix, error=1e-3 * np.abs(matrix) + 1e-14,
        reference_point=np.array([0.085, 0.0, -0.0]), relative_bound=0.001, note="",
    )  # fmt: skip


def test_an_experiment_shows_every_entry_with_its_bound():
    page = Page(experiment_html(experiment()))
    assert page.tags.count("td") == 36
    assert page.words.count("·") == 30
    assert "5.800e-11 ± 7e-14" in page.words
    assert "script" not in page.tags
    assert "(85, 0, 0) mm" in " ".join(page.words)
    assert len(re.findall("zero within its error bound", " ".join(page.words))) == 1


def test_a_stiffness_shows_its_first_poses():
    many = state(np.zeros((30, 2)), np.tile(1e6 * np.eye(6), (30, 1, 1)), np.full((30, 6), 3e-6), ("x", "rz"))
    page = Page(stiffness_html(many))
    assert page.tags.count("tr") == 21
    assert "and 10 more poses" in page.words
    assert "Stiffness at M" in " ".join(page.words)
    assert {"x, rz (m, rad)", "|sag| (µm)", "5.2"} <= set(page.words)


def test_a_notebook_shows_the_tables():
    from IPython.core.interactiveshell import InteractiveShell

    from stiffscope.fea.experiment import Experiment
    from stiffscope.report.notebook import register

    shell = InteractiveShell.instance()
    try:
        register()
        zeros = np.zeros((6, 6))
        shown = Experiment(
            "plate", "rigid", np.eye(6), zeros, np.zeros((1, 3)), *[None] * 4, 0.0, 1.0, 1.0, 6, *[None] * 9
        )
        stiff = state(np.zeros((1, 3)), np.eye(6)[None], np.zeros((1, 6)))
        for value, words in ((shown, "plate, rigid"), (stiff, "Stiffness at M (diagonal")):
            formats, _ = shell.display_formatter.format(value)
            assert words in formats["text/html"]
            assert "<table>" in formats["text/html"]
    finally:
        InteractiveShell.clear_instance()
