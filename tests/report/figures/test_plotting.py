"""One call draws what the package gives, on one's own axes or on new ones."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.figure import Figure

import stickslip as ss
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
DRIVE = ss.Sawtooth(65.0, 50.0, periods=3)


def test_a_new_figure_is_one_that_notebooks_and_windows_show() -> None:
    (axes,) = ss.plot(ss.simulate(KANG, DRIVE)[["drive_voltage"]])
    assert pyplot.gcf() is axes.figure
    assert axes.figure.number in pyplot.get_fignums()


def test_a_trajectory() -> None:
    walk = ss.simulate(KANG, DRIVE, sample_rate=2e3)[["drive_voltage", "end_effector_position"]]
    axes = ss.plot(walk)
    assert [one.get_ylabel() for one in axes] == ["drive voltage (V)", "end-effector position (µm)"]
    assert axes[1].get_xlabel() == "time (ms)"
    np.testing.assert_allclose(axes[1].lines[0].get_ydata(), 1e6 * walk["end_effector_position"])
    mine = Figure().subplots()
    assert ss.plot(walk[["drive_voltage"]], mine)[0] is mine
    with pytest.raises(QuantityError, match="1 axes are given, and 2 panels need 2"):
        ss.plot(walk, mine)


def test_members() -> None:
    voltage, frequency = (a.ravel() for a in np.meshgrid([40.0, 65.0], [20.0, 50.0, 100.0]))
    drive = ss.Sawtooth(65.0, 50.0)
    found = ss.steady_steps(KANG, drive, parameters={"amplitude": voltage, "frequency": frequency})
    (map_,) = ss.plot(found)
    cells = map_.collections[0].get_array()
    assert cells.shape == (3, 2)
    at = float(found["net_step"][(voltage == 65.0) & (frequency == 50.0)].item())
    assert 1e-6 * cells[1, 1] == pytest.approx(at, rel=1e-9)
    (line,) = ss.plot(found.isel(member=voltage == 65.0))
    assert line.get_xlabel() == "frequency (Hz)"
    assert len(line.lines[0].get_xdata()) == 3
    with pytest.raises(QuantityError, match="0 parameters vary"):
        ss.plot(found.isel(member=[0, 0]))


def test_a_frequency_response() -> None:
    frequency = np.geomspace(10.0, 5e3, 200)
    stage = KANG.gain / (1 - (frequency / 525.7) ** 2 + 1j * frequency / 525.7)
    made = xr.Dataset({"response": ("frequency", stage, {"units": "m/V"})}, coords={"frequency": frequency})
    gain, phase = ss.plot(made)
    assert gain.get_ylabel() == "gain (nm/V)"
    assert np.min(phase.lines[0].get_ydata()) == pytest.approx(np.degrees(np.angle(stage)).min())


def test_fits_and_verifications() -> None:
    walk = ss.simulate(KANG, DRIVE, sample_rate=2e3)
    noise = np.random.default_rng(1).normal(0.0, 5e-9, walk.sizes["time"])
    seen = ss.make_recording(
        walk["time"].values, {"end_effector_position": walk["end_effector_position"].values + noise}
    )
    fit = ss.identify_friction([seen], model=KANG, free=["coulomb_force"], drive=DRIVE, hops=0)
    assert ss.plot(fit).shape == (1, 2)
    found = ss.verify(fit, [seen], drive=DRIVE)
    above, below = ss.plot(found)[0]
    assert len(above.lines) == 2
    assert "residual" in below.get_ylabel()
    for result in (fit, found):
        assert result._repr_html_().startswith("<pre>")


def test_what_cannot_be_drawn() -> None:
    with pytest.raises(QuantityError, match="Sawtooth cannot be drawn"):
        ss.plot(DRIVE)


def test_records_in_a_notebook() -> None:
    shown = KANG._repr_html_()
    assert "<caption>Actuator</caption>" in shown
    assert "105.7 nm/V" in shown
    assert "friction: LuGre" in shown
    assert "1.399 MN/m" in shown
    assert "200 mN, 340 mN" in ss.MaxwellSlip((1e6, 4e5), (0.2, 0.34))._repr_html_()


def test_a_tuning_shows_the_open_loop_of_every_model() -> None:
    others = [KANG.replace(natural_frequency=k * KANG.natural_frequency) for k in (0.95, 1.05)]
    tuning = ss.control.tune(KANG, 20e3, posterior=others)
    gain, phase, sensitivity = ss.plot(tuning)
    assert len(gain.lines) == 3 + 1  # and the line at 1
    peaks = [np.max(line.get_ydata()) for line in sensitivity.lines[:3]]
    assert max(peaks) == pytest.approx(tuning.margins.sensitivity, rel=1e-3)
    assert phase.get_ylabel() == "phase (°)"
    assert tuning.margins.report() in gain.get_title("left")


def test_a_bode_plot_of_an_actuator_and_of_a_regulator() -> None:
    gain, phase = ss.bode(KANG, [1.0, KANG.natural_frequency / (2.0 * np.pi)])
    low, at_resonance = gain.lines[0].get_ydata()
    unit = 1e9 * KANG.gain  # nm/V
    assert gain.get_ylabel() == "gain (nm/V)"
    assert low == pytest.approx(unit, rel=1e-4)
    assert at_resonance == pytest.approx(unit / (2.0 * KANG.damping_ratio), rel=1e-3)
    assert phase.lines[0].get_ydata()[1] == pytest.approx(-90.0, abs=0.1)
    regulator = ss.control.Regulator(ss.control.Pid("10 kV/(um*s)"), 20e3)
    gain, _ = ss.bode(regulator)
    assert "V/m" in gain.get_ylabel()
    turning = KANG.replace(rotary=True, gain="0.1 urad/V", end_effector_mass="0.8 kg cm^2")
    assert "rad/V" in ss.bode(turning)[0].get_ylabel()
    with pytest.raises(QuantityError, match=r"int has no frequency response: give an actuator"):
        ss.bode(3)


@pytest.mark.parametrize(("units", "label"), [(("A", "rad"), "gain (rad/A)"), (("V", "um"), "gain (µm/V)")])
def test_a_bode_plot_of_a_modal_fit_has_the_unit_of_the_fit(units: tuple[str, str], label: str) -> None:
    drive = np.random.default_rng(0).standard_normal((500, 1, 2, 1))
    mode = 1.0 / (1.0 - (np.fft.rfftfreq(500, 1e-3) / 100.0) ** 2 + 0.1j * np.fft.rfftfreq(500, 1e-3) / 100.0)
    moved = 2.0 * np.fft.irfft(mode[:, None, None, None] * np.fft.rfft(drive, axis=0), 500, axis=0)
    moved += 1e-3 * np.random.default_rng(1).standard_normal(moved.shape)
    response = ss.identify.frequency_response(drive, moved, "1 kHz", units=units, band=("5 Hz", "400 Hz"))
    fit = ss.identify_frequency(response, [("100 Hz", 0.05)], complex_modes=False, remainder=False)
    for model in (fit, fit.model):
        gain, _ = ss.bode(model, [1.0])
        assert gain.get_ylabel() == label
        assert gain.lines[0].get_ydata()[0] == pytest.approx(2.0, rel=0.01)
