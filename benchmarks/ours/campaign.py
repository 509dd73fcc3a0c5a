"""The campaign's friction fit by `ss.identify_friction`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

import stickslip as ss
from stickslip.identify.walk import friction

from .. import campaign
from ..worker import Case, serve
from .models import actuator

FREE = ("sigma_0", "sigma_1", "coulomb_force", "delay", "offset")


def _fit(alone: bool, **options: Any) -> Callable[[], campaign.Fitted]:
    """`alone`: one search that averages over nothing, which is what peers do."""
    walk = campaign.load()
    sigma_0, sigma_1, coulomb, delay, offset = campaign.start()
    begin = {"delay": delay, "offset": offset}
    model = actuator("P1", sigma_0=sigma_0, sigma_1=sigma_1, coulomb_force=coulomb, stiction_force=coulomb)
    gain, frequency, damping = map(float, walk.stage)
    model = model.replace(gain=gain, natural_frequency=frequency, damping_ratio=damping)
    ends = np.append(walk.start[1:], walk.time[-1] + 1e-3)
    # As lines between points: the value at the end of a piece is that at the start of the next.
    last = walk.level[-1] + walk.slope[-1] * (ends[-1] - walk.start[-1])
    volts = np.round(np.append(walk.level, last), 9)  # not below zero by a rounding error
    drive = ss.Sampled(np.append(walk.start, ends[-1]), volts)
    recording = ss.make_recording(walk.time, {"end_effector_position": walk.position}, title="walk")

    def run() -> campaign.Fitted:
        with patch.object(friction, "loosest", (lambda *_: None) if alone else friction.loosest):
            found = ss.identify_friction([recording], model, FREE, drive=drive, initial=begin, **options)
        values = np.array([found.values[name] for name in FREE])
        return campaign.Fitted(values, found.n_evaluations, found.converged, found.rmse)

    return run


def cases() -> Iterator[Case]:
    for method, alone, hops in (("ss.identify_friction", False, 6), ("the same, one search alone", True, 0)):
        make = partial(_fit, alone, hops=hops)
        yield Case("stickslip", method, "the thesis's start", "campaign", make, campaign.judge)


if __name__ == "__main__":
    serve({"campaign": cases}, ["stickslip", "numba", "scipy"])
