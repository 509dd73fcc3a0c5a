"""Translate calls: functions of `math` and NumPy, functions of tuples, records, and any function with a
Python source.

In each function, `context` is the function around the call (`expressions.Context`), and `node` is the call in
Python's syntax tree, for error messages."""

from __future__ import annotations

import ast
import math
from types import ModuleType
from typing import Any

import numpy as np

from .conditions import chosen
from .expressions import (
    NODES,
    NUMBERS,
    Context,
    LocalFunction,
    as_bool,
    as_real,
    as_type,
    constant,
    expression,
    identifier,
    number,
    outside,
)
from .subset import BOOL, INT, REAL, SUM, Array, Record, Value, joined, kind_of

# Functions of one number in `math`; `_NUMPY` has their names in NumPy where these differ.
_MATH = (
    *("acos", "acosh", "asin", "asinh", "atan", "atanh", "cbrt", "cos", "cosh", "degrees", "erf", "erfc"),
    *("exp", "exp2", "expm1", "gamma", "lgamma", "log", "log10", "log1p", "log2", "radians", "sin", "sinh"),
    *("sqrt", "tan", "tanh"),
)
_NUMPY = {"acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan"}
_NUMPY |= {"atanh": "arctanh"}
_OF_TWO = {"atan2": "arctan2", "copysign": "copysign", "fmod": "fmod", "hypot": "hypot", "pow": "power"}


def _functions() -> dict[Any, tuple[str, int]]:
    """Return for each Python function that C has, too, the pair of the C function's name and its number of
    arguments, all real numbers."""
    found: dict[Any, tuple[str, int]] = {abs: ("r_abs", 1), np.sign: ("r_sign", 1)}
    found |= {np.square: ("r_square", 1)}
    found |= {math.fabs: ("r_abs", 1), np.abs: ("r_abs", 1), np.fabs: ("r_abs", 1)}
    found |= {np.floor: ("r_floor", 1), np.ceil: ("r_ceil", 1), np.trunc: ("r_trunc", 1)}
    found |= {np.floor_divide: ("r_floordiv", 2), np.mod: ("r_mod", 2)}
    found |= {np.maximum: ("r_maximum", 2), np.minimum: ("r_minimum", 2)}
    for names, count in (({name: _NUMPY.get(name, name) for name in _MATH}, 1), (_OF_TWO, 2)):
        for name, numpy_name in names.items():
            owners = ((math, name), (np, numpy_name))
            found |= {getattr(o, n): (f"r_{name}", count) for o, n in owners if hasattr(o, n)}
    return found


_FUNCTIONS = _functions()
_TESTS = {
    function: f"r_{name}" for name in ("isfinite", "isinf", "isnan") for function in
    (getattr(math, name), getattr(np, name))
}  # fmt: skip
# Functions from a real number to an integer, with their C counterparts.
_WHOLE = {int: "r_trunc", math.trunc: "r_trunc", math.floor: "r_floor", math.ceil: "r_ceil", round: "r_rint"}
_EXTREMES = {min: "r_min", max: "r_max"}


def _call(context: Context, node: ast.Call) -> Value:
    function = _called(context, node)
    if isinstance(function, Value):
        return function
    if isinstance(function, type) and hasattr(function, "_fields"):
        return _made(context, node, function)
    if function is isinstance:
        value = expression(context, node.args[0])
        kinds = outside(context, node.args[1])
        same = isinstance(value.type, Record) and issubclass(value.type.record_class, kinds)
        return constant(context, node, same)
    if any(isinstance(one, ast.Starred) for one in node.args):
        raise context.source.error(node, f"a tuple with * in {ast.unparse(node)!r} is outside the subset")
    arguments = [expression(context, one) for one in node.args]
    known = None if node.keywords else _known(context, node, function, arguments)
    if known is not None:
        return known
    tree = function.source.tree if isinstance(function, LocalFunction) else None
    if tree is None and not hasattr(getattr(function, "py_func", function), "__code__"):
        raise context.source.error(node, f"{ast.unparse(node.func)} is outside the subset")
    return context.call(node, function, _bound(context, node, function, arguments))


def _called(context: Context, node: ast.Call) -> Any:
    """Return the Python object that is called. For a method of a record, translate the call and return its
    value."""
    if isinstance(node.func, ast.Name) and isinstance(context.variables.get(node.func.id), LocalFunction):
        return context.variables[node.func.id]
    if isinstance(node.func, ast.Attribute):
        inner: ast.expr = node.func
        while isinstance(inner, ast.Attribute):
            inner = inner.value
        known = isinstance(inner, ast.Name) and inner.id not in context.variables
        if not known or not isinstance(outside(context, node.func.value), ModuleType | type):
            owner = expression(context, node.func.value)
            if isinstance(owner.type, Record) and node.func.attr == "_replace":
                return _replaced(context, node, owner)
            method = getattr(getattr(owner.type, "record_class", None), node.func.attr, None)
            if not hasattr(method, "__code__"):
                raise context.source.error(node, f"{ast.unparse(node.func)} is outside the subset")
            arguments = [owner, *(expression(context, one) for one in node.args)]
            return context.call(node, method, _bound(context, node, method, arguments))
    return outside(context, node.func)


def _bound(context: Context, node: ast.Call, function: Any, arguments: list[Value]) -> list[Value]:
    """Return the values of all arguments of a call, in the order of the function's parameters, with keyword
    arguments and defaults. `arguments` are the values of those given by position.

    Raises:
        TranslationError: an argument is missing, unknown or one too many.
    """
    if isinstance(function, LocalFunction):
        spec = function.source.tree.args
        names = [one.arg for one in spec.args]
        trees = dict(zip(names[len(names) - len(spec.defaults) :], spec.defaults, strict=True))
        defaults: dict[str, Any] = {name: expression(context, one) for name, one in trees.items()}
    else:
        plain = getattr(function, "py_func", function)
        names = list(plain.__code__.co_varnames[: plain.__code__.co_argcount])
        values = plain.__defaults__ or ()
        pairs = zip(names[len(names) - len(values) :], values, strict=True)
        defaults = {name: constant(context, node, one) for name, one in pairs}
    given = dict(zip(names, arguments, strict=False))
    given |= {one.arg: expression(context, one.value) for one in node.keywords if one.arg}
    found = [given.get(name, defaults.get(name)) for name in names]
    if None in found or set(given) - set(names) or len(arguments) > len(names):
        raise context.source.error(node, f"{ast.unparse(node)!r} does not fit the function's arguments")
    return [value for value in found if value is not None]


def _known(context: Context, node: ast.Call, function: Any, values: list[Value]) -> Value | None:
    """Return the value of a call of a function with a C counterpart, for the arguments `values`; None for any
    other function."""
    try:
        hash(function)
    except TypeError:
        return None
    if function in _FUNCTIONS:
        name, count = _FUNCTIONS[function]
        if function is math.log and len(values) == 2:  # logarithm with a base, log(x, base)
            a, b = (as_real(context, node, value).text for value in values)
            return Value(f"r_log({a}) / r_log({b})", REAL, 2)
        if function is abs and len(values) == 1 and values[0].type in (INT, BOOL):
            return Value(f"i_abs({values[0].text})", INT)
        return _in_c(context, node, name, count, values)
    if function in _TESTS:
        return _in_c(context, node, _TESTS[function], 1, values)._replace(type=BOOL)
    if function in _EXTREMES or function is sum:
        return _of_all(context, node, function, values)
    one = values[0] if len(values) == 1 else None
    if function in _WHOLE and one is not None:
        if one.type in (INT, BOOL):
            return one._replace(type=INT)
        return Value(f"r_whole({_WHOLE[function]}({as_real(context, node, one).text}))", INT)
    if function is len and one is not None:
        return constant(context, node, one.type.length if isinstance(one.type, Array) else len(one.parts))
    if function in (bool, np.all, np.any, np.bool_) and one is not None:
        return as_bool(context, node, one)  # in C the argument is always a single number, never an array
    if function in (float, np.float64) and one is not None:
        return as_real(context, node, one)
    return _of_numpy(context, node, function, values)


def _of_numpy(context: Context, node: ast.Call, function: Any, values: list[Value]) -> Value | None:
    if function is np.where and len(values) == 3:
        kind = joined(kind_of(values[1]), kind_of(values[2]))
        if kind not in NUMBERS:
            raise context.source.error(node, f"{ast.unparse(node)!r} has values of different types")
        yes, no = (as_type(context, node, value, kind) for value in values[1:])
        return chosen(as_bool(context, node, values[0]), yes, no)
    if function is np.clip and len(values) == 3:
        x, low, high = (as_real(context, node, value).text for value in values)
        return Value(f"r_minimum(r_maximum({x}, {low}), {high})", REAL)
    if function is np.interp and len(values) == 3:
        tables = [_array(context, node, value) for value in values[1:]]
        lengths = {table.type.length for table in tables}
        if len(lengths) != 1:
            raise context.source.error(node, f"{ast.unparse(node)!r} has tables of different lengths")
        x = as_real(context, node, values[0]).text
        return Value(f"r_interp({x}, {tables[0].text}, {tables[1].text}, {lengths.pop()})", REAL)
    return None


def _array(context: Context, node: ast.AST, value: Value) -> Value:
    """Return numbers as a C array: a table itself, or a tuple of numbers that is written into a new array."""
    if isinstance(value.type, Array):
        return value
    if value.type is not None or not value.parts:
        raise context.source.error(node, f"{ast.unparse(node)} is no tuple of numbers")
    texts = ", ".join(as_real(context, node, part).text for part in value.parts)
    kind = Array(len(value.parts))
    return Value(context.temporary(kind, f"{{{texts}}}"), kind)


def _of_all(context: Context, node: ast.Call, function: Any, values: list[Value]) -> Value:
    """Return the minimum, maximum or sum (`function`) of several values, or of the parts of one tuple."""
    if len(values) == 1:
        (of,) = values
        if isinstance(of.type, Array):
            values = [Value(f"{of.text}[{i}]", REAL) for i in range(of.type.length)]
        else:
            values = list(of.parts)
    elif function is sum:
        raise context.source.error(node, f"{ast.unparse(node)!r} is outside the subset")
    if not values and function is not sum:
        raise context.source.error(node, f"{ast.unparse(node)} has nothing to choose from")
    values = [number(context, node, value) for value in values]
    whole = all(value.type in (INT, BOOL) for value in values)
    if function is sum:
        level = SUM
        kind = INT if whole else REAL
        texts = [as_type(context, node, value, kind).within(level) for value in values]
        return Value(" + ".join(["0" if whole else "R(0.0)", *texts]), kind, level)
    name = _EXTREMES[function] if not whole else _EXTREMES[function].replace("r_", "i_")
    kind = INT if whole else REAL
    text, *rest = (as_type(context, node, value, kind).text for value in values)
    for other in rest:
        text = f"{name}({text}, {other})"
    return Value(text, kind)


def _in_c(context: Context, node: ast.Call, name: str, count: int, values: list[Value]) -> Value:
    if len(values) != count:
        raise context.source.error(node, f"{ast.unparse(node)!r} has another number of arguments than in C")
    texts = [as_real(context, node, value).text for value in values]
    return Value(f"{name}({', '.join(texts)})", REAL)


def _made(context: Context, node: ast.Call, record_class: Any) -> Value:
    """Return the value of a call that constructs a record: a new C struct. All fields must be given, by the
    call or by defaults, and be numbers or booleans."""
    names = record_class._fields
    given = dict(zip(names, node.args, strict=False))
    given |= {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
    defaults = {n: v for n, v in record_class._field_defaults.items() if n not in given}
    values = {name: expression(context, one) for name, one in given.items()}
    values |= {name: constant(context, node, one) for name, one in defaults.items()}
    if set(values) != set(names) or len(node.args) > len(names):
        raise context.source.error(node, f"{ast.unparse(node)!r} must give every field of the record")
    values = {n: v if v.type == BOOL else as_real(context, node, v) for n, v in values.items()}
    kind = Record(record_class, tuple((name, values[name].type) for name in names))
    context.use(kind)
    return Value(context.temporary(kind, f"{{{', '.join(values[name].text for name in names)}}}"), kind)


def _replaced(context: Context, node: ast.Call, owner: Value) -> Value:
    """Return the value of `owner._replace(...)`: a copy of the C struct of a record with some fields
    changed."""
    if node.args or any(k.arg is None for k in node.keywords):
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


NODES.update({ast.Call: _call})
