"""Loops of the subset: ``while``, and ``for`` over ranges, tuples, ``zip`` and ``enumerate``."""

from __future__ import annotations

import ast
from typing import TYPE_CHECKING, Any

from .assignments import unpack
from .expressions import NUMBERS, as_bool, as_real, expression, identifier, outside
from .subset import INT, REAL, Array, Value, kind_of

if TYPE_CHECKING:
    from .statements import FunctionBody


def loop(body: FunctionBody, node: ast.stmt) -> bool | None:
    """Return whether what follows a statement is dead; None if the statement belongs to no loop."""
    match node:
        case ast.Break() | ast.Continue():
            body.line("break;" if isinstance(node, ast.Break) else "continue;")
            return True  # what follows it is dead
        case ast.While(orelse=[]):
            return _while(body, node)
        case ast.For(orelse=[]):
            _for(body, node)
            return False
        case ast.While() | ast.For():
            raise body.source.error(node, "a loop with else is outside the subset")
    return None


def _while(body: FunctionBody, node: ast.While) -> bool:
    test, before = body.captured(node.test)
    test = as_bool(body, node.test, test)
    if test.constant is False:
        return False
    if test.constant is None and not before:
        body.line(f"while ({test.text}) {{")
    else:  # what the condition needs is computed in each round
        body.line("for (;;) {")
        body.depth += 1
        body.lines(before)
        if test.constant is None:
            body.line(f"if (!({test.text})) {{ break; }}")
        body.depth -= 1
    body.indented(node.body)
    body.line("}")
    return test.constant is True and not _breaks(node.body)


def _breaks(statements: list[ast.stmt]) -> bool:
    """Return whether one of the statements leaves the loop around it."""
    for one in statements:
        if isinstance(one, ast.Break):
            return True
        if isinstance(one, ast.If) and (_breaks(one.body) or _breaks(one.orelse)):
            return True
    return False


def _for(body: FunctionBody, node: ast.For) -> None:
    call = node.iter
    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id not in body.variables:
        function = outside(body, call.func)
        if function is range:
            _range(body, node, call)
            return
        if function in (zip, enumerate) and not call.keywords:
            values: list[Value | None] = [expression(body, one) for one in call.args]
            _over(body, node, values if function is zip else [None, *values])
            return
    value = expression(body, call)
    if value.type is not None and not isinstance(value.type, Array):
        raise body.source.error(node, f"{ast.unparse(call)} is no range, and no tuple either")
    _over(body, node, [value])


def _range(body: FunctionBody, node: ast.For, call: ast.Call) -> None:
    if not isinstance(node.target, ast.Name) or call.keywords or not 1 <= len(call.args) <= 3:
        raise body.source.error(node, "a loop must run over range(n), range(m, n) or range(m, n, step)")
    bounds = [expression(body, one) for one in call.args]
    if any(bound.type != INT for bound in bounds):
        raise body.source.error(node, f"the bounds of {ast.unparse(call)} must be whole numbers")
    zero, one = Value("0", INT, constant=0), Value("1", INT, constant=1)
    first, end = (zero, bounds[0]) if len(bounds) == 1 else bounds[:2]
    step = bounds[2] if len(bounds) == 3 else one
    if not isinstance(step.constant, int) or step.constant == 0:
        raise body.source.error(node, "the step of a range must be a whole number that is known beforehand")
    if end.constant is None:  # it may change in the loop
        end = Value(body.temporary(INT, end.text), INT)
    inside = end.constant or 0 if isinstance(first.constant, int) and first.constant >= 0 else 0
    sign = "<" if step.constant > 0 else ">"
    _counted(body, node, node.target, first.text, f"{sign} {end.within(3)}", step.constant, inside)


def _counted(
    body: FunctionBody, node: ast.For, target: ast.Name, first: str, end: str, step: int, inside: int
) -> None:
    """A loop over whole numbers; the name is a variable of its own where others set or see it."""
    name = target.id
    by = {1: "++{0}", -1: "--{0}"}.get(step, f"{{0}} += {step}" if step > 0 else f"{{0}} -= {-step}")
    own = name not in body.variables and _only_in(body, node, name)
    counter = identifier(body, node, name) if own else body.hoisted(INT)
    declared = f"{INT} {counter}" if own else counter
    body.line(f"for ({declared} = {first}; {counter} {end}; {by.format(counter)}) {{")
    if own:
        body.variables[name] = Value(counter, INT, below=inside)
    else:
        body.depth += 1
        body.set(node, name, Value(counter, INT))
        body.depth -= 1
    body.indented(node.body)
    body.line("}")
    if own:
        del body.variables[name]


def _only_in(body: FunctionBody, node: ast.For, name: str) -> bool:
    """Return whether a name is set by this loop alone, and not used outside it."""
    inside = {id(n) for n in ast.walk(node)}
    seen = [n for n in ast.walk(body.source.tree) if isinstance(n, ast.Name) and n.id == name]
    return body.stores.count(name) == 1 and all(id(n) in inside for n in seen)


def _over(body: FunctionBody, node: ast.For, values: list[Value | None]) -> None:
    """A loop over tuples side by side; None means the number of the round."""
    lengths = {len(v.parts) if v.type is None else v.type.length for v in values if v is not None}
    if not lengths:
        raise body.source.error(node, f"{ast.unparse(node.iter)} has nothing to run over")
    counter, inside = body.hoisted(INT), min(lengths)
    whole = Value(counter, INT, below=inside)
    parts = [whole if v is None else _picked(body, node, v, whole) for v in values]
    body.line(f"for ({counter} = 0; {counter} < {inside}; ++{counter}) {{")
    body.depth += 1
    several = len(values) > 1
    if isinstance(node.target, ast.Tuple):
        unpack(body, node, node.target.elts, Value("", None, parts=tuple(parts)) if several else parts[0])
    elif isinstance(node.target, ast.Name):
        body.set(node, node.target.id, Value("", None, parts=tuple(parts)) if several else parts[0])
    else:
        raise body.source.error(node, f"{ast.unparse(node.target)} is outside the subset")
    body.depth -= 1
    body.indented(node.body)
    body.line("}")


def _picked(body: FunctionBody, node: ast.For, of: Value, counter: Value) -> Value:
    """The value that a round sees of a tuple: from a table, or tables of the parts of its parts."""
    if isinstance(of.type, Array):
        return Value(f"{of.text}[{counter.text}]", REAL)
    if all(kind_of(part) in NUMBERS for part in of.parts):
        texts = ", ".join(as_real(body, node, part).text for part in of.parts)
        return Value(f"{body.temporary(Array(len(of.parts)), f'{{{texts}}}')}[{counter.text}]", REAL)
    rows: list[Any] = [part.parts for part in of.parts]
    if not rows or len({len(row) for row in rows}) != 1 or not rows[0]:
        raise body.source.error(node, f"{ast.unparse(node.iter)} holds values of different types")
    columns = (Value("", None, parts=tuple(column)) for column in zip(*rows, strict=True))
    return Value("", None, parts=tuple(_picked(body, node, column, counter) for column in columns))
