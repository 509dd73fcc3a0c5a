"""Laws that are sums of alike elements: the order of these is no other minimum."""

from __future__ import annotations

import numpy as np
import xarray as xr

from stickslip.friction import MaxwellSlip
from stickslip.identify.loops.fit import identify_loops
from stickslip.recording import make_recording
from stickslip.simulation import friction_response

NOISE = 0.001
LAW = MaxwellSlip((3.4e5, 9.2e4), (0.98, 0.22))
FREE = ["stiffness_1", "stiffness_2", "strength_1", "strength_2"]


def loops(law: MaxwellSlip, seed: int, samples: int = 600) -> xr.Dataset:
    """Two sines over 0.2 mm, that begin amid the motion."""
    random, finer = np.random.default_rng(seed), 20
    time = np.arange((samples + 199) * finer + 1) / finer / (samples - 1)
    a, b = random.uniform(0.0, 2.0 * np.pi, 2)
    x = 1e-4 * (np.sin(8.0 * np.pi * time + a) + 0.5 * np.sin(22.0 * np.pi * time + b))
    force = friction_response(law, time, x - x[0], tolerance=1e-11)["friction_force"].values
    seen = slice(200 * finer, None, finer)
    noisy = force[seen] + NOISE * random.standard_normal(samples)
    return make_recording(time[seen] - time[seen][0], {"position": x[seen], "friction_force": noisy})


def test_what_is_said_of_one_element_keeps_its_place() -> None:
    recording = loops(LAW, 4)
    start = MaxwellSlip((3e5, 1.4e5), (0.7, 0.3))
    fits = [
        identify_loops(recording, start, FREE),
        identify_loops(recording, start, FREE[:3]),
        identify_loops(recording, start, FREE[:3], tied={"strength_2": "0.22 * strength_1"}),
        identify_loops(recording, start, FREE, noise=NOISE, priors={"strength_2": (0.22, 0.01)}),
    ]
    both = (("stiffness_1", "strength_1"), ("stiffness_2", "strength_2"))
    assert [fit.exchangeable for fit in fits] == [both, (), (), ()]
    # Searches that end at the other order gave intervals over both: [8.9e4, 3.4e5] N/m.
    fit = fits[0]
    assert not fit.minima
    first = 1 if fit.values["strength_1"] > fit.values["strength_2"] else 2
    for place, number in ((0, first), (1, 3 - first)):
        for field in ("stiffness", "strength"):
            low, high = fit.confidence_intervals(0.999)[f"{field}_{number}"]
            truth = getattr(LAW, field)[place]
            assert low <= truth <= high
            assert high - low < 0.25 * truth
