"""Types of the subset of Python that is translated to C, values with their C text, and error messages.

The subset: arithmetic, comparisons and conditionals of numbers, booleans and tuples; ``while``, and ``for``
over ranges, tuples, ``zip`` and ``enumerate``; functions of ``math`` and their namesakes in NumPy; fields of
records (named tuples), their properties, methods and ``_replace``; other such functions, also local ones. See
docs/decisions/export.md.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, get_type_hints

REAL, INT, BOOL = "real_t", "int64_t", "bool"
_ORDER = {BOOL: 0, INT: 1, REAL: 2}
# Precedence of the C operators that occur; a lower number binds more strongly.
ATOM, UNARY, PRODUCT, SUM, COMPARISON, AND, OR, CHOICE = range(8)
ARRAY_LIMIT = 4096  # largest number of entries in a constant array that is written into the C source

_KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile
while bool true false real_t int64_t
"""
KEYWORDS = frozenset(_KEYWORDS.split())


class TranslationError(ValueError):
    """Error: a function cannot be translated to C; the message names the function, its module and the
    line."""


class Record(NamedTuple):
    """Type of a record.

    Fields: `record_class`, the Python class; `fields`, pairs of name and type of the fields that the C struct
    contains: not those that are texts or None.
    """

    record_class: type
    fields: tuple[tuple[str, Any], ...]

    @property
    def c_name(self) -> str:
        """Return the name of the C struct, such as "ss_LuGre"."""
        return f"ss_{self.record_class.__name__}"


class Array(NamedTuple):
    """Type of a field, or of a constant table of a module, with `length` real numbers."""

    length: int


class Tuple(NamedTuple):
    """Type of a tuple, each part of which is a C variable of its own; `types` are the types of the parts."""

    types: tuple[Any, ...]


class Pair(NamedTuple):
    """Type of a tuple that a function returns: a C struct with the name `c_name`, names `members` and their
    `types`."""

    c_name: str
    members: tuple[str, ...]
    types: tuple[Any, ...]


class Value(NamedTuple):
    """A translated expression.

    Attributes:
        text: its C text.
        type: its type; None for a tuple.
        level: precedence of its outermost operator, such as `SUM`.
        constant: its value in Python, if known during translation; else None.
        pointer: True if the C text is a pointer to a record.
        parts: values of the parts of a tuple.
        below: bound below which an integer stays that is never negative, such as the counter of a loop; 0:
            unknown.
    """

    text: str
    type: Any
    level: int = ATOM
    constant: Any = None
    pointer: bool = False
    parts: tuple[Value, ...] = ()
    below: int = 0

    def within(self, level: int) -> str:
        """Return the C text, in parentheses if its operator binds less strongly than `level`."""
        return self.text if self.level <= level else f"({self.text})"


class FunctionSource(NamedTuple):
    """A Python function as the translator reads it.

    Fields: `function`, the Python function (for a local function, the function around it); `name`; `where`,
    name of its module; `first_line`, its first line in the file; `tree`, its syntax tree.
    """

    function: Callable[..., Any]
    name: str
    where: str
    first_line: int
    tree: ast.FunctionDef

    def error(self, node: ast.AST | None, what: str) -> TranslationError:
        """Return a TranslationError that names this function, its module, the line of `node` (None: the first
        line), and the problem `what`."""
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return TranslationError(f"{self.name} ({self.where}, line {line}) cannot be translated to C: {what}")

    def local(self, tree: ast.FunctionDef | ast.Lambda, name: str) -> FunctionSource:
        """Return the source of a function or lambda with this `tree`, which is defined inside this function.
        Its C name is this function's name, an underscore, and `name`."""
        made = with_arguments(tree, []) if isinstance(tree, ast.Lambda) else tree
        return self._replace(name=f"{self.name}_{name}", tree=made)


def with_arguments(tree: ast.FunctionDef | ast.Lambda, names: list[str]) -> ast.FunctionDef:
    """Return the syntax tree of a function with the further arguments `names`, and without defaults of
    arguments. For a lambda, return a function with the same arguments that returns its value; `names` are not
    used."""
    made = ast.parse("def unnamed(): ...").body[0]
    assert isinstance(made, ast.FunctionDef)
    made.args, made.lineno = tree.args, tree.lineno
    if isinstance(tree, ast.Lambda):
        made.body = [ast.copy_location(ast.Return(tree.body), tree)]
    else:
        arguments = [*tree.args.args, *(ast.arg(name) for name in names)]
        made.args, made.body = ast.arguments([], arguments, None, [], [], None, []), tree.body
    return made


def source_of(function: Callable[..., Any]) -> FunctionSource:
    """Return the source of a Python function, of a function compiled by Numba, or of a lambda.

    Raises:
        TranslationError: its source cannot be read (typed at a prompt, built in), it is not a plain function,
            it is one of several lambdas in a statement, or its name is not ASCII.
    """
    plain = getattr(function, "py_func", function)
    name = getattr(plain, "__name__", repr(plain))
    where = getattr(plain, "__module__", None) or "unknown module"
    try:
        lines, first = inspect.getsourcelines(plain)
        tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
    except (OSError, TypeError, SyntaxError, IndexError):
        raise TranslationError(
            f"{name} ({where}) cannot be translated to C: its source cannot be read"
        ) from None
    made = FunctionSource(plain, name, where, first, tree)  # type: ignore[arg-type]
    lambdas = [one for one in ast.walk(tree) if isinstance(one, ast.Lambda)] if name == "<lambda>" else []
    # Among several lambdas in one statement, the source does not show which one the function is.
    if len(lambdas) == 1:
        return made.local(lambdas[0], "lambda")._replace(name="unnamed")
    if not isinstance(tree, ast.FunctionDef):
        raise made.error(
            None, "it must be a function that is defined with def, or the only lambda of its statement"
        )
    if not name.isascii():
        raise made.error(None, "C takes names in ASCII only")
    return made


def record_type(record: Any) -> Record:
    """Return the translator's type of a record, from its values: a tuple becomes an `Array` of its length;
    texts and None are left out."""
    found = []
    annotations = _annotations(type(record))
    for name, value in record._asdict().items():
        if isinstance(value, bool):
            found.append((name, BOOL))
        elif isinstance(value, int) and annotations.get(name) is int:
            found.append((name, INT))
        elif isinstance(value, int | float):
            found.append((name, REAL))
        elif hasattr(value, "_fields"):
            found.append((name, record_type(value)))
        elif isinstance(value, tuple) and value and all(isinstance(v, int | float) for v in value):
            found.append((name, Array(len(value))))
    return Record(type(record), tuple(found))


@lru_cache(256)
def _annotations(record_class: type) -> dict[str, Any]:
    try:
        return get_type_hints(record_class)
    except Exception:  # an annotation contains a name that is imported only for type checkers
        return {}


def joined(one: Any, other: Any) -> Any:
    """Return the narrowest type for values of both types (boolean, integer, real number, tuples of these);
    None without such a type. If `one` is None, return `other`."""
    if one is None or one == other:
        return other
    if one in _ORDER and other in _ORDER:
        return max(one, other, key=_ORDER.__getitem__)
    if isinstance(one, Tuple) and isinstance(other, Tuple) and len(one.types) == len(other.types):
        both = tuple(joined(a, b) for a, b in zip(one.types, other.types, strict=True))
        return None if None in both else Tuple(both)
    return None


def kind_of(value: Value) -> Any:
    """Return the type of a value; for a tuple, a `Tuple` of the types of its parts."""
    return Tuple(tuple(kind_of(part) for part in value.parts)) if value.type is None else value.type


def real(value: float) -> str:
    """Return a number as a C literal of the engine's real type, such as "R(1.5)"."""
    number = float(value)
    if number != number:
        return "R(NAN)"
    if number in (float("inf"), float("-inf")):
        return "R(INFINITY)" if number > 0 else "R(-INFINITY)"
    return f"R({number!r})"
