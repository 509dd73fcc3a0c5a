"""Verification: figures of merit by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from stickslip.identify.fit import Residuals, fit_least_squares
from stickslip.identify.result import Fit, Parameter
from stickslip.recording import RecordingError, make_recording
from stickslip.verification import verify


def line(slope: float, n: int, title: str) -> xr.Dataset:
    t = np.arange(float(n))
    return make_recording(t, {"position": slope * t}, title=title)


def fitted() -> Fit:
    t = np.arange(20.0)
    fit = fit_least_squares(
        [Residuals(lambda v: v["slope"] * t - 2.0 * t)], [Parameter("slope", 1.0, 0.1, 10.0, "m/s")]
    )
    return replace(
        fit,
        observed="position",
        predict=lambda r, drive=None: fit.values["slope"] * r["time"].values + (drive or 0.0),
    )


def test_figures_of_merit() -> None:
    v = verify(fitted(), [line(2.0, 12, "same"), line(3.0, 15, "steeper")])
    t, u = np.arange(12.0), np.arange(15.0)
    sse, sst = np.sum(u**2), [np.sum((2 * t - 11) ** 2), np.sum((3 * u - 21) ** 2)]
    assert v.r_squared == pytest.approx(1 - sse / sum(sst), rel=1e-6)
    assert v.rmse == pytest.approx(np.sqrt(sse / 27), rel=1e-6)
    assert v.table["r_squared"].values == pytest.approx([1.0, 1 - sse / sst[1]])
    assert v.table["rmse"].attrs["units"] == "m"
    assert v.table["largest_error"].values == pytest.approx([0.0, 14.0], abs=1e-6)
    assert list(v.table["recording"].values) == ["same", "steeper"]
    np.testing.assert_allclose(v.predictions[1]["residual"], -u, atol=1e-6)
    np.testing.assert_allclose(v.predictions[1]["measured"], 3 * u)
    assert v.predictions[1]["predicted"].attrs["units"] == "m"


def test_report_and_dictionary() -> None:
    v = verify(fitted(), [line(2.0, 12, "same"), line(3.0, 15, "steeper")])
    lines = v.report().splitlines()
    assert lines[0] == "prediction of position [m]"
    assert [words.split()[0] for words in lines[1:]] == ["recording", "same", "steeper", "all"]
    found = json.loads(json.dumps(v.to_dict(), allow_nan=False))
    assert found["recordings"]["steeper"]["n_data"] == 15
    level = verify(fitted(), line(0.0, 12, "level"))  # r^2 has no meaning for a constant
    assert level.to_dict()["r_squared"] is None
    assert "all" not in level.report()


def test_what_cannot_be_verified_is_refused() -> None:
    with pytest.raises(ValueError, match="no model"):
        verify(replace(fitted(), predict=None), line(2.0, 12, "same"))
    with pytest.raises(RecordingError, match=r"steep has no position \[m\]"):
        verify(fitted(), line(2.0, 12, "steep").rename(position="force"))
    lost = replace(fitted(), predict=lambda r: np.full(r["time"].size, np.nan))
    with pytest.raises(RecordingError, match=r"cannot predict position \[m\] of same"):
        verify(lost, line(2.0, 12, "same"))
    with pytest.raises(RecordingError, match="there are 2 drives for 1 recordings"):
        verify(fitted(), line(2.0, 12, "same"), drive=[1.0, 2.0])
