"""The bench of the thesis against what the thesis prints of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from stickslip.parameters import ParameterSetError
from stickslip.physics.electronics import amplifier_output, dac_output, small_signal_bandwidth
from stickslip.physics.electronics.parts import load_amplifier, load_stack
from stickslip.rig import available_benches, load_bench
from stickslip.rig import bench as room

from rig.laboratory import BENCH  # isort: skip

FILE = Path(room.__file__).parent / "benches" / "kang2007-bench.toml"
# App. 3, table 4.3: what the program put out, and what was measured at the piezo [V].
NUMBERS = "0 .0175 .03 .0615 .0925 .124 .1865 .218 .2495 .2805 .312 .343 .3745 .4055 .437 .468 .4995"
VOLTS = "0.24 2.97 5 10 15 19.98 29.96 35.04 40.02 45.02 50.03 55.03 60.01 65.01 70 74.99 79.97"


def test_table_of_appendix_3_within_its_scatter() -> None:
    for number, volts in zip(map(float, NUMBERS.split()), map(float, VOLTS.split()), strict=True):
        held = dac_output(BENCH.dac, np.full(200, number))
        out = amplifier_output(BENCH.amplifier, held, BENCH.dac.update_rate, BENCH.piezo_capacitance)[1][-1]
        assert out == pytest.approx(volts, abs=0.016)
    rounding = BENCH.dac._replace(truncates=False)  # why it is taken to truncate
    steps = dac_output(rounding, np.array([float(n) for n in NUMBERS.split()]))
    line = np.polynomial.Polynomial.fit(steps, [float(v) for v in VOLTS.split()], 1)
    assert np.max(np.abs(line(steps) - [float(v) for v in VOLTS.split()])) > 0.05


def test_numbers_of_section_4_3() -> None:
    assert BENCH.dac.step == pytest.approx(4.88e-3, abs=1e-5)
    assert BENCH.dac.gain * BENCH.amplifier.gain == pytest.approx(159.76, rel=1e-3)
    assert BENCH.sensors["inductive"].adc is not None
    assert BENCH.sensors["inductive"].adc.bits == 16
    assert 0.6e-3 <= BENCH.sensors["inductive"].sensor.delay <= 1.0e-3
    assert BENCH.sample_rate == 20e3


def test_what_the_thesis_does_not_print_is_said() -> None:
    assert "sensor.inductive.noise_density" in BENCH.assumptions
    assert "piezo_capacitance" in BENCH.assumptions
    assert "dac.bits" not in BENCH.assumptions
    assert available_benches() == ("kang2007-bench", "kang2007-hysteresis-bench")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "bench"', 'kind = "actuator"', "kind must be 'bench'"),
        ("[dac.bits]", "[dac.bytes]", "[dac]: [bytes] is unknown"),
        (
            "[piezo_capacitance]",
            "[piezo_capacity]",
            "[piezo_capacity] is unknown (did you mean 'piezo_capacitance'?)",
        ),
        ('kind = "bench"', 'kid = "bench"', "[kid] is unknown (did you mean 'kind'?)"),
        ('on = "stage"', 'onn = "stage"', "[sensor.strain_gauge] onn is unknown (did you mean 'on'?)"),
        ('type = "StrainGauge"', 'type = "Ruler"', "type = 'Ruler': there is no sensor 'Ruler'"),
        ('on = "stage"', 'on = "floor"', "on = 'floor'"),
        ('adc = "adc16"', 'adc = "adc24"', "adc = 'adc24'"),
        ('unit = "kHz"\nsource = "app. 5', 'unit = "MHz"\nsource = "app. 5', "cannot sample"),
        ("value = 12\nsource", "value = 12.5\nsource", "Dac.bits"),
        ('title = "Bench', "title = [", "TOML"),
        ("[anti_alias.order]", "[colour]\n[anti_alias.order]", "[colour] is unknown"),
    ],
)
def test_wrong_files_name_file_and_field(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = FILE.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "own.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ParameterSetError, match=re.escape(message)) as caught:
        load_bench(path)
    assert "own.toml" in str(caught.value)


def test_unknown_benches() -> None:
    with pytest.raises(ParameterSetError, match="did you mean 'kang2007-bench'"):
        load_bench("kang2007-bank")
    with pytest.raises(ParameterSetError, match=r"gone\.toml"):
        load_bench("gone.toml")


def test_the_hysteretic_bench_is_that_of_the_thesis_but_for_amplifier_and_stack() -> None:
    sister = load_bench("kang2007-hysteresis-bench")
    assert sister.amplifier == load_amplifier("pd200x4")
    assert sister.piezo_capacitance == load_stack("ae0505d16").load
    for field in ("dac", "sensors", "anti_alias", "sample_rate"):
        assert getattr(sister, field) == getattr(BENCH, field)
    assert "amplifier.max_current" in sister.assumptions
    assert "stack.capacitance" in sister.assumptions
    assert "amplifier.bandwidth" not in sister.assumptions
    assert small_signal_bandwidth(sister.amplifier, sister.piezo_capacitance) == pytest.approx(
        45.3e3, rel=1e-2
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('base = "own.toml"', "the bench is its own base"),
        ("base = 3", "base = 3 must be the name of a bench"),
        ('base = "kang2007-bank"', "did you mean 'kang2007-bench'"),
        ('base = "kang2007-bench"\namplifier = "pd200"', "there is no part 'pd200'"),
        ('base = "kang2007-bench"\namplifier = "ae0505d16"', "is of kind 'stack', not 'amplifier'"),
        (
            'base = "kang2007-bench"\nstack = "ae0505d16"\n[piezo_capacitance]\nvalue = 1\nunit = "uF"\n'
            'source = "s"',
            "stack = 'ae0505d16' must be the name of a stack, without [piezo_capacitance]",
        ),
    ],
)
def test_wrong_bases_and_parts(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(f'kind = "bench"\n{text}\n', encoding="utf-8")
    with pytest.raises(ParameterSetError, match=re.escape(message)):
        load_bench(path)
