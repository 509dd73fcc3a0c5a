"""Translate conditions: comparisons, `and` and `or`, and conditional expressions."""

from __future__ import annotations

import ast
from typing import Any

from .expressions import NODES, Context, as_bool, as_real, as_type, constant, expression, number
from .subset import (
    AND,
    BOOL,
    CHOICE,
    COMPARISON,
    OR,
    REAL,
    SUM,
    Array,
    Record,
    Tuple,
    Value,
    joined,
    kind_of,
)

_COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


def _boolean(context: Context, node: ast.BoolOp) -> Value:
    both = isinstance(node.op, ast.And)
    found: list[tuple[Value, list[str]]] = []
    values = [context.captured(one) for one in node.values]
    if any(value.type != BOOL for value, _ in values):
        return _one_of(context, node, both)
    for value, lines in values:
        if value.constant is both:
            continue
        found.append((value, lines))
        if value.constant is not None:  # this operand decides the result: later ones are not evaluated
            break
    if not found:
        return constant(context, node, both)
    (first, lines), *rest = found
    context.lines(lines)
    if any(lines for _, lines in rest):
        made = context.hoisted(BOOL)
        context.line(f"{made} = {first.text};")
        for value, lines in rest:
            context.line(f"if ({'' if both else '!'}{made}) {{")
            context.lines(["    " + line for line in [*lines, f"{made} = {value.text};"]])
            context.line("}")
        return Value(made, BOOL)
    if found[-1][0].constant is not None:
        return constant(context, node, not both)
    if not rest:
        return first
    text = (" && " if both else " || ").join(value.within(COMPARISON) for value, _ in found)
    return Value(text, BOOL, AND if both else OR)


def _one_of(context: Context, node: ast.BoolOp, both: bool) -> Value:
    """Return the value of `and` (if `both`) or `or` between numbers: as in Python, the operand that decides,
    not a boolean."""
    *firsts, last = node.values
    whole: ast.expr = last
    for one in reversed(firsts):
        yes, no = (whole, one) if both else (one, whole)
        whole = ast.copy_location(ast.IfExp(one, yes, no), node)
    return expression(context, whole)


def _compare(context: Context, node: ast.Compare) -> Value:
    if any(isinstance(op, ast.In | ast.NotIn) for op in node.ops):
        return _among(context, node)
    operands = [expression(context, one) for one in (node.left, *node.comparators)]
    nodes = [node.left, *node.comparators]
    texts = []
    for i, operator in enumerate(node.ops):
        if type(operator) not in _COMPARISONS:
            raise context.source.error(node, f"the comparison {ast.unparse(node)!r} is outside the subset")
        left = number(context, nodes[i], operands[i])
        right = number(context, nodes[i + 1], operands[i + 1])
        if left.type != REAL and right.type != REAL:
            if left.constant is not None and right.constant is not None and len(node.ops) == 1:
                return constant(context, node, _decide(operator, left.constant, right.constant))
        else:
            left, right = as_real(context, nodes[i], left), as_real(context, nodes[i + 1], right)
        texts.append(f"{left.within(SUM)} {_COMPARISONS[type(operator)]} {right.within(SUM)}")
    if len(texts) == 1:
        return Value(texts[0], BOOL, COMPARISON)
    return Value(" && ".join(texts), BOOL, AND)


def _among(context: Context, node: ast.Compare) -> Value:
    """Return the value of a comparison with `in` or `not in`: a condition that a number equals one, or none,
    of the numbers that are written as a tuple on the right."""
    if len(node.ops) != 1 or not isinstance(node.comparators[0], ast.Tuple):
        raise context.source.error(node, f"the comparison {ast.unparse(node)!r} is outside the subset")
    tests = [ast.Compare(node.left, [ast.Eq()], [one]) for one in node.comparators[0].elts]
    test: ast.expr = ast.BoolOp(ast.Or(), [ast.copy_location(one, node) for one in tests])
    if isinstance(node.ops[0], ast.NotIn):
        test = ast.UnaryOp(ast.Not(), test)
    return expression(context, ast.fix_missing_locations(ast.copy_location(test, node)))


def _decide(operator: ast.cmpop, left: float, right: float) -> bool:
    decide = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}
    return bool(getattr(left, f"__{decide[type(operator)]}__")(right))


def _choice(context: Context, node: ast.IfExp) -> Value:
    test = as_bool(context, node.test, expression(context, node.test))
    if test.constant is not None:
        return expression(context, node.body if test.constant else node.orelse)
    (yes, before_yes), (no, before_no) = context.captured(node.body), context.captured(node.orelse)
    kind = joined(kind_of(yes), kind_of(no))
    if kind is None or isinstance(kind, Record | Array):
        raise context.source.error(node, f"{ast.unparse(node)!r} has values of different types")
    yes, no = as_type(context, node.body, yes, kind), as_type(context, node.orelse, no, kind)
    if not before_yes and not before_no:
        return chosen(test, yes, no)
    made = _places(context, kind)
    for way, lines, value in (("if", before_yes, yes), ("else", before_no, no)):
        context.line(f"if ({test.text}) {{" if way == "if" else "} else {")
        sets = [f"{place} = {text};" for place, text in zip(_flat(made), _flat(value), strict=True)]
        context.lines(["    " + line for line in [*lines, *sets]])
    context.line("}")
    return made


def chosen(test: Value, yes: Value, no: Value) -> Value:
    """Return the value of the C expression `test ? yes : no` for two values of the same type; for tuples,
    there is one such expression per part."""
    if yes.type is None:
        parts = (chosen(test, a, b) for a, b in zip(yes.parts, no.parts, strict=True))
        return Value("", None, parts=tuple(parts))
    text = f"{test.within(COMPARISON)} ? {yes.within(OR)} : {no.within(CHOICE)}"
    return Value(text, yes.type, CHOICE)


def _places(context: Context, kind: Any) -> Value:
    """Return a value of this type whose texts are new C variables, one per part of a tuple, declared at the
    top of the function. Branches then set them."""
    if isinstance(kind, Tuple):
        return Value("", None, parts=tuple(_places(context, one) for one in kind.types))
    return Value(context.hoisted(kind), kind)


def _flat(value: Value) -> list[str]:
    return [text for part in value.parts for text in _flat(part)] if value.type is None else [value.text]


NODES.update({ast.BoolOp: _boolean, ast.Compare: _compare, ast.IfExp: _choice})
