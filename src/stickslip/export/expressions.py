"""Expressions of the subset, from Python's syntax tree to C."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ..friction.exponential import decay
from .subset import (
    AND,
    ATOM,
    BOOL,
    CHOICE,
    COMPARISON,
    INT,
    KEYWORDS,
    OR,
    PRODUCT,
    REAL,
    SUM,
    UNARY,
    Array,
    FunctionSource,
    Record,
    Value,
    real,
    record_type,
)

_OPERATORS = {ast.Add: ("+", SUM), ast.Sub: ("-", SUM), ast.Mult: ("*", PRODUCT), ast.Div: ("/", PRODUCT)}
_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_MATH = ("exp", "expm1", "sin", "cos", "tan", "tanh", "atan", "sqrt", "log", "log1p", "copysign")
_FUNCTIONS = {getattr(owner, name): f"r_{name}" for name in _MATH for owner in (math, np)}
_FUNCTIONS |= {abs: "r_abs", math.fabs: "r_abs", min: "r_min", max: "r_max", math.pow: "r_pow"}


class Context(Protocol):
    """What an expression needs of the function around it."""

    source: FunctionSource
    variables: dict[str, Any]
    pointers: set[str]

    def call(self, node: ast.AST, function: Callable[..., Any], arguments: list[Value]) -> Value: ...
    def temporary(self, c_type: Any, text: str) -> str: ...
    def line(self, text: str) -> None: ...
    def use(self, record: Record) -> None: ...


def as_real(context: Context, node: ast.AST, value: Value) -> Value:
    """The value as a real number."""
    if value.type == REAL:
        return value
    if value.type == INT:
        return (
            Value(real(value.constant), REAL, constant=value.constant)
            if value.constant is not None
            else Value(f"(real_t){value.within(UNARY)}", REAL, UNARY)
        )
    raise context.source.error(node, f"{ast.unparse(node)} is no number")


def as_bool(context: Context, node: ast.AST, value: Value) -> Value:
    """The value as a condition; numbers are none, for C and Python could differ."""
    if value.type == BOOL:
        return value
    raise context.source.error(node, f"{ast.unparse(node)} is no condition; compare it with something")


def expression(context: Context, node: ast.expr) -> Value:
    """The C of an expression.

    Raises:
        TranslationError: it is outside the subset.
    """
    translate = _NODES.get(type(node))
    if translate is None:
        raise context.source.error(
            node, f"{ast.unparse(node)!r} ({type(node).__name__}) is outside the subset"
        )
    return translate(context, node)


def constant(context: Context, node: ast.AST, value: Any) -> Value:
    """A number, truth or record that is known now."""
    if isinstance(value, bool):
        return Value("true" if value else "false", BOOL, constant=value)
    if isinstance(value, int):
        return Value(str(value), INT, ATOM if value >= 0 else UNARY, constant=value)
    if isinstance(value, float):
        return Value(real(value), REAL, constant=value)
    raise context.source.error(node, f"{ast.unparse(node)} is neither a number nor true or false")


def outside(context: Context, node: ast.expr) -> Any:
    """The object that a name outside the function, or an attribute of a module, stands for."""
    function = context.source.function
    if isinstance(node, ast.Attribute):
        return getattr(outside(context, node.value), node.attr)
    if not isinstance(node, ast.Name) or node.id in context.variables:
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
    """The C name of a variable."""
    if not name.isascii():
        raise context.source.error(node, f"the name {name} must be in ASCII, as C takes it")
    return f"{name}_" if name in KEYWORDS else name


def _name(context: Context, node: ast.Name) -> Value:
    if node.id in context.variables:
        text = identifier(context, node, node.id)
        kind = context.variables[node.id]
        if isinstance(kind, tuple) and kind and isinstance(kind[0], Value):
            return Value("", None, parts=kind)
        return Value(text, kind, pointer=node.id in context.pointers)
    found = outside(context, node)
    if hasattr(found, "_fields") and not isinstance(found, type):  # a record of the module
        kind = record_type(found)
        context.use(kind)
        fields = ", ".join(
            constant(context, node, getattr(found, name)).text
            if kind_of in (INT, BOOL)
            else real(getattr(found, name))
            for name, kind_of in kind.fields
        )
        return Value(context.temporary(kind, f"{{{fields}}}"), kind)
    return constant(context, node, found)


def _attribute(context: Context, node: ast.Attribute) -> Value:
    if isinstance(node.value, ast.Name) and node.value.id not in context.variables:
        return constant(context, node, outside(context, node))
    owner = expression(context, node.value)
    if not isinstance(owner.type, Record):
        raise context.source.error(node, f"{ast.unparse(node.value)} has no fields")
    fields = dict(owner.type.fields)
    if node.attr in fields:
        name = identifier(context, node, node.attr)
        return Value(f"{owner.text}{'->' if owner.pointer else '.'}{name}", fields[node.attr])
    found = getattr(owner.type.record_class, node.attr, None)
    if isinstance(found, property) and found.fget is not None:
        return context.call(node, found.fget, [owner])
    raise context.source.error(node, f"{ast.unparse(node)} is no number, and no record or property either")


def _binary(context: Context, node: ast.BinOp) -> Value:
    left, right = expression(context, node.left), expression(context, node.right)
    if isinstance(node.op, ast.Pow):
        base = as_real(context, node.left, left)
        if right.constant == 2:
            return Value(f"r_square({base.text})", REAL)
        return Value(f"r_pow({base.text}, {as_real(context, node.right, right).text})", REAL)
    if type(node.op) not in _OPERATORS:
        raise context.source.error(node, f"the operator in {ast.unparse(node)!r} is outside the subset")
    sign, level = _OPERATORS[type(node.op)]
    whole = left.type == INT and right.type == INT and sign != "/"
    if not whole:
        left, right = as_real(context, node.left, left), as_real(context, node.right, right)
    known = None
    if left.constant is not None and right.constant is not None and sign != "/":
        known = {"+": np.add, "-": np.subtract, "*": np.multiply}[sign](left.constant, right.constant).item()
    text = f"{left.within(level)} {sign} {right.within(level - 1)}"
    return Value(text, INT if whole else REAL, level, constant=known)


def _unary(context: Context, node: ast.UnaryOp) -> Value:
    value = expression(context, node.operand)
    if isinstance(node.op, ast.Not):
        if isinstance(value.type, Array):
            return constant(context, node, value.type.length == 0)
        value = as_bool(context, node.operand, value)
        known = None if value.constant is None else not value.constant
        return Value(f"!{value.within(ATOM)}", BOOL, UNARY, constant=known)
    if not isinstance(node.op, ast.USub | ast.UAdd) or value.type not in (REAL, INT):
        raise context.source.error(node, f"{ast.unparse(node)!r} is outside the subset")
    if isinstance(node.op, ast.UAdd):
        return value
    if value.constant is not None:
        return constant(context, node, -value.constant)
    return Value(f"-{value.within(ATOM)}", value.type, UNARY)


def _boolean(context: Context, node: ast.BoolOp) -> Value:
    both = isinstance(node.op, ast.And)
    parts = []
    for one in node.values:
        value = as_bool(context, one, expression(context, one))
        if value.constant is not None:
            if value.constant is not both:  # it decides; what stands after it is not looked at
                parts.append(value)
                break
            continue
        parts.append(value)
    if not parts:
        return constant(context, node, both)
    if parts[-1].constant is not None:
        return constant(context, node, not both)
    if len(parts) == 1:
        return parts[0]
    text = (" && " if both else " || ").join(part.within(COMPARISON) for part in parts)
    return Value(text, BOOL, AND if both else OR)


def _compare(context: Context, node: ast.Compare) -> Value:
    operands = [expression(context, one) for one in (node.left, *node.comparators)]
    nodes = [node.left, *node.comparators]
    texts = []
    for i, operator in enumerate(node.ops):
        if type(operator) not in _COMPARISONS:
            raise context.source.error(node, f"the comparison {ast.unparse(node)!r} is outside the subset")
        left, right = operands[i], operands[i + 1]
        if left.type == INT and right.type == INT:
            if left.constant is not None and right.constant is not None and len(node.ops) == 1:
                return constant(context, node, _decide(operator, left.constant, right.constant))
        else:
            left, right = as_real(context, nodes[i], left), as_real(context, nodes[i + 1], right)
        texts.append(f"{left.within(SUM)} {_COMPARISONS[type(operator)]} {right.within(SUM)}")
    if len(texts) == 1:
        return Value(texts[0], BOOL, COMPARISON)
    return Value(" && ".join(texts), BOOL, AND)


def _decide(operator: ast.cmpop, left: float, right: float) -> bool:
    decide = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}
    return bool(getattr(left, f"__{decide[type(operator)]}__")(right))


def _choice(context: Context, node: ast.IfExp) -> Value:
    test = as_bool(context, node.test, expression(context, node.test))
    if test.constant is not None:
        return expression(context, node.body if test.constant else node.orelse)
    yes, no = expression(context, node.body), expression(context, node.orelse)
    if yes.type != no.type or isinstance(yes.type, Record | Array):
        yes, no = as_real(context, node.body, yes), as_real(context, node.orelse, no)
    return Value(f"{test.within(OR)} ? {yes.within(OR)} : {no.within(CHOICE)}", yes.type, CHOICE)


def _subscript(context: Context, node: ast.Subscript) -> Value:
    owner, index = expression(context, node.value), expression(context, node.slice)
    if index.type != INT:
        raise context.source.error(node, f"{ast.unparse(node.slice)} is no whole number")
    if owner.parts and index.constant is not None and -len(owner.parts) <= index.constant < len(owner.parts):
        return owner.parts[index.constant]
    if not isinstance(owner.type, Array):
        raise context.source.error(node, f"{ast.unparse(node.value)} is no tuple of numbers")
    known = index.constant
    if known is not None and not 0 <= known < owner.type.length:
        raise context.source.error(node, f"{ast.unparse(node)} is outside its {owner.type.length} values")
    return Value(f"{owner.text}[{index.text}]", REAL)


def _tuple(context: Context, node: ast.Tuple) -> Value:
    return Value("", None, parts=tuple(expression(context, one) for one in node.elts))


def _call(context: Context, node: ast.Call) -> Value:
    if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
        return _replaced(context, node, expression(context, node.func.value))
    function = outside(context, node.func)
    if function is isinstance:
        value = expression(context, node.args[0])
        kinds = outside(context, node.args[1])
        same = isinstance(value.type, Record) and issubclass(value.type.record_class, kinds)
        return constant(context, node, same)
    if isinstance(function, type) and hasattr(function, "_fields"):
        return _made(context, node, function)
    if node.keywords:
        raise context.source.error(node, f"keyword arguments in {ast.unparse(node)!r} are outside the subset")
    arguments = [expression(context, one) for one in node.args]
    if function is len and isinstance(arguments[0].type, Array):
        return constant(context, node, arguments[0].type.length)
    if function in (bool, np.all) and arguments[0].type == BOOL:  # in C there is one member, not many
        return arguments[0]
    if function in (math.isinf, np.isinf):
        text = f"r_isinf({as_real(context, node.args[0], arguments[0]).text})"
        return Value(text, BOOL)
    if function is decay:  # in C a call costs what it costs
        return Value(f"r_exp(-({as_real(context, node.args[0], arguments[0]).text}))", REAL)
    if function is float:
        return as_real(context, node.args[0], arguments[0])
    if function in _FUNCTIONS:
        return _known(context, node, _FUNCTIONS[function], arguments)
    if not hasattr(getattr(function, "py_func", function), "__code__"):
        raise context.source.error(node, f"{ast.unparse(node.func)} is outside the subset")
    return context.call(node, function, arguments)


def _known(context: Context, node: ast.Call, name: str, arguments: list[Value]) -> Value:
    texts = [as_real(context, n, v).text for n, v in zip(node.args, arguments, strict=True)]
    if len(texts) != (2 if name in ("r_min", "r_max", "r_pow", "r_copysign") else 1):
        raise context.source.error(node, f"{ast.unparse(node)!r} has another number of arguments than in C")
    return Value(f"{name}({', '.join(texts)})", REAL)


def _made(context: Context, node: ast.Call, record_class: Any) -> Value:
    """A record from its fields, all of which must be numbers or conditions."""
    given = dict(zip(record_class._fields, node.args, strict=False))
    given |= {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
    values = {name: expression(context, one) for name, one in given.items()}
    if set(values) != set(record_class._fields):
        raise context.source.error(node, f"{ast.unparse(node)!r} must give every field of the record")
    values = {n: v if v.type == BOOL else as_real(context, given[n], v) for n, v in values.items()}
    kind = Record(record_class, tuple((name, values[name].type) for name in record_class._fields))
    context.use(kind)
    fields = ", ".join(values[name].text for name in record_class._fields)
    return Value(context.temporary(kind, f"{{{fields}}}"), kind)


def _replaced(context: Context, node: ast.Call, owner: Value) -> Value:
    """A copy of a record with some fields changed."""
    if not isinstance(owner.type, Record) or node.args or any(k.arg is None for k in node.keywords):
        raise context.source.error(node, f"{ast.unparse(node)!r} is outside the subset")
    fields = dict(owner.type.fields)
    copy = context.temporary(owner.type, f"{'*' if owner.pointer else ''}{owner.text}")
    for keyword in node.keywords:
        value = expression(context, keyword.value)
        if keyword.arg not in fields:
            raise context.source.error(node, f"{owner.type.record_class.__name__} has no field {keyword.arg}")
        value = value if value.type == BOOL else as_real(context, keyword.value, value)
        context.line(f"{copy}.{identifier(context, node, str(keyword.arg))} = {value.text};")
    return Value(copy, owner.type)


_NODES: dict[type, Callable[..., Value]] = {
    ast.Constant: lambda context, node: constant(context, node, node.value),
    ast.Name: _name,
    ast.Attribute: _attribute,
    ast.BinOp: _binary,
    ast.UnaryOp: _unary,
    ast.BoolOp: _boolean,
    ast.Compare: _compare,
    ast.IfExp: _choice,
    ast.Subscript: _subscript,
    ast.Tuple: _tuple,
    ast.Call: _call,
}
