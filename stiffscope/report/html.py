"""The page of a diagnosis: one file of HTML with its figures inside."""

from __future__ import annotations

import base64
import re
from html import escape
from typing import TYPE_CHECKING

from stiffscope.report import text as wording

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import numpy as np

    from stiffscope.gap.diagnosis import Diagnosis, Effect

NOTABLE = 3.0  # σ by which an entry must have moved to be marked

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;color:#20252b;max-width:1020px;margin:2.5rem auto;padding:0 1.2rem}
h1{font-size:1.5rem;margin-bottom:.2rem}h2{font-size:1.1rem;margin-top:2.2rem}
.verdict{font-size:1.15rem;border-left:6px solid #2f7d6b;padding:.5rem 1rem;background:#f3f6f5}
.verdict.ambiguous{border-color:#e4b04a}.verdict.unexplained{border-color:#c0392b}.verdict.no-gap{border-color:#8d99a6}
table{border-collapse:collapse;font-size:.92rem;margin:.6rem 0}
th,td{padding:.25rem .8rem .25rem 0;text-align:right;border-bottom:1px solid #e3e7eb;vertical-align:top}
th:first-child,td:first-child,td.text,th.text{text-align:left}
tr.moved td{font-weight:600;background:#fdf6e6}
svg,img{max-width:100%;height:auto}.facts{color:#5a6570}li{margin:.15rem 0}
"""


def write_page(
    target: Path,
    diagnosis: Diagnosis,
    *,
    title: str,
    facts: Sequence[str],
    folder: Path,
    figures: Sequence[str],
    slider: np.ndarray | None = None,
) -> None:
    """Write a self-contained page; `figures` are stems of SVG files, "robot" of a PNG, in `folder`."""
    svg = {stem: _svg(folder / f"{stem}.svg", stem) for stem in figures if (folder / f"{stem}.svg").exists()}
    robot = folder / "robot.png"
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="facts">{escape("; ".join(facts))}</p>',
        f'<p class="verdict {diagnosis.verdict}">{escape(wording.sentence(diagnosis))}</p>',
        svg.get("waterfall", ""),
        *_effects(diagnosis, slider),
        _gap(diagnosis),
        *_alternatives(diagnosis),
        "<h2>Where</h2>",
        _list(wording.located(diagnosis.where)),
        _image(robot) if robot.exists() else "",
        svg.get("residuals", ""),
        *(
            ["<h2>What to measure next</h2>", f"<p>{escape(wording.what_next(diagnosis.next_measurement))}</p>"]
            if diagnosis.next_measurement
            else []
        ),
        *(["<h2>Remarks</h2>", _list(diagnosis.remarks)] if diagnosis.remarks else []),
        *(["<h2>What these readings can tell apart</h2>", svg["likeness"]] if "likeness" in svg else []),
    ]
    head = f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
    text = (
        f"{head}<style>{_STYLE}</style></head><body>\n"
        + "\n".join(part for part in body if part)
        + "\n</body></html>\n"
    )
    target.write_text(text, encoding="utf-8")


def _effects(diagnosis: Diagnosis, slider: np.ndarray | None) -> list[str]:
    if not diagnosis.effects:
        return []
    out = ["<h2>Effects</h2>"]
    for effect in diagnosis.effects:
        name = wording.name(effect.effect, effect.place)
        alone = f"probability {effect.probability:.4f}; alone it leaves {wording.percent(effect.gap_after)} rms"
        out.append(f"<p><b>{escape(name)}</b>: {escape(alone)}</p>")
        if effect.parameters:
            out.append(_parameters(effect, slider))
        if effect.confused_with:
            others = ", ".join(wording.name(*o.split(" @ ", 1)) for o in effect.confused_with)
            out.append(f"<p>These readings cannot tell it from {escape(others)}.</p>")
    return out


def _parameters(effect: Effect, slider: np.ndarray | None) -> str:
    """Each parameter beside what the model has; what has moved is marked."""
    rows: list[tuple[str, ...]] = []
    moved: list[bool] = []
    for key, p in effect.parameters.items():
        nominal = wording.nominal_value(effect.effect, key, slider)
        away = (p.value - (nominal or 0.0)) / p.sigma if p.sigma > 0 else float("nan")
        ratio = f"{p.value / nominal:.4g}" if nominal else ""
        doubt = "" if p.plausible else "not plausible"
        rows.append((key, wording.quantity(p), wording.beside(p, nominal), ratio, f"{away:+.1f}", doubt))
        moved.append(abs(away) > NOTABLE and nominal is not None)
    return _table(("parameter", "value ± 1 σ", "in the model", "ratio", "σ away", ""), rows, marked=moved)


def _gap(diagnosis: Diagnosis) -> str:
    gap = diagnosis.gap
    row = [wording.percent(v) for v in (gap.nominal, gap.explained, gap.held_out, gap.noise)]
    chi2 = [f"{v:.4g}" for v in gap.chi2_per_reading]
    columns = ("gap, rms", "before", "after", "held out", "noise", "χ² per reading before", "after")
    return _table(columns, [("", *row, *chi2)])


def _alternatives(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.alternatives:
        return []
    rows = [
        (wording.name(a.effect, a.place), wording.chance(a.probability), wording.percent(a.gap_after), a.why_not)
        for a in diagnosis.alternatives
    ]
    return [
        "<h2>What else was weighed</h2>",
        _table(("effect", "probability", "gap after", "why not"), rows, texts=(3,)),
    ]


def _table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    marked: Sequence[bool] = (),
    texts: Sequence[int] = (),
) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        kinds = (' class="text"' if k in texts else "" for k in range(len(cells)))
        return "".join(f"<{tag}{kind}>{escape(cell)}</{tag}>" for cell, kind in zip(cells, kinds, strict=True))

    out = [f"<tr>{line(columns, 'th')}</tr>"]
    for k, row in enumerate(rows):
        kind = ' class="moved"' if k < len(marked) and marked[k] else ""
        out.append(f"<tr{kind}>{line(row, 'td')}</tr>")
    return f"<table>{''.join(out)}</table>"


def _list(lines: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def _svg(path: Path, stem: str) -> str:
    """The drawing without its XML head, its inner names made its own."""
    text = path.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r'\bid="([^"]+)"', rf'id="{stem}-\1"', text)
    return re.sub(r'(url\(#|href="#)', rf"\1{stem}-", text)


def _image(path: Path) -> str:
    content = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="robot, its components coloured by their share of the gap" src="data:image/png;base64,{content}">'
