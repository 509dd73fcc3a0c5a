"""The bench of the thesis against what the thesis prints of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from stickslip.electronics import amplifier_output, dac_output
from stickslip.parameters import ParameterSetError
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
    assert available_benches() == ("kang2007-bench",)


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
