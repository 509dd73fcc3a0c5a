"""Tied parameters: arithmetic expressions of other parameters, parsed by `ast` and never executed.

An expression has numbers, names, ``+ - * / **``, sqrt, exp, log and pi, and quantities with a unit in quotes:
``"'0.1 ms' * sigma_0"``. All of them are analytic, so a complex step gives derivatives without rounding error
[squire1998].
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError, same_dimension, with_unit
from .covariance import Uncertainty
from .parameter import Parameter

Array = NDArray[np.float64]

_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log}
_CONSTANTS = {"pi": np.pi}
_LONGEST = 300  # largest number of characters of an expression
# Complex step of the derivatives, relative to the value.
_STEP = 1e-30
_NOTHING = 1e-200  # magnitude below which a value counts as 0; the complex step is then relative to 1


def names_in(expression: str, of: str) -> list[str]:
    """Return the names of the parameters in an expression, as a list without repetition; `of` is the name of
    the parameter that the expression defines, for errors.

    Raises:
        QuantityError: the expression cannot be read, is too long, or contains something that is not allowed.
    """
    found: dict[str, None] = {}
    for node in ast.walk(_read(expression, of)):
        if isinstance(node, ast.Name) and node.id not in _FUNCTIONS and node.id not in _CONSTANTS:
            found[node.id] = None
    return list(found)


@lru_cache(maxsize=256)
def _read(expression: str, of: str) -> ast.expr:
    if not isinstance(expression, str) or len(expression) > _LONGEST:
        raise QuantityError(f"{of} is tied to no expression of at most {_LONGEST} characters")
    try:
        tree = ast.parse(expression.strip(), mode="eval").body
        _check(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else error
        raise QuantityError(f"{of} is tied to {expression!r}, which cannot be read: {reason}") from None
    return tree


def _check(node: ast.expr) -> None:
    """Raise ValueError unless the syntax node consists of allowed arithmetic: numbers, names, texts,
    operators, and the known functions."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in _OPERATORS:
            parts = [left, right]
        case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
            parts = [operand]
        case ast.Call(ast.Name(name), [argument], []) if name in _FUNCTIONS:
            parts = [argument]
        case ast.Name() | ast.Constant(float() | int() | str()) if not isinstance(
            getattr(node, "value", 0), bool
        ):
            return
        case _:
            known = f"+ - * / **, {', '.join(_FUNCTIONS)}, pi and quantities in quotes ('0.1 ms')"
            raise ValueError(f"{ast.unparse(node)!r} is not one of: numbers, names, {known}")
    for part in parts:
        _check(part)


def _value(node: Any, names: Mapping[str, Any], quantity: Callable[[str], Any]) -> Any:
    """Return the value of an expression that `_check` has accepted.

    Args:
        node: parsed expression.
        names: value of each parameter in the expression, by name (a number, an array, or a quantity with a
            unit).
        quantity: function from the text of a quantity, such as '0.1 ms', to its value in the same kind.
    """
    match node:
        case ast.BinOp(left, op, right):
            return _OPERATORS[type(op)](_value(left, names, quantity), _value(right, names, quantity))
        case ast.UnaryOp(op, operand):
            return _OPERATORS[type(op)](_value(operand, names, quantity))
        case ast.Call(ast.Name(name), [argument]):
            return _FUNCTIONS[name](_value(argument, names, quantity))
        case ast.Name(name):
            return names[name] if name in names else np.float64(_CONSTANTS[name])
    return quantity(node.value) if isinstance(node.value, str) else np.float64(node.value)


@lru_cache(maxsize=256)
def _in_si(text: str) -> float:
    return float(with_unit(text).to_base_units().magnitude)


class Ties:
    """Function from the searched values of a fit to all values, including fixed and tied ones.

    The attributes are `searched`, the searched parameters; `beside`, the fixed and tied ones; and `varying`,
    the names of all except the fixed ones.

    Args:
        parameters: all parameters.

    Raises:
        QuantityError: an expression cannot be read, contains an unknown name or a cycle, or has another unit
            than its parameter.
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.searched = tuple(p for p in parameters if not (p.fixed or p.tied))
        self.beside = tuple(p for p in parameters if p.fixed or p.tied)
        self.varying = [p.name for p in parameters if not p.fixed]
        self._fixed = {p.name: float(p.start) for p in parameters if p.fixed}
        self._order = _ordered({p.name: p.tied for p in parameters if p.tied}, [p.name for p in parameters])
        self._check_units({p.name: p for p in parameters})

    def _check_units(self, known: Mapping[str, Parameter]) -> None:
        for name, tree in self._order:
            p = known[name]
            # Check the units with arbitrary numbers, which differ, so that no difference in the expression is
            # 0.
            needs = enumerate(names_in(p.tied, name))
            units = {n: with_unit(f"{1.37 + 0.11 * i} {known[n].unit}") for i, n in needs}
            said = f"{name} is tied to {p.tied!r}, "
            try:
                with np.errstate(all="ignore"):
                    found = with_unit("1") * _value(tree, units, with_unit)
            except QuantityError as error:
                raise QuantityError(f"{said}which {error}") from None
            except (TypeError, ValueError, ArithmeticError) as error:
                raise QuantityError(f"{said}whose units do not fit: {error}") from None
            if not same_dimension(found, p.unit):
                raise QuantityError(
                    f"{name} [{p.unit or 'a plain number'}] is tied to {p.tied!r}, which is in "
                    f"{found.units or 'plain numbers'}: a factor with a unit goes in quotes, '0.1 ms'"
                )

    def __call__(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return all values by name, in SI, given the searched ones by name (numbers or arrays). Given values
        of fixed parameters are kept; tied values are computed."""
        found = {**values, **{n: x for n, x in self._fixed.items() if n not in values}}
        if not self._order:
            return found
        # Trial points of a search may give absurd values that are not finite.
        with np.errstate(all="ignore"):
            for name, tree in self._order:
                made = _value(tree, {n: np.asarray(x)[()] for n, x in found.items()}, _in_si)
                found[name] = made if isinstance(made, np.ndarray) else float(made)
        return found

    def slopes(
        self, values: Mapping[str, float], by: Sequence[str], of: Sequence[str] | None = None
    ) -> Array:
        """Return the derivatives of the parameters named in `of` by the parameters named in `by`, shape
        (len(of), len(by)). Parameters tied to those in `by` follow them.

        Args:
            values: values by name, in SI, at which the derivatives are taken.
            by: names of the parameters that change.
            of: names of the parameters to differentiate; None: all except the fixed ones.
        """
        rows = list(of or self.varying)
        found = np.zeros((len(rows), len(by)))
        with np.errstate(all="ignore"):
            for column, name in enumerate(by):
                step = _STEP * (abs(values[name]) if abs(values[name]) > _NOTHING else 1.0)
                moved: dict[str, Any] = {n: np.complex128(x) for n, x in self(values).items()}
                moved[name] += 1j * step
                for tied, tree in self._order:
                    if tied != name:
                        moved[tied] = np.complex128(_value(tree, moved, _in_si))
                found[:, column] = [moved[n].imag / step for n in rows]
        return found

    def total(self, columns: Array, values: Mapping[str, float]) -> Array:
        """Return the total derivatives [n, k] by the searched parameters, given the partial derivatives
        `columns` by all parameters except the fixed ones, at these values."""
        return columns @ self.slopes(values, [p.name for p in self.searched]) if self._order else columns

    def follow(self, columns: Mapping[str, Array], values: Mapping[str, float], by: Sequence[str]) -> Array:
        """Return the total derivatives of n quantities by the parameters in `by`, which tied parameters
        follow, shape (n, len(by)).

        Args:
            columns: partial derivatives [n] by each parameter alone, by the parameter's name.
            values: values by name, in SI, at which the derivatives are taken.
            by: names of the parameters.
        """
        moved = [*by, *(name for name, _ in self._order if name not in by)]
        alone = np.column_stack([columns[name] for name in moved])
        return alone @ self.slopes(values, by, moved) if self._order else alone

    def shown(self, values: Mapping[str, float]) -> tuple[Parameter, ...]:
        """Return the searched parameters, then the fixed and tied ones. The latter have a linear scale,
        except tied ones with a positive value."""
        others = (p._replace(log=p.log and bool(p.tied) and values[p.name] > 0.0) for p in self.beside)
        return (*self.searched, *others)

    def extended(self, values: Mapping[str, float], known: Uncertainty) -> Uncertainty:
        """Return the uncertainty of the coordinates q of all `shown` parameters, linearised, from that of the
        searched ones (`known`).

        A parameter tied to only one value, which is at its bound, is also at a bound; other values at their
        bounds are taken as exact.
        """
        if not self.beside:
            return known
        shown, k = self.shown(values), len(self.searched)
        names = [p.name for p in shown]
        by = self.slopes(values, names[:k], names)
        scale = np.array([p.slope(values[p.name]) for p in shown])
        by[k:] *= scale[:k] / scale[k:, None]
        by[:k] = np.eye(k)
        deviations = np.diag(known.covariance)
        free, lost, held = known.bounded == 0, np.isinf(deviations), known.bounded != 0
        sure = np.ix_(free & ~lost, free & ~lost)
        spread = by[:, free & ~lost] @ known.covariance[sure] @ by[:, free & ~lost].T
        open_ends = np.any(by[:, lost] != 0.0, axis=1)
        spread[open_ends, :] = spread[:, open_ends] = 0.0
        spread[open_ends, open_ends] = np.inf
        spread[:k, :k] = known.covariance
        bounded, push, released = np.zeros(len(shown), int), np.zeros(len(shown)), np.zeros(len(shown))
        bounded[:k], push[:k], released[:k] = known.bounded, known.push, known.released
        for i in range(k, len(shown)):
            on = np.flatnonzero(by[i])
            if on.size == 1 and held[on[0]]:
                size, j = abs(by[i, on[0]]), on[0]
                bounded[i] = known.bounded[j] * np.sign(by[i, j])
                push[i], released[i] = known.push[j] / size, known.released[j] * size**2
                spread[i, :] = spread[:, i] = np.nan
        return Uncertainty(spread, bounded, push, released, self._centre(shown, known))

    def _centre(self, shown: Sequence[Parameter], known: Uncertainty) -> Array | None:
        if known.centre is None:
            return None
        at = self({p.name: p.value(float(q)) for p, q in zip(self.searched, known.centre, strict=True)})
        return np.array([p.coordinate(at[p.name]) for p in shown])


def _ordered(tied: Mapping[str, str], known: Sequence[str]) -> list[tuple[str, ast.expr]]:
    """Return the names of tied parameters with their parsed expressions, in an order in which each parameter
    follows those in its expression.

    Args:
        tied: expression of each tied parameter, by name.
        known: names of all parameters.

    Raises:
        QuantityError: an expression cannot be read, has an unknown name, or depends on itself.
    """
    needs = {}
    for name, expression in tied.items():
        needs[name] = names_in(expression, name)
        for other in needs[name]:
            if other not in known:
                others = [n for n in known if n != name]
                raise QuantityError(
                    f"{name} is tied to {expression!r}, but there is no {other!r}"
                    f"{did_you_mean(other, others)}: there are {', '.join(others)}"
                )
    order: list[str] = []

    def follow(name: str, path: tuple[str, ...]) -> None:
        if name in path:
            circle = " -> ".join((*path[path.index(name) :], name))
            raise QuantityError(f"parameters are tied in a circle: {circle}")
        if name in order or name not in tied:
            return
        for other in needs[name]:
            follow(other, (*path, name))
        order.append(name)

    for name in tied:
        follow(name, ())
    return [(name, _read(tied[name], name)) for name in order]
