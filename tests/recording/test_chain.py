"""The chain between a plant and its channel: one record for the rig, fits, predictions and exported C."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.export import export_c
from stickslip.quantities.units import QuantityError
from stickslip.recording.chain import Chain
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.waveform.slewed import Slewed

from tests.export.building import compiled, output  # isort: skip

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
CHAIN = Chain(delay=0.83e-3, offset=2e-6, scale=0.97, slew_rate=2e5)
DRIVE = ss.Sawtooth(65.0, 20.0, periods=3)


def test_what_is_shown_by_hand() -> None:
    """A ramp of 3 m/s, sampled at 1 kHz: late by a delay that is no whole number of samples."""
    t = np.arange(50) * 1e-3
    shown = CHAIN.sense(3.0 * t, 1e3)
    late = np.maximum(t - CHAIN.delay, 0.0)
    np.testing.assert_allclose(shown, 0.97 * 3.0 * late + 2e-6, rtol=1e-12)


def test_the_rig_shows_what_the_prediction_says() -> None:
    """Slew rate, delay, offset and scale: applied by one, undone by the other."""
    bench = load_bench("kang2007-bench")
    bench = bench.replace(amplifier=bench.amplifier._replace(bandwidth=1e7)).with_chain(CHAIN)
    assert bench.amplifier.slew_rate == CHAIN.slew_rate
    channels = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("position")}
    capture = Capture(length=0.18, interval=50e-6, pre_trigger=0.01)
    recording = measure(VirtualRig(KANG, bench), DRIVE, channels, capture, Limits(max_voltage=100.0))
    position = recording["end_effector_position"]
    half_step = 0.5 * bench.dac.step * bench.amplifier.gain  # of the converter, about 0 V
    assert float(position[0]) == pytest.approx(CHAIN.offset, abs=KANG.gain * half_step)
    # Predictions are in the scale of the plant.
    shown = recording.assign(end_effector_position=position.copy(data=position.values / CHAIN.scale))
    off = CHAIN._replace(offset=CHAIN.offset / CHAIN.scale)
    drive = Slewed(ss.waveform.Sequence(ss.waveform.Rest(0.01), DRIVE), CHAIN.slew_rate)
    found = ss.verify(ss.identify.Predictor(KANG, off), shown, drive=drive)
    assert found.rmse < KANG.gain * 2.0 * half_step  # what the converter's steps are of the position
    for wrong in (off._replace(delay=0.0), off._replace(offset=0.0)):
        assert ss.verify(ss.identify.Predictor(KANG, wrong), shown, drive=drive).rmse > 50.0 * found.rmse
    at_once = ss.waveform.Sequence(ss.waveform.Rest(0.01), DRIVE)
    assert ss.verify(ss.identify.Predictor(KANG, off), shown, drive=at_once).rmse > 3.0 * found.rmse


PROGRAM = """
#include <stdio.h>
#include "stickslip.h"
#include "stickslip_waveform.h"
int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    stickslip_player player = STICKSLIP_WAVEFORM_START;
    real_t begin = R(0.0), end = R(0.0);
    const char *wrong = stickslip_init(&plant, &parameters, STICKSLIP_WAVEFORM_STEP);
    if (wrong != NULL) {
        puts(wrong);
        return 1;
    }
    stickslip_rest(&plant, &state, STICKSLIP_REST_INPUT);
    for (;;) {
        const stickslip_outputs out = stickslip_read(&plant, &state);
        printf("%.17g,%.17g,%.17g\\n", (double)out.drive_voltage, (double)out.end_effector_position,
               (double)out.sensor_output);
        if (!stickslip_play(&player, &begin, &end)) {
            return 0;
        }
        (void)stickslip_step_ramp(&plant, &state, begin, end);
    }
}
"""


@pytest.mark.parametrize("delay", [CHAIN.delay, 0.0, 2e-3])
def test_c_shows_it_too(tmp_path: Path, delay: float) -> None:
    step, chain = 2e-5, CHAIN._replace(delay=delay)
    export_c(KANG, tmp_path / "c", step=step, waveform=DRIVE, chain=chain)
    (tmp_path / "shown.c").write_text(PROGRAM)
    made = compiled(tmp_path / "c", tmp_path / "shown.c", "-O1", "-g", "-fsanitize=address,undefined")
    volts, position, shown = np.loadtxt(io.StringIO(output(made)), delimiter=",").T
    np.testing.assert_allclose(shown, chain.sense(position, 1.0 / step), rtol=0.0, atol=1e-15)
    assert np.max(np.abs(np.diff(volts))) == pytest.approx(CHAIN.slew_rate * step, rel=1e-6)


def test_c_takes_the_chain_of_what_was_fitted(tmp_path: Path) -> None:
    """A fit with a delay exports that; one that would be early is exported without."""
    walk = ss.simulate(KANG, DRIVE, 0.16, sample_rate=2e3)[["end_effector_position"]]
    late = np.interp(walk["time"] - 4e-4, walk["time"], walk["end_effector_position"])
    walk["end_effector_position"] = ("time", late, {"units": "m"})
    options = {"drive": DRIVE, "hops": 0, "channel": ("delay",)}
    fit = ss.identify_friction(walk, KANG, ["coulomb_force"], **options)
    assert fit.values["delay"] == pytest.approx(4e-4, rel=0.05)
    export_c(fit, tmp_path / "c")
    text = (tmp_path / "c" / "stickslip_parameters.c").read_text()
    assert f"p.chain.sensor.delay = R({fit.values['delay']!r})" in text
    with pytest.raises(QuantityError, match="cannot be early"):
        export_c(KANG, tmp_path / "early", chain=Chain(delay=-1e-5))
    assert not (tmp_path / "early").exists()
