r"""Noise shaping: a drive that is finer than the step of its converter, because each rounding error is added
to the next outputs.

With the wanted voltage u, the step q and the remaining error e, first order [schreier2005]:

.. math:: y_k = q \operatorname{round}\frac{u_k + e_{k-1}}{q}, \qquad e_k = u_k + e_{k-1} - y_k

The mean of y equals that of u, and the spectrum of the error rises with frequency: a stage that is slow
compared with the ticks does not follow it. The error in a single tick is up to q. At a limit of the voltage y
is rounded inwards, and the remaining error does not exceed half a step.
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
    """Controller whose output voltages are whole steps of a converter, with noise shaping (see the module).

    Args:
        controller: controller of the wanted voltage; its attribute `done` is passed on. The output respects
            the voltage limits of a `Regulator` in it.
        step: voltage step of the converter, V (`Capabilities.step`).
    """

    def __init__(self, controller: Controller, step: float | str) -> None:
        self.controller, self._q = controller, _STEP.check(step, "step")
        low, high = _limits(controller)
        self._low, self._high = -_within(-low, self._q), _within(high, self._q)
        self._left = 0.0

    @property
    def done(self) -> bool:
        """Return True if the inner controller is done."""
        return getattr(self.controller, "done", False)

    def step(self, measured: float, target: float, tick: int) -> float:
        """Return the voltage [V], a whole number of converter steps, for a measured and a wanted position [m,
        or rad] at a tick, and keep its rounding error for the next tick. A voltage that is NaN or infinite is
        returned unchanged."""
        wanted = self.controller.step(measured, target, tick)
        steps = (wanted + self._left) / self._q
        # A voltage that is NaN, or too large to be rounded, is returned; the caller refuses it.
        if not abs(steps) < 1e15:
            return wanted
        whole = round(steps)
        given = min(max(whole, self._low), self._high) * self._q
        self._left += wanted - given
        if not self._low <= whole <= self._high:
            self._left = min(max(self._left, -0.5 * self._q), 0.5 * self._q)
        return given


def _limits(controller: Any) -> tuple[float, float]:
    """Return the voltage limits, V, of the regulator in a controller, or in a controller within it; infinite
    if there is no regulator."""
    one = controller
    for _ in range(_DEEPEST):  # ends even for a controller that contains itself
        if isinstance(one, Regulator):
            return one.low, one.high
        one = next((getattr(one, name) for name in _INNER if hasattr(one, name)), None)
    return -math.inf, math.inf


def _within(limit: float, step: float) -> float:
    """Return the largest whole number of converter steps (each `step` V) that does not exceed `limit` [V].

    A limit of 1e15 steps or more (floating point then has no whole numbers left), or an infinite one, is
    returned unchanged."""
    if not abs(limit) / step < 1e15:
        return limit
    most = math.floor(limit / step)
    while (most + 1) * step <= limit:
        most += 1
    while most * step > limit:
        most -= 1
    return most
