"""Conversion of a document to report.html: one self-contained file, for light and dark screens and paper."""

from __future__ import annotations

import html
import math
import re
from dataclasses import asdict
from numbers import Integral
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from ..quantities.units import near_one
from .circumstances import Circumstances
from .document import Cell, Column, Document, Number, Picture, Table
from .figures.scale import Scale, scale_for

_EMPTY = "–"


def report_html(document: Document, made: Circumstances, *, beside: bool = True) -> str:
    """Return the text of report.html.

    Args:
        document: content of the report.
        made: date, machine and versions.
        beside: True: the page refers to results.json in the same folder; False for a notebook, which has no
            such file.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_joined,
    )
    environment.filters |= {
        "number": number_text,
        "drawing": drawing,
        "body": table_body,
        "heads": table_heads,
    }
    return environment.get_template("template.html.j2").render(
        document=document, made=asdict(made), beside=beside
    )


def _joined(value: Any) -> Any:
    """Return a text with a no-break space between a number and "%", so that no line starts with the sign.

    Values that are no texts are returned unchanged.
    """
    return type(value)(re.sub(r"(?<=\d) %", "\u00a0%", value)) if isinstance(value, str) else value


def significant(value: float, digits: int = 4) -> str:
    """Return a number with `digits` significant digits, and all digits before the point: "0.9979", "12345".

    Numbers below 1e-4 and from 1e7 on are written with a power of ten, integers with all digits, NaN as a
    dash, infinity as ∞.
    """
    if not math.isfinite(value):
        return _EMPTY if math.isnan(value) else f"{'−' if value < 0 else ''}∞"
    if isinstance(value, Integral):
        return str(int(value)).replace("-", "−")
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)
    if value == 0.0 or -4 <= power < 7:
        return f"{value:.{max(digits - 1 - power, 0)}f}".replace("-", "−")
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa} × 10{raised}".replace("-", "−")


def _digits(value: float, own: Scale, digits: int) -> str:
    """Return a number as text like `significant`; a number from 0.9 to 1, such as r², is not rounded to 1.

    The exception is for plain numbers alone, if the scale `own` has no unit.
    """
    return near_one(value, digits) if not own.unit and 0.9 < value < 1.0 else significant(value, digits)


def number_text(number: Number, scale: Scale | None = None, digits: int = 4) -> Markup:
    """Return a number with its interval and unit as HTML; for a missing value (NaN), its note or a dash.

    Outside a table, a value without an interval is written without zeros at its end.

    Args:
        number: the number, SI.
        scale: scale of its table column, whose head shows the unit; None: chosen here, with the unit.
        digits: significant digits of the value; an interval may require more.
    """
    own = scale or scale_for(number.unit, number.value)
    value = _shown(number.value, own)
    if math.isnan(value) and number.note:
        return Markup(f'<span class="missing">{html.escape(number.note)}</span>')
    unit = f"&nbsp;{html.escape(own.unit)}" if scale is None and own.unit else ""
    if number.low is None or number.high is None:
        text = _digits(value, own, digits)
        if scale is None and "." in text and "×" not in text:
            # A value without an interval, such as a mass of 0.1 kg, is given, so zeros would claim a
            # precision.
            text = text.rstrip("0").rstrip(".")
        return Markup(text + unit)
    three = (value, _shown(number.low, own), _shown(number.high, own))
    near = not own.unit and 0.9 < value < 1.0
    middle, low, high = (near_one(x, digits) for x in three) if near else _to_same_decimals(*three, digits)
    return Markup(f'{middle}{unit} <span class="interval">[{low}, {high}]</span>')


def _to_same_decimals(value: float, low: float, high: float, digits: int) -> tuple[str, ...]:
    """Return a value and the ends of its interval as texts with the same number of decimals.

    The decimals are enough for two digits of the interval's width and for `digits` of the value. If the
    interval is wider than the value's magnitude, or narrower than 1e-9 of it, or the value is very large or
    small, the value has `digits` significant digits and the ends have two each.
    """
    width = high - low
    if not (1e-4 < abs(value) < 1e7 and 1e-9 * abs(value) < width < abs(value)):
        return significant(value, digits), significant(low, 2), significant(high, 2)
    decimals = max(1 - math.floor(math.log10(width)), digits - 1 - math.floor(math.log10(abs(value))), 0)
    return tuple(f"{x:.{decimals}f}".replace("-", "−") for x in (value, low, high))


def _shown(value: float, scale: Scale) -> float:
    """Return a value multiplied by the scale's factor; a factor of 1 leaves integers as integers."""
    return value if scale.factor == 1.0 else value * scale.factor


def _scales(table: Table) -> list[Scale | None]:
    """Return the scale of each column of a table; None for columns whose unit is None."""
    return [
        None if column.unit is None else scale_for(column.unit, [_value(row[i]) for row in table.rows])
        for i, column in enumerate(table.columns)
    ]


def _value(cell: Cell) -> float:
    if isinstance(cell, Number):
        return cell.value
    return math.nan if cell is None or isinstance(cell, str) else float(cell)


def table_heads(table: Table) -> list[dict[str, Any]]:
    """Return the head of each column of a table, as mappings for the template.

    The keys are "name", "unit" (the shown unit, "" for text, a dash for plain numbers) and "numeric" (True
    for a column of numbers).
    """
    return [
        {"name": column.name, "unit": _unit(column, scale), "numeric": _numeric(table, i)}
        for i, (column, scale) in enumerate(zip(table.columns, _scales(table), strict=True))
    ]


def _unit(column: Column, scale: Scale | None) -> str:
    if scale is None:
        return ""
    return scale.unit or _EMPTY


def _numeric(table: Table, i: int) -> bool:
    cells = [row[i] for row in table.rows if row[i] is not None]
    return table.columns[i].unit is not None and not any(isinstance(cell, str) for cell in cells)


def table_body(table: Table) -> list[list[tuple[Markup, bool]]]:
    """Return the cells of a table row by row: HTML text, and True if the column contains numbers."""
    scales = _scales(table)
    return [
        [
            (_cell(cell, scale, column.digits), _numeric(table, i))
            for i, (cell, scale, column) in enumerate(zip(row, scales, table.columns, strict=True))
        ]
        for row in table.rows
    ]


def _cell(cell: Cell, scale: Scale | None, digits: int) -> Markup:
    if cell is None:
        return Markup(_EMPTY)
    if isinstance(cell, str):
        return Markup(html.escape(cell))
    if isinstance(cell, Number):
        return number_text(cell, scale, digits)
    own = scale or Scale(1.0, "")
    return Markup(html.escape(_digits(_shown(cell, own), own, digits)))


def drawing(picture: Picture) -> Markup:
    """Return the SVG of a picture for the page, with its text alternative (`alt`) for screen readers.

    The picture's name is put before each identifier in the SVG, so that identifiers are unique on the page.
    """
    svg = re.sub(r'(\sid="|href="#|url\(#)', rf"\g<1>{picture.name}-", picture.svg.lstrip())
    label = html.escape(picture.alt, quote=True)
    return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1))
