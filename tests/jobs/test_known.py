"""What is known by name, in Python and on the command line."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.quantities import registry
from stickslip.quantities.units import QuantityError


def test_all_kinds_with_a_line_each() -> None:
    found = ss.jobs.catalogue()
    kinds = "laws, actuators, piezo models, waveforms, sensors, readers, rigs, amplifiers, stacks, "
    kinds += "materials, friction pairs, data sheets, benches, "
    assert list(found) == [*kinds.split(", ")[:-1], "calibrations", "datasets"]
    assert list(found["laws"])[: len(ss.LAWS)] == [law.__name__ for law in ss.LAWS]  # then what others add
    assert {"text", "npy", "npz", "mat", "mdf"} <= set(found["readers"])
    assert {"scpi", "virtual"} <= set(found["rigs"])
    assert set(found["actuators"]) == set(ss.parameters.available_sets())
    registered = {one.plural: one.packaged() for one in (registry.laws, registry.waveforms, registry.sensors)}
    registered |= {"readers": (*registry.readers.packaged(), "text"), "rigs": registry.rigs.packaged()}
    registered["piezo models"] = registry.piezos.packaged()
    for kind, of in found.items():
        assert of
        for name, line in of.items():
            if name not in registered.get(kind, of):
                continue  # another test's
            assert len(line) > 10, name
            assert "\n" not in line
            assert not line.startswith(f"{name}("), "a named tuple's own docstring says nothing"
            if kind in ("laws", "piezo models", "waveforms", "sensors", "readers", "rigs"):
                assert line.endswith((".", ")")), f"{name}: {line!r} is no whole sentence"
                assert ". " not in re.sub(r"\b(eq|fig)\. ", "", line), f"{name}: more than a sentence"


def test_every_public_waveform_is_there() -> None:
    public = vars(ss.waveform)
    made = {n for n, one in public.items() if isinstance(one, type)} - {"Drive"}
    assert set(registry.waveforms.packaged()) == made - {"Waveform"}
    assert made - {"Waveform"} <= set(ss.jobs.catalogue("waveforms")["waveforms"])


def test_an_unknown_kind_names_the_nearest() -> None:
    with pytest.raises(QuantityError, match=r"'law'.*did you mean 'laws'"):
        ss.jobs.catalogue("law")


def test_the_command() -> None:
    result = CliRunner().invoke(app, ["list", "laws"])
    assert result.exit_code == 0
    assert "LuGre                   A damped bristle" in result.output
    assert "kang2007-bench" in CliRunner().invoke(app, ["list"]).output
    refused = CliRunner().invoke(app, ["list", "motors"])
    assert refused.exit_code == 2
    assert "there is no kind 'motors'" in refused.output


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_seen_enough_is_no_error(unbuffered: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    command = [sys.executable, "-m", "stickslip", "list", "laws"]
    try:
        done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, env=environment, timeout=120)
    finally:
        os.close(writing)
    assert done.stderr == b""
