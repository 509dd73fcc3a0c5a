r"""A linear system from voltages to positions, with a delay: for control and frequency responses.

.. math:: \dot x = A x + B\,u(t - \tau), \qquad y = C x + D\,u(t - \tau)
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities.units import QuantityError, array_si

Array = NDArray[np.float64]


class StateSpace(NamedTuple):
    """`a` (states, states), `b` (states, inputs), `c` (outputs, states), `d` (outputs, inputs), in SI;
    `delay`, s."""

    a: Array
    b: Array
    c: Array
    d: Array
    delay: float = 0.0

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """C (jω - A)⁻¹ B + D, delayed, at frequencies [Hz] (n,): shape (n, outputs, inputs), m/V."""
        s = 2j * np.pi * np.atleast_1d(array_si(frequency, "Hz", "frequency"))
        found = np.broadcast_to(self.d.astype(complex), (s.size, *self.d.shape)).copy()
        if self.a.size:
            inverse = np.linalg.solve(s[:, None, None] * np.eye(len(self.a)) - self.a, self.b.astype(complex))
            found += self.c @ inverse
        return found * np.exp(-s * self.delay)[:, None, None]

    def to_control(self, order: int = 3) -> Any:
        """As ``control.StateSpace`` of python-control (the extra "control"), whose `bode_plot`, `tf` and
        loops take it; the delay becomes a Padé approximation, one below 0, as a
        fit may have it, is left out.

        Args:
            order: of that approximation.

        Raises:
            QuantityError: python-control is not installed, or the order is no whole number >= 1.
        """
        try:
            control: Any = import_module("control")
        except ImportError:
            raise QuantityError("to_control needs python-control: pip install 'stickslip[control]'") from None
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
