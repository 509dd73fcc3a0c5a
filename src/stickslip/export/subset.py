"""The subset of Python that is translated to C: types, values with their C text, refusals.

The subset: arithmetic, comparisons, conditionals, functions of ``math``, fields of records (named tuples),
their properties and ``_replace``, tuples as results, loops over ``range`` with a bound known beforehand,
calls of other such functions. See docs/decisions/export.md.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from typing import Any, NamedTuple

REAL, INT, BOOL = "real_t", "int", "bool"
# Precedence of C operators, as far as they are used; a lower number binds stronger.
ATOM, UNARY, PRODUCT, SUM, COMPARISON, AND, OR, CHOICE = range(8)

_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile
while bool true false real_t
"""
KEYWORDS = frozenset(_KEYWORDS.split())


class TranslationError(ValueError):
    """A function that cannot be translated to C; names the function, its file and the line."""


class Record(NamedTuple):
    """The type of a record; `fields` are the types of those that C sees (no text, nothing optional)."""

    record_class: type
    fields: tuple[tuple[str, Any], ...]

    @property
    def c_name(self) -> str:
        return f"ss_{self.record_class.__name__}"


class Array(NamedTuple):
    """A field that holds several numbers."""

    length: int


class Pair(NamedTuple):
    """The type of a tuple that a function returns, with the C name of its struct and of its members."""

    c_name: str
    members: tuple[str, ...]
    types: tuple[Any, ...]


class Value(NamedTuple):
    """An expression: its C text, type and precedence; its constant, if known now; whether it is a pointer;
    the parts of a tuple."""

    text: str
    type: Any
    level: int = ATOM
    constant: Any = None
    pointer: bool = False
    parts: tuple[Value, ...] = ()

    def within(self, level: int) -> str:
        """The text as an operand that must bind at least as strongly as `level`."""
        return self.text if self.level <= level else f"({self.text})"


class FunctionSource(NamedTuple):
    """A Python function as the translator reads it."""

    function: Callable[..., Any]
    name: str
    where: str
    first_line: int
    tree: ast.FunctionDef

    def error(self, node: ast.AST | None, what: str) -> TranslationError:
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return TranslationError(f"{self.name} ({self.where}, line {line}) cannot be exported to C: {what}")


def source_of(function: Callable[..., Any]) -> FunctionSource:
    """The source of a plain or compiled function.

    Raises:
        TranslationError: there is none to read (typed in at a prompt, built in).
    """
    plain = getattr(function, "py_func", function)
    name = getattr(plain, "__name__", repr(plain))
    where = getattr(plain, "__module__", None) or "unknown module"
    try:
        lines, first = inspect.getsourcelines(plain)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):
        raise TranslationError(
            f"{name} ({where}) cannot be exported to C: its source cannot be read"
        ) from None
    made = FunctionSource(plain, name, where, first, tree)  # type: ignore[arg-type]
    if not isinstance(tree, ast.FunctionDef):
        raise made.error(None, "it must be a function that begins with def")
    if not name.isascii():
        raise made.error(None, "C takes names in ASCII only")
    return made


def record_type(record: Any) -> Record:
    """The type of a record, from one instance: tuples have its lengths, text and None are left out."""
    found = []
    for name, value in record._asdict().items():
        if isinstance(value, bool):
            found.append((name, BOOL))
        elif isinstance(value, int | float):
            found.append((name, REAL))
        elif hasattr(value, "_fields"):
            found.append((name, record_type(value)))
        elif isinstance(value, tuple) and value and all(isinstance(v, int | float) for v in value):
            found.append((name, Array(len(value))))
    return Record(type(record), tuple(found))


def real(value: float) -> str:
    """A number as C writes it."""
    number = float(value)
    if number != number or number in (float("inf"), float("-inf")):
        return "R(INFINITY)" if number > 0 else "R(-INFINITY)"
    return f"R({number!r})"
