"""Content of a report as plain data: no HTML, no plotting.

Each number has a unit: its column names one, or it is a `Number`. All values are in SI; prefixes are chosen
when the document is written.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import Any

from ..quantities.units import ANGLE

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]*")


class DocumentError(ValueError):
    """Error: a part of a document is not allowed, or does not fit the others; the message names the part."""


@dataclass(frozen=True)
class Number:
    """A value with its unit (SI, "" for a plain number) and, if known, its uncertainty, in the same unit.

    `low` and `high` are the ends of the confidence interval with the probability `level`. `note` is the
    reason for a missing value (NaN), or another remark. `systematic` is the interval (low, high) for
    systematic errors alone, `both` the interval for systematic and statistical errors.

    Raises:
        DocumentError: the value is no real number, the unit is no text, or an interval has one end only.
    """

    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    standard_error: float | None = None
    level: float = 0.95
    note: str = ""
    systematic: tuple[float, float] | None = None
    both: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.unit, str):
            raise DocumentError(f"the number {self.value!r} has the unit {self.unit!r}, which is no text")
        if isinstance(self.value, bool) or not isinstance(self.value, Real):
            raise DocumentError(f"{self.value!r} [{self.unit}] is no number")
        if (self.low is None) != (self.high is None):
            raise DocumentError(f"the number {self.value!r} {self.unit} has one end of an interval only")


# Content of a table's cell: text; a number in the unit of its column; a `Number` with its own unit; None for
# an empty cell.
Cell = str | float | Number | None


@dataclass(frozen=True)
class Column:
    """A column of a table.

    `unit` is the SI unit of its numbers, "" for plain numbers, None for text and for `Number` cells of
    several units. `digits` is the number of significant digits shown.
    """

    name: str
    unit: str | None = None
    digits: int = 4


@dataclass(frozen=True)
class Table:
    """A table: `rows` have a cell for each column; `notes` are sentences below it, "" for none.

    Raises:
        DocumentError: a row has another length, or a cell is a number without a unit, in another unit than
            its column, or neither number nor text.
    """

    caption: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    notes: str = ""

    def __post_init__(self) -> None:
        _freeze(self, f"table {self.caption!r}", ["columns", "rows"])
        object.__setattr__(self, "rows", tuple(map(tuple, self.rows)))
        for i, row in enumerate(self.rows):
            where = f"table {self.caption!r}, row {i + 1}"
            if len(row) != len(self.columns):
                raise DocumentError(f"{where} has {len(row)} cells for {len(self.columns)} columns")
            for column, cell in zip(self.columns, row, strict=True):
                _check_cell(cell, column, f"{where}, column {column.name!r}")


def _check_cell(cell: Any, column: Column, where: str) -> None:
    if isinstance(cell, Number):
        if column.unit is not None and cell.unit != column.unit:
            raise DocumentError(f"{where} is in {column.unit!r}, but the number in it is in {cell.unit!r}")
    elif isinstance(cell, Real) and not isinstance(cell, bool):
        if column.unit is None:
            raise DocumentError(f"{where}: the number {cell!r} has no unit")
    elif cell is not None and not isinstance(cell, str):
        raise DocumentError(f"{where}: {cell!r} is neither a number nor text")


@dataclass(frozen=True)
class Picture:
    """A figure: `svg` is an SVG element as text, `alt` describes the figure for people who cannot see it.

    `name` is also the name of its file: lower-case letters, digits, - and _. `figures.style.svg` makes the
    SVG.

    Raises:
        DocumentError: the name is not allowed, `alt` is empty, or `svg` is no SVG element.
    """

    name: str
    caption: str
    svg: str
    alt: str

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise DocumentError(
                f"the picture's name {self.name!r} must be lower case letters, digits, - and _"
            )
        if not self.alt.strip():
            raise DocumentError(f"the picture {self.name!r} needs a text that says what it shows")
        if not self.svg.lstrip().startswith("<svg"):
            raise DocumentError(f"the picture {self.name!r} is no SVG element")


@dataclass(frozen=True)
class Listing:
    """Text to be shown unchanged below its caption, such as an input file or a log."""

    caption: str
    text: str


@dataclass(frozen=True)
class Section:
    """A section of a document.

    Its parts are shown in the order of the fields: paragraphs, points (a list of sentences), tables, figures,
    listings, and sections within the section. Raises DocumentError if a text is given instead of a sequence.
    """

    title: str
    paragraphs: Sequence[str] = ()
    points: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[Picture] = ()
    listings: Sequence[Listing] = ()
    sections: Sequence[Section] = ()

    def __post_init__(self) -> None:
        _freeze(self, f"section {self.title!r}", list(self.__dataclass_fields__)[1:])


@dataclass(frozen=True)
class Document:
    """A whole report.

    Args:
        title, summary: the title, and what was done with the result, in a few sentences.
        sections: the body.
        highlights: the main results, pairs of name in words and `Number`.
        numbers: all results for results.json by name. Each is a `Number`, a mapping with "value" and "unit"
            (and others such as "low", "high"), a text, a bool, or a mapping of these.
        assumptions: assumptions, a sentence each.
        citations: BibTeX entries of the sources, one text; "" for none.
        failures: requirements that are not met, a sentence each.
        files: texts to write beside the report, by file name.
        interrupted: True if the work was stopped (Ctrl-C); the report shows the finished part.

    Raises:
        DocumentError: two pictures have the same name, or a text is given instead of a sequence.
    """

    title: str
    summary: str
    sections: Sequence[Section]
    highlights: Sequence[tuple[str, Number]] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)
    assumptions: Sequence[str] = ()
    citations: str = ""
    failures: Sequence[str] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    interrupted: bool = False

    def __post_init__(self) -> None:
        _freeze(self, "the document", ["sections", "highlights", "assumptions", "failures"])
        names = [picture.name for picture in self.pictures()]
        for name in names:
            if names.count(name) > 1:
                raise DocumentError(f"two pictures have the name {name!r}")

    def __str__(self) -> str:
        from .text import document_text

        return document_text(self)

    def _repr_html_(self) -> str:
        """Return the report as HTML in a frame of its own (iframe), which notebooks show.

        So the style of the report does not affect other cells of the notebook.
        """
        from .circumstances import circumstances
        from .html import report_html

        page = html.escape(report_html(self, circumstances(), beside=False))
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 40rem; border: 0"></iframe>'

    def pictures(self) -> tuple[Picture, ...]:
        """Return all pictures of all sections and inner sections, in the order of the document."""
        return tuple(p for section in _flat(self.sections) for p in section.figures)

    def tables(self) -> tuple[Table, ...]:
        """Return all tables of all sections and inner sections, in the order of the document."""
        return tuple(t for section in _flat(self.sections) for t in section.tables)


def joined(*documents: Document) -> Document:
    """Return one document with the contents of all: summaries, sections, numbers, assumptions, and so on.

    At least one document must be given; the title is the first one's. If two documents have a number or a
    file of the same name, the later one is taken. Raises DocumentError if they have pictures of the same
    name.
    """
    first = documents[0]
    together: dict[str, Any] = {"summary": " ".join(filter(None, (one.summary for one in documents)))}
    for name in ("sections", "highlights", "assumptions", "failures"):
        together[name] = tuple(part for one in documents for part in getattr(one, name))
    for name in ("numbers", "files"):
        together[name] = {key: part for one in documents for key, part in getattr(one, name).items()}
    citations = "\n\n".join(dict.fromkeys(one.citations for one in documents if one.citations))
    interrupted = any(one.interrupted for one in documents)
    return replace(first, citations=citations, interrupted=interrupted, **together)


def begun_by(document: Document, text: str) -> Document:
    """Return the document with the paragraph `text` at the start of its first section.

    The document is returned unchanged if the text is empty; otherwise it must have a section.
    """
    if not text:
        return document
    head, *others = document.sections
    return replace(document, sections=[replace(head, paragraphs=(text, *head.paragraphs)), *others])


def in_turns(part: Any) -> Any:
    """Return a document, or a part of one, with the units and names of a rotary actuator.

    Units have rad for m (rad/s for m/s) and N m for N. Names of columns have "torque" for "force", "angle"
    for "position", and so on. The numbers' values, other texts and figures stay.
    """
    if isinstance(part, Column):
        unit = part.unit if part.unit is None else ANGLE.unit(part.unit)
        return replace(part, unit=unit, name=ANGLE.name(part.name))
    if isinstance(part, Number):
        return replace(part, unit=ANGLE.unit(part.unit))
    if isinstance(part, Document | Section | Table):
        return replace(part, **{f.name: in_turns(getattr(part, f.name)) for f in fields(part)})
    if isinstance(part, Mapping):
        of = {name: in_turns(value) for name, value in part.items()}
        return of | {"unit": ANGLE.unit(of["unit"])} if isinstance(of.get("unit"), str) else of
    if isinstance(part, tuple | list):
        return [in_turns(one) for one in part]
    return part


def _flat(sections: Sequence[Section]) -> list[Section]:
    return [s for section in sections for s in (section, *_flat(section.sections))]


def _freeze(part: Any, where: str, names: Sequence[str]) -> None:
    """Convert the fields `names` of a part of a document to tuples, so that the part cannot change.

    Raises DocumentError for a field that is one text, which would be taken for a sequence of letters. `where`
    names the part in the message.
    """
    for name in names:
        value = getattr(part, name)
        if isinstance(value, str):
            raise DocumentError(f"{where}: {name} must be a sequence, not one text")
        object.__setattr__(part, name, tuple(value))
