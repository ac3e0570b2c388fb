"""The report of a diagnosis: complete, self-contained, and harmless whatever a campaign is called."""

import html
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from stiffscope.experiments.manifest import manifest_of
from stiffscope.gap.inference.diagnosis import Alternative, Effect, Where
from stiffscope.gap.show.figures import draw_figures, signature_correlation
from stiffscope.gap.show.page import write_diagnosis_report
from stiffscope.report.figures import save_figure
from stiffscope.report.run_report import Draft
from tests.report.test_terminal import diagnosed

pytestmark = pytest.mark.slow

HOSTILE = "<script>alert(1)</script>\"'>&amp;<img onload=f()>"
MATHEMATICS = r"$\frac{1$ A_1^"


class Page(HTMLParser):
    """Tags, attributes and text of a page; whatever is opened must be closed."""

    def __init__(self, text):
        super().__init__()
        self.tags = []
        self.attributes = []
        self.words = []
        self.open = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in {"meta", "img", "link"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def write(folder, diagnosis, **more):
    figures = draw_figures(diagnosis, folder)
    manifest_of(None).write(folder)
    write_diagnosis_report(
        Draft(folder), diagnosis, **{"title": "T", "facts": ["F"]} | more
    )
    return Page((folder / "report.html").read_text(encoding="utf-8")), figures


def test_the_page_is_complete_and_self_contained(tmp_path):
    page, figures = write(
        tmp_path,
        diagnosed(signature_correlation=(("a @ b", "c @ d"), ((1.0, 0.9), (0.9, 1.0)))),
    )
    assert figures == ["waterfall", "residuals", "signatures"]
    sources = [value for name, value in page.attributes if name in {"src", "href"}]
    pictures = [
        source for source in sources if source.startswith("data:image/svg+xml;base64,")
    ]
    assert len(pictures) == page.tags.count("img") == 3
    beside = [
        source for source in sources if not source.startswith(("data:", "#section-"))
    ]
    assert {"waterfall.svg", "residuals.png"} <= set(beside)
    assert all((tmp_path / name).is_file() for name in beside)
    text = " ".join(page.words)
    for words in (
        "Identified",
        "4.30 ± 0.10 nm/N",
        "χ² per reading",
        "ln-evidence 16.1 below",
        "distinguishes a from b",
    ):
        assert words in text


@pytest.mark.extended_for("63")
@pytest.mark.parametrize("count", [8, 63])
def test_names_of_many_signatures_are_within_their_figure(count, tmp_path):
    """A square map shrinks within its space, and takes its names along."""
    names = tuple(f"joint-compliance @ strut{k}.head" for k in range(count))
    figure = signature_correlation(
        diagnosed(signature_correlation=(names, tuple(map(tuple, np.eye(count)))))
    )
    save_figure(figure, tmp_path / "signatures.png")
    drawn = FigureCanvasAgg(figure).get_renderer()
    labels = [*figure.axes[0].get_yticklabels(), *figure.axes[0].get_xticklabels()]
    assert min(label.get_window_extent(drawn).x0 for label in labels) > 0.0
    assert min(label.get_window_extent(drawn).y0 for label in labels) > 0.0


@pytest.mark.parametrize("text", [HOSTILE, MATHEMATICS])
def test_a_campaign_cannot_inject_anything(text, tmp_path):
    plain = diagnosed(
        signature_correlation=(("a @ b", "c @ d"), ((1.0, 0.9), (0.9, 1.0)))
    )
    effect = Effect(
        text,
        text,
        0.9,
        1.0,
        dict.fromkeys([text], plain.effects[0].parameters["factor"]),
        (text,),
    )
    hostile = replace(
        plain,
        verdict="ambiguous",
        effects=(effect, effect),
        alternatives=(Alternative(text, text, 0.1, 1.0, text),),
        where=Where(
            direction={text: 1.0},
            component={text: 1.0},
            pose_names=(text, text),
            rows=(text, text),
            pose=plain.where.pose,
            unexplained=plain.where.unexplained,
        ),
        next_measurement=replace(
            plain.next_measurement, separates=(text, text), pose=text
        ),
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
