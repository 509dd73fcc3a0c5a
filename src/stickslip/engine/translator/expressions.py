"""Translate expressions of the subset from Python's syntax tree to C.

In each function, `context` is the function around the expression, and `node` is the expression in Python's
syntax tree, which error messages (TranslationError) quote. A `Value` is a translated expression: its C text
and type."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from .subset import (
    ARRAY_LIMIT,
    ATOM,
    BOOL,
    COMPARISON,
    INT,
    KEYWORDS,
    PRODUCT,
    REAL,
    SUM,
    UNARY,
    Array,
    FunctionSource,
    Record,
    Tuple,
    Value,
    real,
    record_type,
)

NUMBERS = (REAL, INT, BOOL)
# Largest length of a constant tuple whose numbers are written where they are used; a longer one becomes a C
# array.
FEW = 4
_OPERATORS = {ast.Add: ("+", SUM), ast.Sub: ("-", SUM), ast.Mult: ("*", PRODUCT), ast.Div: ("/", PRODUCT)}
_DIVISIONS = {ast.FloorDiv: "floordiv", ast.Mod: "mod"}
_BITS = {ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^", ast.LShift: "<<", ast.RShift: ">>"}


class LocalFunction(NamedTuple):
    """A Python function or lambda that is defined inside the translated one, with its `source`."""

    source: FunctionSource


class Context(Protocol):
    """Function around an expression, as the translation of the expression uses it; `statements.FunctionBody`
    implements and describes the methods.

    Attributes:
        source: the function.
        variables: by name, the type of a variable, a local function, or the value of a table.
        pointers: names of parameters that are pointers in C (records).
        locals: names of all variables and functions that the function defines.
    """

    source: FunctionSource
    variables: dict[str, Any]
    pointers: set[str]
    locals: set[str]

    def call(self, node: ast.AST, function: Any, arguments: list[Value]) -> Value: ...
    def temporary(self, c_type: Any, text: str) -> str: ...
    def hoisted(self, c_type: Any) -> str: ...
    def captured(self, node: ast.expr) -> tuple[Value, list[str]]: ...
    def line(self, text: str) -> None: ...
    def lines(self, texts: list[str]) -> None: ...
    def use(self, record: Record) -> None: ...
    def table(self, name: str, numbers: tuple[float, ...]) -> str: ...
    def set(self, node: ast.AST, name: str, value: Value) -> None: ...


def as_real(context: Context, node: ast.AST, value: Value) -> Value:
    """Return the value converted to a real number; raise TranslationError if it is no number."""
    if value.type == REAL:
        return value
    if value.type in (INT, BOOL):
        if value.constant is not None:
            return Value(real(value.constant), REAL, constant=value.constant)
        return Value(f"(real_t){value.within(UNARY)}", REAL, UNARY)
    raise context.source.error(node, f"{ast.unparse(node)} is no number")


def as_bool(context: Context, node: ast.AST, value: Value) -> Value:
    """Return the value converted to a condition, as Python does: a number is true if it is not 0, a table if
    it is not empty. Raise TranslationError for other values."""
    if value.type == BOOL:
        return value
    if value.type in (INT, REAL):
        if value.constant is not None:
            return constant(context, node, bool(value.constant))
        return Value(f"{value.within(SUM)} != {'0' if value.type == INT else real(0.0)}", BOOL, COMPARISON)
    if isinstance(value.type, Array):
        return constant(context, node, value.type.length > 0)
    raise context.source.error(node, f"{ast.unparse(node)} is no condition; compare it with something")


def as_type(context: Context, node: ast.AST, value: Value, kind: Any) -> Value:
    """Return the value converted to the type `kind`, which must be its own or a wider one: a number, a
    boolean, or a tuple of these."""
    if isinstance(kind, Tuple):
        parts = (as_type(context, node, v, k) for v, k in zip(value.parts, kind.types, strict=True))
        return Value("", None, parts=tuple(parts))
    return as_real(context, node, value) if kind == REAL else value._replace(type=kind)


def expression(context: Context, node: ast.expr) -> Value:
    """Return the value of an expression: its C text and type. Statements that it needs are written to the
    context.

    Raises:
        TranslationError: it is outside the subset.
    """
    translate = NODES.get(type(node))
    if translate is None:
        raise context.source.error(
            node, f"{ast.unparse(node)!r} ({type(node).__name__}) is outside the subset"
        )
    return translate(context, node)


def constant(context: Context, node: ast.AST, value: Any) -> Value:
    """Return a Python object that is known during translation (number, boolean, tuple of numbers, record) as
    a translated value. Raise TranslationError for another object."""
    if isinstance(value, bool | np.bool_):
        return Value("true" if value else "false", BOOL, constant=bool(value))
    if isinstance(value, int | np.integer) and abs(value) < 2**31:
        return Value(str(value), INT, ATOM if value >= 0 else UNARY, constant=int(value))
    if isinstance(value, int | float | np.floating | np.integer):
        return Value(real(float(value)), REAL, constant=float(value))
    if hasattr(value, "_fields") and not isinstance(value, type):  # a record
        kind = record_type(value)
        context.use(kind)
        parts = ((constant(context, node, getattr(value, name)), of) for name, of in kind.fields)
        fields = (as_real(context, node, part).text if of == REAL else part.text for part, of in parts)
        return Value(context.temporary(kind, f"{{{', '.join(fields)}}}"), kind)
    if isinstance(value, tuple | list | np.ndarray):
        return _table(context, node, value)
    raise context.source.error(node, f"{ast.unparse(node)} is neither a number nor true or false")


def _table(context: Context, node: ast.AST, value: Any) -> Value:
    """Return a constant sequence as a value: a tuple of its parts, or, if it has more than `FEW` real
    numbers, a constant C array. Raise TranslationError if it has more than `ARRAY_LIMIT` numbers."""
    found = np.asarray(value, dtype=object)
    if found.size > ARRAY_LIMIT:
        raise context.source.error(node, f"{ast.unparse(node)} has more than {ARRAY_LIMIT} numbers")
    if found.ndim == 1 and found.size > FEW and all(type(one) is not int for one in found.tolist()):
        numbers = tuple(float(one) for one in found)
        return Value(context.table(ast.unparse(node), numbers), Array(len(numbers)))
    return Value("", None, parts=tuple(constant(context, node, one) for one in value))


def outside(context: Context, node: ast.expr) -> Any:
    """Return the Python object to which a global or enclosing name, or a dotted name such as `math.pi`,
    refers. Raise TranslationError if it is not known before the function runs."""
    function = context.source.function
    if isinstance(node, ast.Attribute):
        owner = outside(context, node.value)
        if not hasattr(owner, node.attr):
            raise context.source.error(node, f"{ast.unparse(node)} does not exist")
        return getattr(owner, node.attr)
    if not isinstance(node, ast.Name) or node.id in context.variables or node.id in context.locals:
        raise context.source.error(node, f"{ast.unparse(node)} is not known before the function runs")
    builtins = function.__globals__["__builtins__"]
    names = builtins if isinstance(builtins, dict) else vars(builtins)
    cells = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    if node.id in cells:
        return cells[node.id].cell_contents
    if node.id not in function.__globals__ and node.id not in names:
        raise context.source.error(node, f"{node.id} is not defined")
    return function.__globals__[node.id] if node.id in function.__globals__ else names[node.id]


def identifier(context: Context, node: ast.AST, name: str) -> str:
    """Return the C name of a variable or field: the Python name, with an underscore at its end if C reserves
    it. Raise TranslationError unless it is ASCII."""
    if not name.isascii():
        raise context.source.error(node, f"the name {name} must be in ASCII, as C takes it")
    return f"{name}_" if name in KEYWORDS else name


def variable(context: Context, node: ast.AST, name: str, kind: Any) -> Value:
    """Return the value of the variable `name`, as its C name.

    `kind` is the type of the variable, of whose tuples each part is a C variable; or the value of a table."""
    if isinstance(kind, Value):  # the name is another name of a table
        return kind
    text = identifier(context, node, name)
    if isinstance(kind, Tuple):
        parts = (variable(context, node, f"{name}__{i}", one) for i, one in enumerate(kind.types))
        return Value("", None, parts=tuple(parts))
    return Value(text, kind, pointer=name in context.pointers)


def _name(context: Context, node: ast.Name) -> Value:
    if node.id in context.variables:
        kind = context.variables[node.id]
        if isinstance(kind, LocalFunction):
            raise context.source.error(node, f"the function {node.id} is no value")
        return variable(context, node, node.id, kind)
    return constant(context, node, outside(context, node))


def _attribute(context: Context, node: ast.Attribute) -> Value:
    if isinstance(node.value, ast.Name) and node.value.id not in context.variables:
        return constant(context, node, outside(context, node))
    owner = expression(context, node.value)
    if isinstance(owner.type, Array) and node.attr == "size":
        return constant(context, node, owner.type.length)
    if not isinstance(owner.type, Record):
        raise context.source.error(node, f"{ast.unparse(node.value)} has no fields")
    fields = dict(owner.type.fields)
    if node.attr in fields:
        name = identifier(context, node, node.attr)
        return Value(f"{owner.text}{'->' if owner.pointer else '.'}{name}", fields[node.attr])
    found = getattr(owner.type.record_class, node.attr, None)
    if isinstance(found, property) and found.fget is not None:
        return context.call(node, found.fget, [owner])
    if isinstance(found, int | float | tuple):  # a constant of the record's class
        return constant(context, node, found)
    raise context.source.error(node, f"{ast.unparse(node)} is no number, and no record or property either")


def number(context: Context, node: ast.AST, value: Value) -> Value:
    """Return a value as a number for arithmetic, in which a boolean counts as 0 or 1. Raise TranslationError
    if it is neither number nor boolean."""
    if value.type not in NUMBERS:
        raise context.source.error(node, f"{ast.unparse(node)} is no number")
    return value._replace(type=INT) if value.type == BOOL and value.constant is None else value


def _binary(context: Context, node: ast.BinOp) -> Value:
    left = number(context, node.left, expression(context, node.left))
    right = number(context, node.right, expression(context, node.right))
    if isinstance(node.op, ast.Pow):
        base = as_real(context, node.left, left)
        if right.constant == 2:
            return Value(f"r_square({base.text})", REAL)
        return Value(f"r_pow({base.text}, {as_real(context, node.right, right).text})", REAL)
    whole = REAL not in (left.type, right.type)
    if type(node.op) in _BITS and whole:
        return Value(f"({left.within(UNARY)} {_BITS[type(node.op)]} {right.within(UNARY)})", INT)
    if type(node.op) not in _OPERATORS and type(node.op) not in _DIVISIONS:
        raise context.source.error(node, f"the operator in {ast.unparse(node)!r} is outside the subset")
    if not whole or isinstance(node.op, ast.Div):
        left, right = as_real(context, node.left, left), as_real(context, node.right, right)
    if type(node.op) in _DIVISIONS:
        name = f"{'i' if whole else 'r'}_{_DIVISIONS[type(node.op)]}"
        return Value(f"{name}({left.text}, {right.text})", left.type)
    sign, level = _OPERATORS[type(node.op)]
    known = None
    if left.constant is not None and right.constant is not None and sign != "/":
        known = {"+": np.add, "-": np.subtract, "*": np.multiply}[sign](left.constant, right.constant).item()
    kind = INT if left.type != REAL and right.type != REAL else REAL
    return Value(f"{left.within(level)} {sign} {right.within(level - 1)}", kind, level, constant=known)


def _unary(context: Context, node: ast.UnaryOp) -> Value:
    value = expression(context, node.operand)
    if isinstance(node.op, ast.Not):
        value = as_bool(context, node.operand, value)
        known = None if value.constant is None else not value.constant
        return Value(f"!{value.within(ATOM)}", BOOL, UNARY, constant=known)
    value = number(context, node.operand, value)
    if not isinstance(node.op, ast.USub | ast.UAdd):
        raise context.source.error(node, f"{ast.unparse(node)!r} is outside the subset")
    if isinstance(node.op, ast.UAdd):
        return value
    if value.constant is not None:
        return constant(context, node, -value.constant)
    return Value(f"-{value.within(ATOM)}", value.type, UNARY)


def _subscript(context: Context, node: ast.Subscript) -> Value:
    owner, index = expression(context, node.value), expression(context, node.slice)
    if index.type != INT:
        raise context.source.error(node, f"{ast.unparse(node.slice)} is no whole number")
    length = len(owner.parts) if owner.type is None else getattr(owner.type, "length", None)
    if length is None:
        raise context.source.error(node, f"{ast.unparse(node.value)} is no tuple of numbers")
    known = index.constant
    if known is not None:
        if not -length <= known < length:
            raise context.source.error(node, f"{ast.unparse(node)} is outside its {length} values")
        if owner.type is None:
            return owner.parts[known]
        return Value(f"{owner.text}[{known % length}]", REAL)
    if owner.type is None:
        if any(part.type not in NUMBERS for part in owner.parts):
            raise context.source.error(node, f"{ast.unparse(node.value)} is no tuple of numbers")
        parts = [as_real(context, node, part).text for part in owner.parts]
        owner = Value(context.temporary(Array(length), f"{{{', '.join(parts)}}}"), Array(length))
    if 0 < index.below <= length:
        return Value(f"{owner.text}[{index.text}]", REAL)
    return Value(f"r_at({owner.text}, {length}, {index.text})", REAL)


def _tuple(context: Context, node: ast.Tuple) -> Value:
    return Value("", None, parts=tuple(expression(context, one) for one in node.elts))


def _walrus(context: Context, node: ast.NamedExpr) -> Value:
    context.set(node, node.target.id, expression(context, node.value))
    return _name(context, ast.Name(node.target.id))


NODES: dict[type, Callable[..., Value]] = {
    ast.Constant: lambda context, node: constant(context, node, node.value),
    ast.Name: _name,
    ast.Attribute: _attribute,
    ast.BinOp: _binary,
    ast.UnaryOp: _unary,
    ast.Subscript: _subscript,
    ast.Tuple: _tuple,
    ast.NamedExpr: _walrus,
}
