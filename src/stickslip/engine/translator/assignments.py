"""Translate assignments to variables and to tuples of variables.

In each function, `body` is the function that is being translated, which collects the C statements, and `node`
is the statement in Python's syntax tree, for error messages. A variable whose later value needs a wider type
(a real number instead of an integer) makes the translation start again with that type.
"""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING, Any

from .expressions import LocalFunction, as_type, identifier
from .subset import REAL, Array, Record, Tuple, Value, joined, kind_of

if TYPE_CHECKING:
    from .statements import FunctionBody

_MADE = re.compile(r"made_\d+(\.\w+)?")


class Retyped(Exception):
    """Signal, not an error: the variable `name` (or the result, `statements.RESULT`) needs the wider type
    `kind`, so that the function must be translated again."""

    def __init__(self, name: str, kind: Any) -> None:
        super().__init__(name)
        self.name, self.kind = name, kind


def assign(body: FunctionBody, node: ast.Assign, targets: list[ast.expr], value: Value) -> None:
    """Write the C statements of an assignment of `value` to one or several targets (a = b = value).

    Raises:
        TranslationError: a target is neither a name nor a tuple of names.
    """
    match targets:
        case [ast.Name(id=name)]:
            set_variable(body, node, name, value)
        case [ast.Tuple(elts=parts) | ast.List(elts=parts)]:
            unpack(body, node, parts, value)
        case [*several] if len(several) > 1:
            held = _held(body, value)
            for one in several:
                assign(body, node, [one], held)
        case _:
            raise body.source.error(node, f"{ast.unparse(node)!r} is outside the subset")


def set_variable(body: FunctionBody, node: ast.AST, name: str, value: Value) -> None:
    """Write the C statements that assign a value to the variable `name`, which is declared if it is new.

    Raises:
        TranslationError: the new value has a type that does not fit the variable.
        Retyped: the variable needs a wider type.
    """
    if isinstance(value.type, Array):
        if body.stores.count(name) > 1:
            raise body.source.error(node, f"{name} cannot be set to {value.text}")
        body.variables[name] = value  # no C variable: the name is another name of the constant table
        return
    kind = joined(body.types.get(name), kind_of(value))
    known = body.variables.get(name)
    wanted = joined(known, kind) if kind is not None and not isinstance(known, LocalFunction) else None
    if wanted is None:
        raise body.source.error(node, f"{name} changes its type from {known} to {kind_of(value)}")
    if known is not None and wanted != known:
        raise Retyped(name, wanted)
    if isinstance(wanted, Record) and name in body.pointers:
        raise body.source.error(node, f"{name} cannot be set to {value.text}")
    if isinstance(wanted, Tuple) and known is not None:
        value = _held(body, value)
    _store(body, node, name, wanted, value, new=known is None)
    body.variables[name] = wanted


def _store(body: FunctionBody, node: ast.AST, name: str, kind: Any, value: Value, new: bool) -> None:
    """Write the C statements that store a value of the type `kind` in the variable `name`, which they declare
    if it is `new`; a tuple is stored in one variable per part."""
    if isinstance(kind, Tuple):
        for i, (one, part) in enumerate(zip(kind.types, value.parts, strict=True)):
            _store(body, node, f"{name}__{i}", one, part, new)
        return
    value = as_type(body, node, value, kind)
    c_name = identifier(body, node, name)
    text = f"{'*' if value.pointer else ''}{value.text}"
    if new and body.depth == 1:
        body.line(f"{body.translation.c_type(kind)} {c_name} = {text};")
        return
    if new:
        body.declared[c_name] = kind
    body.line(f"{c_name} = {text};")


def _held(body: FunctionBody, value: Value) -> Value:
    """Return a value whose C text later assignments do not change: its numbers are copied to new C variables,
    except constants, tables and records."""
    if value.type is None:
        return value._replace(parts=tuple(_held(body, part) for part in value.parts))
    if value.constant is not None or isinstance(value.type, Array | Record) or _MADE.fullmatch(value.text):
        return value
    return Value(body.temporary(value.type, value.text), value.type)


def unpack(body: FunctionBody, node: ast.AST, targets: list[ast.expr], value: Value) -> None:
    """Write the C statements that assign the parts of a tuple to names, or to tuples of names. If a part uses
    one of the names (a, b = b, a), all parts are copied first.

    Raises:
        TranslationError: the numbers of names and parts differ, or a target is no name.
    """
    value = parts_of(value)
    if len(targets) != len(value.parts):
        raise body.source.error(node, "a tuple needs one name for each of its parts")
    names = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
    if any(re.search(rf"\b{name}_?\b", text) for name in names for text in _texts(value)):
        value = _held(body, value)
    for target, part in zip(targets, value.parts, strict=True):
        match target:
            case ast.Name(id=name):
                set_variable(body, node, name, part)
            case ast.Tuple(elts=inner):
                unpack(body, node, inner, part)
            case _:
                raise body.source.error(node, "a tuple needs one name for each of its parts")


def _texts(value: Value) -> list[str]:
    return [text for part in value.parts for text in _texts(part)] if value.type is None else [value.text]


def parts_of(value: Value) -> Value:
    """Return a table as a tuple of its numbers; return any other value unchanged."""
    if not isinstance(value.type, Array):
        return value
    parts = (Value(f"{value.text}[{i}]", REAL) for i in range(value.type.length))
    return Value("", None, parts=tuple(parts))
