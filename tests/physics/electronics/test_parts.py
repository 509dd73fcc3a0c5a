"""Amplifiers and stacks by name, and where their numbers are from."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from stickslip.parameters import ParameterSetError, cite
from stickslip.physics.electronics import (
    Amplifier,
    Stack,
    available_parts,
    load_amplifier,
    load_part,
    load_stack,
    small_signal_bandwidth,
)


@pytest.mark.parametrize("name", available_parts())
def test_every_number_has_a_source_or_is_assumed(name: str) -> None:
    part = load_part(name)
    assert isinstance(part.record, {"amplifier": Amplifier, "stack": Stack}[part.kind])
    for field, entry in part.entries.items():
        assert entry.source or entry.assumed, field
        assert bool(entry.reason) == entry.assumed, field
    assert "@misc" in cite(*part.citations)
    assert set(part.assumptions) == {field for field, entry in part.entries.items() if entry.assumed}
    assert (load_amplifier if part.kind == "amplifier" else load_stack)(name) == part.record


def test_what_the_sources_print() -> None:
    """PD200X4: table 4 (power bandwidth at 100 V) follows from the rms current, table 6 from the lag."""
    of = load_amplifier("pd200x4")
    for farad, hertz in ((0.1e-6, 56e3), (0.3e-6, 18e3), (1e-6, 5.6e3), (3e-6, 1.8e3), (10e-6, 560.0)):
        assert math.sqrt(2.0) * of.rms_current / (math.pi * 100.0 * farad) == pytest.approx(hertz, rel=0.05)
    assert small_signal_bandwidth(of, "10 uF") == pytest.approx(6.4e3, rel=0.1)
    e617 = load_amplifier("e-617")
    assert (e617.gain * -2.0, e617.gain * 12.0, e617.peak_duration) == (e617.low, e617.high, 5e-3)


def test_kinds() -> None:
    assert available_parts() == tuple(sorted(available_parts("amplifier") + available_parts("stack")))
    with pytest.raises(
        ParameterSetError, match="pd200x4 is of kind 'amplifier', not 'stack'; there are ae0505d16"
    ):
        load_stack("pd200x4")
    with pytest.raises(ParameterSetError, match=r"no part 'pd200' \(did you mean 'pd200x4'\?\)"):
        load_amplifier("pd200")


def test_a_file_of_ones_own(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    text = 'title = "mine"\ncitations = []\nkind = "stack"\n'
    for field, value in (("loss_tangent", 0.02), ("loss_factor", 8), ("thermal_resistance", 30)):
        unit = 'unit = "K/W"\n' if "thermal" in field else ""
        text += f'[{field}]\nvalue = {value}\n{unit}source = "measured"\n'
    text += '[heat_capacity]\nvalue = 2\nunit = "J/K"\nassumed = true\nreason = "by weight"\n'
    file.write_text(text + '[full_voltage]\nvalue = 0.15\nunit = "kV"\nsource = "data sheet"\n')
    with pytest.raises(ParameterSetError, match=r"own\.toml: Stack\.capacitance is missing"):
        load_stack(file)
    with file.open("a") as more:
        more.write('[capacitance]\nvalue = 1.8\nunit = "uF"\nsource = "bridge"\n')
    part = load_part(file)
    assert part.record == Stack(1.8e-6, 0.02, 8.0, 150.0, 30.0, 2.0)
    assert part.assumptions == {"heat_capacity": "2 J/K: by weight"}
    for wrong, said in (
        ('kind = "stack"', "kind = 'motor' must be one of amplifier, stack"),
        ('title = "mine"', "title = None must be a str"),
    ):
        file.write_text(file.read_text().replace(wrong, 'kind = "motor"' if "kind" in wrong else ""))
        with pytest.raises(ParameterSetError, match=said):
            load_part(file)
        file.write_text(file.read_text().replace('kind = "motor"', wrong))
    file.write_text("no toml")
    with pytest.raises(ParameterSetError, match="no valid TOML"):
        load_part(file)
    with pytest.raises(ParameterSetError, match="cannot be read"):
        load_part(tmp_path / "none.toml")
