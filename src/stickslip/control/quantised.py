r"""A drive finer than its converter's step: what rounding leaves is put into the next ticks (noise shaping).

With the wanted voltage u, the step q and what is left over e, first order [schreier2005]:

.. math:: y_k = q \operatorname{round}\frac{u_k + e_{k-1}}{q}, \qquad e_k = u_k + e_{k-1} - y_k

The mean of y is that of u, and the error's spectrum rises with frequency: a stage that is slow against the
ticks does not see it. Each tick is off by up to q.
"""

from __future__ import annotations

from ..rig.protocols import Controller
from ..units import QuantityError, to_si


class NoiseShaped:
    """A controller whose voltages are whole steps.

    Args:
        controller: what asks for voltages; its attribute `done` is passed on.
        step: V, of the converter (`Capabilities.step`).
    """

    def __init__(self, controller: Controller, step: float | str) -> None:
        self.controller, self._q = controller, to_si(step, "V", "step")
        if not self._q > 0.0:
            raise QuantityError(f"step = {self._q:g} V must be > 0 V")
        self._left = 0.0

    @property
    def done(self) -> bool:
        """Whether the controller is."""
        return getattr(self.controller, "done", False)

    def step(self, measured: float, target: float, tick: int) -> float:
        """The voltage [V], a whole number of steps."""
        wanted = self.controller.step(measured, target, tick)
        steps = (wanted + self._left) / self._q
        if not abs(steps) < 1e15:  # no number: whoever puts it out refuses it
            return wanted
        given = round(steps) * self._q
        self._left += wanted - given
        return given
