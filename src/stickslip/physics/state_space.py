r"""Linear system from voltages to positions with a delay, for control and frequency responses.

.. math:: \dot x = A x + B\,u(t - \tau), \qquad y = C x + D\,u(t - \tau)

with the state x, the voltages u, the positions y and the delay τ.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities.units import QuantityError, array_si

Array = NDArray[np.float64]


class StateSpace(NamedTuple):
    """Matrices of a linear system with an input delay (see the module), in SI: inputs are voltages [V],
    outputs positions [m, or rad].

    Shapes: `a` (states, states), `b` (states, inputs), `c` (outputs, states), `d` (outputs, inputs). `delay`
    is the delay τ of all inputs, s.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    delay: float = 0.0

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response (C (jω - A)⁻¹ B + D) exp(-jωτ) at n frequencies [Hz].

        The result is complex, m/V (rad/V for a rotary system), of shape (n, outputs, inputs).
        """
        s = 2j * np.pi * np.atleast_1d(array_si(frequency, "Hz", "frequency"))
        found = np.broadcast_to(self.d.astype(complex), (s.size, *self.d.shape)).copy()
        if self.a.size:
            inverse = np.linalg.solve(s[:, None, None] * np.eye(len(self.a)) - self.a, self.b.astype(complex))
            found += self.c @ inverse
        return found * np.exp(-s * self.delay)[:, None, None]

    def to_control(self, order: int = 3) -> Any:
        """Return a ``control.StateSpace`` of python-control (extra "control").

        The delay becomes a Padé approximation. A delay below 0, which a fit can find, is left out.

        Args:
            order: order of the Padé approximation.

        Raises:
            QuantityError: python-control is not installed, or, for a delay above 0, the order is no whole
                number >= 1.
        """
        control = python_control("StateSpace.to_control")
        made = control.ss(self.a, self.b, self.c, self.d)
        if self.delay <= 0.0:
            return made
        if isinstance(order, bool) or not isinstance(order, int | np.integer) or order < 1:
            raise QuantityError(
                f"order = {order!r:.60} is out of range: a Padé approximation has a whole order >= 1"
            )
        late = control.ss(*control.ssdata(control.tf(*control.pade(self.delay, order))))
        inputs = self.b.shape[1]
        return made * (control.append(*[late] * inputs) if inputs > 1 else late)


def python_control(call: str) -> Any:
    """Return the module ``control``; `call` names the caller in messages.

    Raises:
        QuantityError: python-control is not installed; the message names the extra.
    """
    try:
        return import_module("control")
    except ImportError:
        raise QuantityError(f"{call} needs python-control: pip install 'stickslip[control]'") from None
