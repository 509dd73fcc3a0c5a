"""Conversion of a document to plain text for a terminal or a notebook without HTML."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markupsafe import Markup

from .document import Document, Number, Section, Table
from .html import number_text, table_body, table_heads


def document_text(document: Document) -> str:
    """Return a document as plain text: title, summary, failures, highlights, sections and assumptions.

    Tables have aligned columns; pictures are replaced by their captions.
    """
    lines = [document.title, "=" * len(document.title), document.summary, ""]
    lines += [f"NOT AS REQUIRED: {failure}" for failure in document.failures]
    lines += [f"{what}: {shown_number(number)}" for what, number in document.highlights]
    for section in document.sections:
        lines += _section(section)
    if document.assumptions:
        lines += ["", "Assumptions", "-----------", *(f"- {one}" for one in document.assumptions)]
    return "\n".join(lines)


def shown_number(number: Number) -> str:
    """Return a number as plain text with unit, interval and confidence level; for NaN, its note or a dash.

    If known, the interval that includes systematic errors is added.
    """
    text = _plain(number_text(number))
    if number.low is None or number.high is None:
        return text
    both = (
        ""
        if number.both is None
        else "; with systematic errors {} to {}".format(
            *(_plain(number_text(Number(end, number.unit))) for end in number.both)
        )
    )
    return f"{text} ({100 * number.level:g} %{both})"


def _plain(text: Markup) -> str:
    return text.striptags().replace("\u00a0", " ")


def _section(section: Section) -> Iterator[str]:
    yield from ("", section.title, "-" * len(section.title), *section.paragraphs)
    yield from (f"- {point}" for point in section.points)
    for table in section.tables:
        yield from _table(table)
    yield from (f"[picture {picture.name}] {picture.caption}" for picture in section.figures)
    for listing in section.listings:
        yield from ("", listing.caption, listing.text)
    for inner in section.sections:
        yield from _section(inner)


def _table(table: Table) -> Iterator[str]:
    units = [
        column.unit and one["unit"] for column, one in zip(table.columns, table_heads(table), strict=True)
    ]
    heads = [f"{c.name} [{unit}]" if unit else c.name for c, unit in zip(table.columns, units, strict=True)]
    rows = [[(_plain(text), numeric) for text, numeric in row] for row in table_body(table)]
    widths = [max(map(len, [head, *(row[i][0] for row in rows)])) for i, head in enumerate(heads)]
    yield from ("", table.caption, _line([(head, False) for head in heads], widths))
    yield from (_line(row, widths) for row in rows)
    if table.notes:
        yield table.notes


def _line(cells: Sequence[tuple[str, bool]], widths: Sequence[int]) -> str:
    shown = [
        text.rjust(width) if numeric else text.ljust(width)
        for (text, numeric), width in zip(cells, widths, strict=True)
    ]
    return "  ".join(shown).rstrip()
