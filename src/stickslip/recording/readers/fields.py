"""Recognition of the fields of a text file: numbers, marks for missing numbers, dates, and words."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import NamedTuple

from .. import RecordingError
from .stamps import is_stamp

_WORDS = """
nan nan() nan(ind) nanq qnan snan na n/a n.a. n.d. null none nil missing nodata invalid inf infinity ∞ ol 0l
o.l o.l. ovl ovld ovrld ovf ovfl ovflw ovrng over overflow overload overrange overld overrng over-range under
underflow underrange
"""
_PHRASES = ("no data", "no value", "over range", "under range", "out of range", "not a number")
# Error texts of Excel in cells, in English and German.
SHEET_ERRORS = ("#N/A", "#NV", "#DIV/0!", "#VALUE!", "#WERT!", "#NUM!", "#ZAHL!", "#REF!", "#NAME?", "#NULL!")


def _missing() -> frozenset[str]:
    words = [*_WORDS.split(), *_PHRASES]
    cased = {form for word in words for form in (word, word.upper(), word.title(), word.capitalize())}
    signed = {sign + word for sign in ("", "+", "-") for word in {*cased, "NaN", "NaNQ", "QNaN", "SNaN"}}
    signs = {sign * count for sign in "-*#?." for count in range(1, 17)}
    return frozenset(signed | signs | {"", "…", "–", "—", "- -", "-.-", "-.--", "--.--", *SHEET_ERRORS})


# Texts that files contain in place of a missing, infinite or out-of-range number; the argument
# `missing_values` adds further ones.
MISSING = _missing()
# Smallest magnitude at which a number means a missing or out-of-range value: instruments write 9.9e37 (SCPI)
# or their largest number.
OVERLOAD = 9.89e37

# These patterns match each text in only one way, so that the time does not grow out of bounds for a field as
# long as a line.
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?")
# Pattern of the exponent's letter in Fortran's "1.0D-03".
FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")
# Pattern of texts of Microsoft's C library for missing numbers: "1.#QNAN", "-1.#IND00", "1.#INFe+000".
LIBRARY = re.compile(r"[+-]?1[.,]#[A-Za-z]+\d*([eE][+-]?\d+)?")


# Pattern of a number whose thousands are separated by a sign or a blank: "10,313.95", "1.234,5", "1'234".
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?P<sign>[.,'’_ \u00a0\u202f])\d{2,3}((?P=sign)\d{2,3})*([.,]\d+)?")


# Delimiter that means any white space.
SPACE = r"\s+"
# Pattern of the signs that start a comment line; an error text of Excel, such as "#N/A", is no comment.
COMMENT = re.compile(rf"\s*(#(?!{'|'.join(re.escape(one[1:]) for one in SHEET_ERRORS)})|%|//)+")


def without_sign(line: str) -> str:
    """Return the line without the comment signs (#, %, //) at its start, if any."""
    found = COMMENT.match(line)
    return line[found.end() :] if found else line


class Signs(NamedTuple):
    """Rules for fields of numbers: the `decimal` sign, and the texts that mark `missing` numbers."""

    decimal: str
    missing: frozenset[str] = MISSING

    def kind(self, field: str) -> str:
        """Return the kind of a field: "e" blank or a mark for a missing number, "n" a number, "d" a date or
        time, "s" words."""
        if field in self.missing or LIBRARY.fullmatch(field):
            return "e"
        if _NUMBER.fullmatch(
            field if self.decimal == "." else field.replace(".", "x").replace(self.decimal, ".")
        ):
            return "n"
        return "d" if is_stamp(field) else "s"

    def kinds(self, fields: Sequence[str]) -> str:
        """Return the kinds of the fields as a text with one letter ("e", "n", "d" or "s") for each, see
        `kind`."""
        return "".join(map(self.kind, fields))


def thousands(fields: Sequence[str], missing: frozenset[str]) -> str:
    """Return the first field with separators of thousands, of a column (texts) that contains only such
    numbers, plain numbers, and the texts `missing`; "" for any other column."""
    parted = ""
    for field in fields:
        if _THOUSANDS.fullmatch(field):
            parted = parted or field
        elif field not in missing and not _NUMBER.fullmatch(field.replace(",", ".")):
            return ""
    return parted


def split(line: str, delimiter: str) -> list[str]:
    """Return the fields of a line, without quotes and surrounding blanks; `delimiter` is a sign or `SPACE`
    (any white space).

    Raises:
        RecordingError: the quotes of the line cannot be read.
    """
    if delimiter == SPACE:
        return [field.strip('"') for field in line.split()]
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    rows = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    try:
        return [field.strip() for row in rows for field in row]
    except csv.Error as error:
        raise RecordingError(f"a line with quotes cannot be read: {error}") from None
