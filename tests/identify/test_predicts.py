"""Every fit predicts recordings, or says why not and what does."""

from __future__ import annotations

import inspect
import sys

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.estimate import FitError
from stickslip.identify.frequency.modal import modal_response

NAMES = [name for name in dir(ss.identify) if name.startswith("identify_")]
FITS = {
    name: getattr(ss.identify, name)
    for name in NAMES
    if "Fit" in str(inspect.signature(getattr(ss.identify, name)).return_annotation)
}


@pytest.mark.parametrize("name", sorted(FITS))
def test_an_identification_gives_what_predicts_or_why_none_does(name: str) -> None:
    assert len(FITS) > 7
    source = inspect.getsource(sys.modules[FITS[name].__module__])
    assert "predict=" in source or "unpredicted=" in source


def test_a_modal_fit_names_what_predicts_and_that_does() -> None:
    frequency = np.linspace(50.0, 800.0, 60)
    model = ss.identify.ModalModel(
        np.array([2.0 * np.pi * 300.0]),
        np.array([0.05]),
        0.0,
        np.full((1, 1, 1), 1e-7),
        np.zeros((1, 1, 1)),
        np.zeros((1, 1)),
    )
    response = modal_response(model, frequency)
    noise = 1e-10 * np.random.default_rng(3).standard_normal((*response.shape, 2)) @ [1.0, 1j]
    data = xr.Dataset(
        {
            "response": (("frequency", "output", "input"), response + noise, {"units": "m/V"}),
            "deviation": (("frequency", "output", "input"), np.full(response.shape, 1.4e-10)),
        },
        coords={"frequency": ("frequency", frequency, {"units": "Hz"}), "output": [1], "input": [1]},
    )
    fit = ss.identify_frequency(data, [("300 Hz", 0.05)], complex_modes=False, remainder=False)
    with pytest.raises(FitError, match=r"predict_response\(fit.model, recording\)"):
        ss.verify(fit, ss.make_recording(np.arange(20) * 1e-3, {"drive_voltage": (np.arange(20.0), "V")}))
    time = np.arange(2000) * 1e-4
    slow = ss.make_recording(time, {"drive_voltage": (10.0 * np.sin(2.0 * np.pi * 5.0 * time), "V")})
    moved = ss.identify.predict_response(fit.model, slow)
    assert np.ptp(moved) == pytest.approx(20.0 * 1e-7, rel=0.01)  # far below the mode it is the gain
