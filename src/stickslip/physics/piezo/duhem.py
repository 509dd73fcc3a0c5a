r"""User-defined hysteresis of the drive in Duhem's form [oh2005]: one function, dh/du.

.. math:: H[u] = u - h, \qquad \frac{dh}{du} = s(u, h, \operatorname{sign} \dot u), \qquad y = C H[u]

h [V] is the hysteretic part that is subtracted from the voltage u; it is initially 0 at 0 V. y is the free
stroke, and C the gain. A model is a record and its slope s. It is rate-independent: only the reversals of the
voltage matter, not its speed. Between reversals h is integrated by the fourth-order Runge-Kutta formula, in
steps that are halved until both halves agree with the whole. `BoucWen` is also of this form, with a
closed-form solution.

Valid if s is finite for every voltage that occurs; otherwise h is NaN, and drives are refused. With s below 1
the stroke increases with the voltage. Models whose memory is more than one number (plays, Preisach's relays)
do not have this form.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...engine._abi import ffi
from ...engine.binding import contiguous, doubles, sized
from ...engine.called_back import running
from ...engine.interface import Interface, row
from ...engine.law_of import law_of
from ...engine.library import library
from ...quantities import registry
from .operators import REST, samples

Array = NDArray[np.float64]

# Largest error of h over one integration step, V.
EXACT = 1e-9
# Voltages, V, at which the compiled functions of a model are compared with its Python functions, with both
# signs.
_VOLTS = (0.0, 1e-6, 0.01, 1.0, 7.0, 100.0)


class _DuhemImplementation(NamedTuple):
    slope: Callable[..., Any]
    way: Callable[..., Any] | None
    corner: Callable[..., Any] | None


_ARGUMENTS = {
    "slope": ("model", "u", "h", "up"),
    "way": ("model", "h", "u", "goal"),
    "corner": ("model", "h", "u", "goal"),
}
_IMPLEMENTATIONS: dict[type, _DuhemImplementation] = {}


def register(
    model_type: type,
    slope: Callable[..., Any],
    *,
    way: Callable[..., Any] | None = None,
    corner: Callable[..., Any] | None = None,
) -> None:
    """Register a record as a piezo model, which is then available by its name.

    Args:
        model_type: the record, a ``typing.NamedTuple``.
        slope: ``slope(model, u, h, up) -> dh/du``, up being 1.0 or -1.0, a plain function. It is compiled if
            possible (see docs/extending.md).
        way: ``way(model, h, u, goal) -> h`` after the voltage has moved from u to the goal, in closed form;
            by default, the slope is integrated.
        corner: ``corner(model, h, u, goal) -> u`` at which h becomes 0 between u and the goal, for a slope
            that jumps there; the goal if it does not.

    Raises:
        TypeError: the record is not a named tuple, or the arguments of a function have other names than
            above.
    """
    name, made = model_type.__name__, _DuhemImplementation(slope, way, corner)
    if not hasattr(model_type, "_fields"):
        raise TypeError(f"{name} is no record: a piezo model is a typing.NamedTuple, one field per parameter")
    for role, function in zip(made._fields, made, strict=True):
        expected = _ARGUMENTS[role]
        if function is not None and tuple(inspect.signature(function).parameters) != expected:
            raise TypeError(f"{name}: {role} must be a function of ({', '.join(expected)}), named so")
    _IMPLEMENTATIONS[model_type] = made
    registry.piezos.add(model_type)


def is_duhem(candidate: object) -> bool:
    """Return True if the object is a record of a registered piezo model, see `register`."""
    return type(candidate) in _IMPLEMENTATIONS


def functions(model_type: type) -> dict[str, Any]:
    """Return the Python functions of a registered model by role: "slope", and "way" and "corner" if it has
    them (see `register`)."""
    made = _IMPLEMENTATIONS[model_type]._asdict()
    return {role: function for role, function in made.items() if function is not None}


def _inputs(role: str) -> list[tuple[float, ...]]:
    volts = [sign * u for u in _VOLTS for sign in (1.0, -1.0)]
    if role == "slope":
        return [(u, h, up) for u in volts for h in volts for up in (1.0, -1.0)]
    return [(h, u, goal) for h in volts for u in volts for goal in volts]


# Interface between piezo models in Duhem's form and the compiled engine: names of the functions (roles) in
# the C struct `duhem`, with the types of their arguments.
DUHEM = Interface(
    name="duhem",
    noun="piezo model",
    header="piezo.h",
    arguments={
        "slope": "real_t u, real_t h, real_t up",
        "way": "real_t h, real_t u, real_t goal",
        "corner": "real_t h, real_t u, real_t goal",
    },
    whole=frozenset(),
    functions=functions,
    numbers=lambda kind: {},
    inputs=_inputs,
)


class EngineModel:
    """A registered piezo model in the form that the functions of the compiled engine take: its compiled
    functions (or Python functions, if they cannot be compiled) and its parameters."""

    def __init__(self, model: Any) -> None:
        self._law = law_of(model, interface=DUHEM)
        self._numbers = ffi.new("real_t[]", row(model) or [0.0])
        self._struct: Any = ffi.new("struct duhem_model *", (self._law.pointer, self._numbers, EXACT))

    def call(self, function: Any, *arguments: Any) -> Any:
        """Call a function of the engine with this model as first argument, then `arguments`; return its
        result.

        Raises:
            BaseException: the error that the model's Python function has raised.
        """
        if self._law.how != "python":
            return function(self._struct, *arguments)
        with running() as stop:
            self._struct.stop = stop
            return function(self._struct, *arguments)


def duhem_response(model: Any, drive: Array, u: float, h: float, out: Array) -> None:
    """Compute the output H [V] of a registered model at each sample of the drive [V] into the array `out`,
    starting from the drive value u and the hysteretic part h, both in V."""
    sized("out", out, drive.size)
    function, of = library().stickslip_duhem_response, EngineModel(model)
    of.call(function, drive.size, contiguous(drive), u, h, doubles(out, "out", True))


def rested(model: Any, drive: float) -> float:
    """Return the hysteretic part h [V] of a registered model at a drive value [V] that was reached from 0 V
    without a reversal."""
    found = np.empty(1)
    duhem_response(model, np.array([float(drive)]), 0.0, 0.0, found)
    return float(drive) - float(found[0])


def output(model: Any, drive: ArrayLike, rest: float | str = 0.0) -> Array:
    """Return the output H[u] [V], shape (n,), for samples of a drive [V] without reversals between them.

    Args:
        model: a registered record.
        drive: V, shape (n,).
        rest: voltage of a long rest before the first sample, reached from 0 V without a reversal.

    Raises:
        QuantityError: a sample, or `rest`, is not a finite voltage.
    """
    at, u = REST.check(rest, "rest"), samples(drive, "drive")
    found = np.empty(u.size)
    duhem_response(model, u, at, rested(model, at), found)
    return found
