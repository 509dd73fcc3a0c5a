"""A contact that a drive turns back for a moment within a step."""

from __future__ import annotations

import numpy as np

import stickslip as ss


def test_a_contact_that_turns_back_for_a_moment_is_seen() -> None:
    """The fastest known free drive, and others around it, turn it for microseconds within one step; with that
    unseen a net step is off by up to 37 tolerances."""
    rng = np.random.default_rng(5)
    fastest = np.array([0.0, 0.0, 0.0, 99.32, 27.90, 78.10, 100.0, 100.0])
    drives = [(497.35, fastest)]
    for i in range(120):
        near = np.clip(fastest + rng.normal(0.0, 15.0, 8), 0.0, 100.0)
        drives.append((rng.uniform(300.0, 700.0), near if i % 2 else rng.uniform(0.0, 100.0, 8)))
    actuator = ss.load_actuator("kang2007")
    for frequency, volts in drives:
        drive = ss.PeriodicKnots(tuple(np.arange(8) / 8 / frequency), tuple(volts), 1.0 / frequency)
        step, fine = (ss.steady_step(actuator, drive, tolerance=tolerance) for tolerance in (1e-10, 1e-13))
        assert abs(step - fine) < 1e-10
