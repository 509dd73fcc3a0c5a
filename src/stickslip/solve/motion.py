"""The motion of a model: hands it to the engine that suits its contact."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction.law import elements
from ..mechanism import Mechanism
from ..waveform.drive import Drive
from .adaptive import integrate
from .periods import integrate_bristle

NO_TIMES, NO_SAMPLES, NO_ACCOUNT = np.zeros(0), np.zeros((0, 6)), np.zeros((0, 4))


def one_bristle(law: Any, mech: Mechanism) -> bool:
    """Whether `bristle` takes the model: one internal state, and a stage and a slider that both move."""
    return elements(law) == 1 and not mech.kinematic and not mech.clamped


def motion(
    law: Any,
    mech: Mechanism,
    drive: Drive,
    load: Drive,
    q: NDArray[np.float64],
    span: tuple[float, float],
    tolerance: float,
    max_steps: int,
    times: NDArray[np.float64] = NO_TIMES,
    samples: NDArray[np.float64] = NO_SAMPLES,
    account: NDArray[np.float64] = NO_ACCOUNT,
) -> tuple[int, float, int, int]:
    """Integrate the state `q` over `span` in place, and fill `samples` and, if it has rows, the energy
    `account`; arguments and results as in `adaptive.integrate`."""
    ends = np.array(span)
    if one_bristle(law, mech) and account.shape[0] == 0:
        return integrate_bristle(law, mech, drive, load, q, ends, tolerance, max_steps, times, samples)
    return integrate(law, mech, drive, load, q, ends, tolerance, max_steps, times, samples, account)
