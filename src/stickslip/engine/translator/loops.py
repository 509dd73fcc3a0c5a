"""Translate loops of the subset: ``while``, and ``for`` over ranges, tuples, ``zip`` and ``enumerate``.

In each function, `body` is the function that is being translated, and `node` is the part of Python's syntax
tree."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .assignments import unpack
from .expressions import NUMBERS, as_bool, as_real, expression, identifier, outside
from .subset import INT, REAL, Array, Value, kind_of

if TYPE_CHECKING:
    from .statements import FunctionBody


def loop(body: FunctionBody, node: ast.stmt) -> bool | None:
    """Translate a loop, `break` or `continue`. Return True if the code after it is unreachable, False if not,
    and None for any other statement."""
    match node:
        case ast.Break() | ast.Continue():
            body.line("break;" if isinstance(node, ast.Break) else "continue;")
            return True
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
    else:
        # The condition needs C statements of its own, which must run before each test: put both into an
        # endless loop.
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
    """Return True if one of the statements, also within an `if`, is a `break` of the loop around them."""
    for one in statements:
        if isinstance(one, ast.Break):
            return True
        if isinstance(one, ast.If) and (_breaks(one.body) or _breaks(one.orelse)):
            return True
    return False


def _for(body: FunctionBody, node: ast.For) -> None:
    call = node.iter
    if isinstance(call, ast.Call) and _called(body, call) is range:
        _range(body, node, call)
        return
    counter = body.hoisted(INT)
    length, picked = _rows(body, call)
    part = picked(Value(counter, INT, below=length))
    body.line(f"for ({counter} = 0; {counter} < {length}; ++{counter}) {{")
    body.depth += 1
    if isinstance(node.target, ast.Tuple):
        unpack(body, node, node.target.elts, part)
    elif isinstance(node.target, ast.Name):
        body.set(node, node.target.id, part)
    else:
        raise body.source.error(node, f"{ast.unparse(node.target)} is outside the subset")
    body.depth -= 1
    body.indented(node.body)
    body.line("}")


def _called(body: FunctionBody, node: ast.expr) -> Any:
    """Return the global or built-in function that an expression calls by its name, such as `range`; None for
    any other expression."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
        return None
    return None if node.func.id in body.variables else outside(body, node.func)


def _rows(body: FunctionBody, node: ast.expr) -> tuple[int, Callable[[Value], Value]]:
    """Return the number of iterations of a loop over `node` (a tuple, `zip` or `enumerate`), and a function
    that gets the C counter, as a value, and returns the value of the iteration.

    Raises:
        TranslationError: `node` is another expression, or a strict `zip` of tuples of different lengths;
            another `zip` ends with the shortest tuple.
    """
    function = _called(body, node)
    if function is zip or function is enumerate:
        assert isinstance(node, ast.Call)
        parts = [_rows(body, one) for one in node.args]
        lengths = {length for length, _ in parts}
        if not parts or (function is enumerate and (len(parts) > 1 or node.keywords)):
            raise body.source.error(node, f"{ast.unparse(node)} is outside the subset")
        if node.keywords and len(lengths) > 1:
            raise body.source.error(node, f"{ast.unparse(node)} has tuples of different lengths")

        def row(counter: Value) -> Value:
            first = (counter,) if function is enumerate else ()
            return Value("", None, parts=(*first, *(one(counter) for _, one in parts)))

        return min(lengths), row
    value = expression(body, node)
    if value.type is not None and not isinstance(value.type, Array):
        raise body.source.error(node, f"{ast.unparse(node)} is no range, and no tuple either")
    return (len(value.parts) if value.type is None else value.type.length), _column(body, node, value)


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
    if end.constant is None:  # store the end before the loop, which may change the variables in it
        end = Value(body.temporary(INT, end.text), INT)
    inside = end.constant or 0 if isinstance(first.constant, int) and first.constant >= 0 else 0
    sign = "<" if step.constant > 0 else ">"
    _counted(body, node, node.target, first.text, f"{sign} {end.within(3)}", step.constant, inside)


def _counted(
    body: FunctionBody, node: ast.For, target: ast.Name, first: str, end: str, step: int, inside: int
) -> None:
    """Write the C statements of a loop over integers. The C counter has the Python name, or is a separate
    variable if that name is also used outside the loop.

    Args:
        body, node, target: function, loop, and the name in Python's syntax tree that is set in each
            iteration.
        first: C text of the first value.
        end: C text of the comparison with which the loop continues, such as "< 5".
        step: increment, not 0.
        inside: bound below which the counter stays, if it is known and the counter is never negative; else 0.
    """
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
    """Return True if the variable `name` is set only by the loop `node` itself, and used only inside the
    loop."""
    inside = {id(n) for n in ast.walk(node)}
    seen = [n for n in ast.walk(body.source.tree) if isinstance(n, ast.Name) and n.id == name]
    return body.stores.count(name) == 1 and all(id(n) in inside for n in seen)


def _column(body: FunctionBody, node: ast.expr, of: Value) -> Callable[[Value], Value]:
    """Return a function that gets a C index, as a value, and returns that element of the tuple `of`.

    The tuple is written as a C array; a tuple of tuples of equal lengths as one array per part.

    Raises:
        TranslationError: the elements have different types.
    """
    if isinstance(of.type, Array):
        return lambda counter: Value(f"{of.text}[{counter.text}]", REAL)
    if all(kind_of(part) in NUMBERS for part in of.parts):
        texts = ", ".join(as_real(body, node, part).text for part in of.parts)
        made = body.temporary(Array(len(of.parts)), f"{{{texts}}}")
        return lambda counter: Value(f"{made}[{counter.text}]", REAL)
    rows = [part.parts for part in of.parts]
    if not rows or len({len(row) for row in rows}) != 1 or not rows[0]:
        raise body.source.error(node, f"{ast.unparse(node)} holds values of different types")
    columns = [_column(body, node, Value("", None, parts=column)) for column in zip(*rows, strict=True)]
    return lambda counter: Value("", None, parts=tuple(column(counter) for column in columns))
