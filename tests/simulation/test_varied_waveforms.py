"""Ensembles whose members differ in their waveforms: each is what a simulation of its own gives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from stickslip.friction import Coulomb, Dahl, LuGre, MaxwellSlip
from stickslip.physics.actuator import Actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import simulate, simulate_ensemble
from stickslip.simulation.varied import with_values
from stickslip.waveform.drive import evaluate
from stickslip.waveform.knots import PeriodicKnots
from stickslip.waveform.members import member_of, stacked
from stickslip.waveform.multisine import Multisine
from stickslip.waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle
from stickslip.waveform.sampled import Sampled
from stickslip.waveform.shapes import Chirp, Step

TOLERANCE = 1e-10  # m
LUGRE = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.65)
MODEL = Actuator(0.1057e-6, 3303.1, 0.524, 0.2, 0.1, LUGRE, min_voltage=-150.0, max_voltage=150.0)
SEED = np.random.default_rng(20261122)
# A waveform, and what of it varies between which limits.
DRAWN = {
    "sawtooth": (Sawtooth(65.0, 50.0), {"amplitude": (5, 140), "frequency": (20, 300)}),
    "fractions": (Sawtooth(65.0, 50.0), {"rise_fraction": (0.6, 0.99), "offset": (-5, 5)}),
    "counted": (Sawtooth(65.0, 90.0, periods=3), {"frequency": (60, 300)}),
    "reverse": (ReverseSawtooth(65.0, 50.0), {"amplitude": (5, 140), "frequency": (20, 300)}),
    "triangle": (Triangle(65.0, 50.0), {"amplitude": (5, 140), "frequency": (20, 300)}),
    "cycloid": (Cycloid(65.0, 50.0), {"rise_fraction": (0.6, 0.99), "frequency": (20, 300)}),
    "sine": (Sine(65.0, 50.0), {"amplitude": (5, 140), "phase": (-1, 1)}),
    "chirp": (Chirp(50.0, 10.0, 200.0, 0.05), {"end_frequency": (100, 400)}),
    "knots": (
        PeriodicKnots([0, 0.004, 0.015], [0, 60, -10], 0.02, smooth=True),
        {"value_2": (20, 100), "time_2": (0.002, 0.01), "period": (0.017, 0.03)},
    ),
    "late knots": (PeriodicKnots([0.001, 0.015], [0, 60], 0.02), {"time_1": (0.0005, 0.01)}),
    "multisine": (Multisine((30.0, 20.0), (50.0, 100.0)), {"amplitude_2": (5, 50), "frequency_1": (40, 60)}),
}


def drawn(limits: dict[str, tuple[float, float]], members: int) -> dict[str, np.ndarray]:
    return {name: SEED.uniform(low, high, members) for name, (low, high) in limits.items()}


def changed(waveform, values: dict[str, float]):
    """The waveform of one member, written out."""
    fields = waveform._asdict()
    for name, value in values.items():
        lists = {"value": "values", "time": "times", "amplitude": "amplitudes", "frequency": "frequencies"}
        word, _, index = name.rpartition("_")
        if index.isdigit():
            numbers = list(fields[lists[word]])
            numbers[int(index) - 1] = value
            fields[lists[word]] = numbers
        else:
            fields[name] = value
    return type(waveform)(**fields)


@pytest.mark.parametrize("name", DRAWN)
def test_a_member_is_what_a_simulation_of_it_gives(name: str) -> None:
    waveform, limits = DRAWN[name]
    values = drawn(limits, 4)
    found = simulate_ensemble(
        MODEL, waveform, 0.05, parameters=values, times=[0.01, 0.03, 0.05], tolerance=TOLERANCE
    )
    assert found["status"].values.tolist() == [0] * 4
    for m in range(4):
        own = changed(waveform, {key: float(column[m]) for key, column in values.items()})
        alone = simulate(MODEL, own, times=[0.0, 0.01, 0.03, 0.05], tolerance=TOLERANCE)
        expected = alone["end_effector_position"].values
        np.testing.assert_allclose(
            found["end_effector_position"][m], expected[1:], rtol=0, atol=2 * TOLERANCE
        )


@pytest.mark.parametrize("name", DRAWN)
@pytest.mark.parametrize("duration", [0.004, 0.12])
def test_tables_of_members_are_those_of_their_waveforms(name: str, duration: float) -> None:
    """At random instants, whatever segments there are."""
    waveform, limits = DRAWN[name]
    values = drawn(limits, 5)
    if "rise_fraction" in values:
        values["rise_fraction"][2] = 1.0  # it jumps
    each = [changed(waveform, {k: float(c[m]) for k, c in values.items()}) for m in range(5)]
    if hasattr(waveform, "drives"):
        fields = waveform._asdict()
        for key, column in values.items():
            word, _, index = key.rpartition("_")
            if index.isdigit():
                numbers = list(fields[f"{word}s"])
                numbers[int(index) - 1] = column
                fields[f"{word}s"] = tuple(numbers)
            else:
                fields[key] = column
        made = tuple.__new__(type(waveform), fields.values()).drives(np.full(5, duration))
    else:
        made = stacked([one.drive(duration) for one in each])
    times = np.sort(SEED.uniform(0.0, duration, 200))
    for m, one in enumerate(each):
        table = member_of(made, m)
        there = np.isfinite(table.start)
        rows = int(table.first[np.count_nonzero(there)])
        cut = type(table)(
            float(table.before),
            table.start[there],
            table.polynomial[there],
            table.first[: np.count_nonzero(there) + 1],
            table.harmonic[:rows],
        )
        expected = evaluate(one.drive(duration), times)
        for got, want in zip(evaluate(cut, times), expected, strict=True):
            np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9 * np.abs(want).max())
        assert cut.before == one.drive(duration).before


def test_members_end_with_their_own_waveforms() -> None:
    drive = Sawtooth(65.0, 50.0, periods=2)
    found = simulate_ensemble(MODEL, drive, parameters={"frequency": [50.0, 80.0]})
    np.testing.assert_allclose(found["time_reached"], [2 / 50, 2 / 80])
    assert found["frequency"].attrs["units"] == "Hz"
    assert found.sizes == {"member": 2}


@pytest.mark.parametrize(
    ("law", "field", "value"),
    [
        (Dahl(1.399e6, 0.5401), "sigma_0", 2e6),
        (Coulomb(0.54), "coulomb_force", 0.4),
        (MaxwellSlip((1e6, 4e5), (0.3, 0.24), 1.0), "stiffness_2", 5e5),
    ],
    ids=["Dahl", "Coulomb", "MaxwellSlip"],
)
def test_model_and_waveform_vary_together(law: object, field: str, value: float) -> None:
    model, drive = MODEL.replace(friction=law, external_force=0.05), Sawtooth(65.0, 50.0, offset=3.0)
    values = {field: [value, value], "amplitude": [30.0, 90.0], "load": [1.0, 1.5]}
    found = simulate_ensemble(model, drive, 0.06, parameters=values, tolerance=TOLERANCE)
    for m in range(2):
        own = drive._replace(amplitude=values["amplitude"][m])
        alone = simulate(
            with_values(model, {field: value}), own, 0.06, load=values["load"][m], tolerance=TOLERANCE
        )
        x = alone["end_effector_position"].values
        assert float(found["net_displacement"][m]) == pytest.approx(x[-1] - x[0], abs=2 * TOLERANCE)


def test_bad_waveforms_leave_the_others_and_say_why() -> None:
    good = simulate_ensemble(MODEL, DRAWN["knots"][0], 0.04, parameters={"value_2": [50.0]})
    values = {
        "value_2": [50.0, 160.0, 50.0, np.nan, 50.0],
        "time_2": [0.004, 0.004, 0.016, 0.004, 0.004],
        "period": [0.02, 0.02, 0.02, 0.02, -1.0],
    }
    found = simulate_ensemble(MODEL, DRAWN["knots"][0], 0.04, parameters=values)
    assert found["status"].values.tolist() == [0, 4, 4, 4, 4]
    reasons = found["reason"].values.tolist()
    assert "drive voltage from -10 V to 160 V is out of range" in reasons[1]
    assert "times ascend" in reasons[2]
    assert "values[1]" in reasons[3]
    assert "period = -1 s is out of range" in reasons[4]
    assert float(found["net_displacement"][0]) == float(good["net_displacement"][0])


def test_the_range_is_that_of_the_member() -> None:
    values = {"amplitude": [90.0, 90.0], "max_voltage": [100.0, 80.0]}
    found = simulate_ensemble(MODEL, Sawtooth(65.0, 50.0), 0.02, parameters=values)
    assert found["status"].values.tolist() == [0, 4]
    assert "takes -150 V to 80 V" in str(found["reason"].values[1])


def test_a_static_stage_is_not_torn_along() -> None:
    pohl = MODEL.replace(natural_frequency=math.inf)
    values = {"rise_fraction": [0.9, 1.0, 0.9]}
    found = simulate_ensemble(pohl, Sawtooth(65.0, 50.0), 0.03, parameters=values)
    assert found["status"].values.tolist() == [0, 4, 0]
    assert "infinite speed" in str(found["reason"].values[1])
    before_the_jump = simulate_ensemble(pohl, Sawtooth(65.0, 50.0), 0.019, parameters=values)
    assert before_the_jump["status"].values.tolist() == [0, 0, 0]


class Named(NamedTuple):
    """A law that shares a name with a waveform."""

    frequency: float


def test_names_are_known() -> None:
    drive = Step(5.0)
    for name in ("amplitude_1", "periods", "unit", "value_1"):
        with pytest.raises(QuantityError, match=f"{name!r} cannot vary.*there are .*delay"):
            simulate_ensemble(MODEL, drive, 0.1, parameters={name: [1.0]})
    with pytest.raises(QuantityError, match="'value_4' cannot vary"):
        simulate_ensemble(MODEL, DRAWN["knots"][0], 0.1, parameters={"value_4": [1.0]})
    with pytest.raises(QuantityError, match="'values' cannot vary"):
        simulate_ensemble(MODEL, Sampled([0, 1], [0, 1]), parameters={"values": [1.0]})


def test_a_name_that_model_and_waveform_share_is_refused() -> None:
    from stickslip.simulation.members import checked_columns

    shared = MODEL._replace(name="x")
    named = tuple.__new__(
        type(shared), [Named(1.0) if f == "friction" else v for f, v in shared._asdict().items()]
    )
    with pytest.raises(QuantityError, match="'frequency' cannot vary: it may be the field of Sawtooth"):
        checked_columns(named, Sawtooth(65.0, 50.0), {"frequency": [1.0]})
