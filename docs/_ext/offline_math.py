"""Formulas as SVG, drawn by matplotlib: pages that need no network. What it cannot draw stays LaTeX."""

from __future__ import annotations

import html
import io
import re
from typing import Any

from docutils import nodes
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser

_PARSER = MathTextParser("path")
# LaTeX commands that matplotlib has under another name, or does not need.
_OTHERWISE = (
    (r"\\begin\{aligned\}|\\end\{aligned\}|\\!", ""),
    (r"\\[Bb]igg?[lr]?(?![a-z])", ""),
    (r"\\[td]?frac(\d)(\w)", r"\\frac{\1}{\2}"),
    (r"\\[td]frac", r"\\frac"),
    (r"\\text(?![a-z])", r"\\mathrm"),
    (r"\\(le|ge|ne)(?![a-z])", r"\\\1q"),
)
_WORDS = re.compile(r"\\text\{[^{}]*\}")
_CASES = re.compile(r"(.*?)\\begin\{cases\}(.*)\\end\{cases\}(.*)", re.DOTALL)


def _drawn(latex: str, size: float) -> str:
    """An SVG element, its text in the colour of the page; raises ValueError for what cannot be drawn."""
    depth = _PARSER.parse(f"${latex}$", dpi=72).depth
    figure = Figure(figsize=(0.01, 0.01))
    figure.text(0, 0, f"${latex}$", fontsize=size)
    target = io.BytesIO()
    figure.savefig(target, format="svg", bbox_inches="tight", pad_inches=0.02, transparent=True)
    svg = target.getvalue().decode()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    style = f"vertical-align: {-depth * size / 10:.1f}px; fill: currentColor"
    return svg.replace(
        "<svg", f'<svg role="img" aria-label="{html.escape(latex, quote=True)}" style="{style}"', 1
    )


def _lines(latex: str) -> list[str]:
    # Roman type has no spaces of its own.
    latex = _WORDS.sub(lambda words: words[0].replace(" ", "\\ "), latex)
    for old, new in _OTHERWISE:
        latex = re.sub(old, new, latex)
    cases = _CASES.fullmatch(latex)
    if cases:  # one line for each, and one for the formulas before it
        before, rows, after = cases.groups()
        first, gap, before = before.rpartition(r"\qquad")
        wide = (row.replace("&", r"\qquad") for row in re.split(r"\\\\", rows))
        latex = r"\\".join([first] * bool(gap) + [f"{before} {row} {after}" for row in wide])
    lines = (line.replace("&", "").strip() for line in re.split(r"\\\\", latex))
    return [" ".join(line.split()) for line in lines if line]


def _shown(latex: str, size: float) -> str:
    try:
        return "<br>".join(_drawn(line, size) for line in _lines(latex))
    except (ValueError, RuntimeError):
        return f"<code>{html.escape(latex)}</code>"


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_shown(node.astext(), 11.0))
    raise nodes.SkipNode


def _display(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math" style="margin: 1em 0">{_shown(node.astext(), 12.0)}</div>')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Register this extension with Sphinx."""
    app.add_html_math_renderer("svg", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
