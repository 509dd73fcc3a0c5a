r"""A drive finer than its converter's step: what rounding leaves is put into the next ticks (noise shaping).

With the wanted voltage u, the step q and what is left over e, first order [schreier2005]:

.. math:: y_k = q \operatorname{round}\frac{u_k + e_{k-1}}{q}, \qquad e_k = u_k + e_{k-1} - y_k

The mean of y is that of u, and the error's spectrum rises with frequency: a stage that is slow against the
ticks does not see it. Each tick is off by up to q. At a limit of the voltage y is rounded inwards, and what
is left over does not grow beyond half a step.
"""

from __future__ import annotations

import math
from typing import Any

from ..quantities.records import Quantity
from ..rig.protocols import Controller
from .blocks import Regulator

_STEP = Quantity("V", "q", "the step of the converter", above=0)
_INNER, _DEEPEST = ("controller", "mover", "regulator"), 10


class NoiseShaped:
    """A controller whose voltages are whole steps.

    Args:
        controller: what asks for voltages; its attribute `done` is passed on. The voltages of a `Regulator`
            within are not passed.
        step: V, of the converter (`Capabilities.step`).
    """

    def __init__(self, controller: Controller, step: float | str) -> None:
        self.controller, self._q = controller, _STEP.check(step, "step")
        low, high = _limits(controller)
        self._low, self._high = -_within(-low, self._q), _within(high, self._q)
        self._left = 0.0

    @property
    def done(self) -> bool:
        """True if the controller is done."""
        return getattr(self.controller, "done", False)

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V], a whole number of steps."""
        wanted = self.controller.step(measured, target, tick)
        steps = (wanted + self._left) / self._q
        if not abs(steps) < 1e15:  # no number: whoever puts it out refuses it
            return wanted
        whole = round(steps)
        given = min(max(whole, self._low), self._high) * self._q
        self._left += wanted - given
        if not self._low <= whole <= self._high:
            self._left = min(max(self._left, -0.5 * self._q), 0.5 * self._q)
        return given


def _limits(controller: Any) -> tuple[float, float]:
    """The voltages of the regulator within, V."""
    one = controller
    for _ in range(_DEEPEST):  # what holds itself has no end
        if isinstance(one, Regulator):
            return one.low, one.high
        one = next((getattr(one, name) for name in _INNER if hasattr(one, name)), None)
    return -math.inf, math.inf


def _within(limit: float, step: float) -> float:
    """The greatest whole number of steps that is not above a limit."""
    if not abs(limit) / step < 1e15:
        return limit
    most = math.floor(limit / step)
    while (most + 1) * step <= limit:
        most += 1
    while most * step > limit:
        most -= 1
    return most
