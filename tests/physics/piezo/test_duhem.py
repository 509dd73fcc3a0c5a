"""Duhem hysteresis of one's own: against a closed form, SciPy and Bouc-Wen's; on drives, and refused."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import stickslip as ss
from stickslip.engine import compiled_law, law_of, library, numba_laws
from stickslip.engine.interface import of_package
from stickslip.engine.translator import REAL, Translation, TranslationError
from stickslip.physics.piezo import BoucWen, Piezo, bouc_wen, duhem_output, register_piezo
from stickslip.physics.piezo.duhem import _IMPLEMENTATIONS, DUHEM, is_duhem, rested
from stickslip.quantities.records import Quantity, record
from stickslip.quantities.units import QuantityError
from stickslip.simulation.plant.at_piezo import at_piezo
from stickslip.waveform.drive import evaluate


@record
class Wider(NamedTuple):
    """Wider at high voltages; its ways have a closed form."""

    alpha: Annotated[float, Quantity("", "α", "share", minimum=0)]
    beta: Annotated[float, Quantity("1/V", "β", "decay", above=0)]
    delta: Annotated[float, Quantity("1/V", "δ", "growth")] = 0.0


@record
class OwnBoucWen(NamedTuple):
    """`BoucWen` without its closed form."""

    alpha: Annotated[float, Quantity("", "α", "share", minimum=0)]
    beta: Annotated[float, Quantity("1/V", "β", "decay", above=0)]
    gamma: Annotated[float, Quantity("1/V", "γ", "difference")] = 0.0


@record
class Infinite(NamedTuple):
    """A slope that has a pole within the drive."""

    pole: Annotated[float, Quantity("V", "p", "where")]


class Failing(NamedTuple):
    """A model whose function raises."""

    size: float


def wider(model: Wider, u: float, h: float, up: float) -> float:
    return model.alpha * (1.0 + model.delta * u) - model.beta * up * h


register_piezo(Wider, wider)
register_piezo(
    OwnBoucWen,
    lambda model, u, h, up: model.alpha - (model.beta * up + model.gamma * math.copysign(1.0, h)) * h,
)
register_piezo(Infinite, lambda model, u, h, up: math.inf if u == model.pole else 1.0 / (u - model.pole) ** 2)

WIDER = Wider(0.3, 0.05, 0.004)


def by_hand(model: Wider, volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """u - h of a linear equation, way by way: h = p + q u + c exp(-b u), b = beta * up."""
    h, before, found = 0.0, 0.0, []
    for u in volts:
        if u != before:
            b = model.beta * np.sign(u - before)
            q = model.alpha * model.delta / b
            p = (model.alpha - q) / b
            h = p + q * u + (h - p - q * before) * math.exp(-b * (u - before))
        before = u
        found.append(u - h)
    return np.array(found)


def test_output_is_the_closed_form_on_every_way() -> None:
    volts = np.random.default_rng(0).uniform(-60.0, 150.0, 60)
    np.testing.assert_allclose(duhem_output(WIDER, volts), by_hand(WIDER, volts), atol=2e-7)
    assert duhem_output(WIDER, [70.0], 70.0)[0] == pytest.approx(70.0 - rested(WIDER, 70.0), abs=1e-12)


def test_output_with_a_kink_is_that_of_scipy() -> None:
    model, volts = OwnBoucWen(0.2, 0.06, -0.03), np.array([50.0, 20.0, -45.0, 90.0])
    h, before, expected = 0.0, 0.0, []
    for u in volts:
        up = np.sign(u - before)
        way = solve_ivp(
            lambda u, h, up=up: model.alpha - (model.beta * up + model.gamma * np.sign(h)) * h,
            (before, u),
            [h],
            rtol=1e-11,
            atol=1e-12,
        )
        h, before = float(way.y[0, -1]), float(u)
        expected.append(u - h)
    np.testing.assert_allclose(duhem_output(model, volts), expected, atol=1e-7)
    np.testing.assert_allclose(duhem_output(model, volts), BoucWen(*model).output(volts), atol=1e-7)


@pytest.mark.parametrize(
    "wave",
    [
        ss.Sawtooth(65.0, 5.0, rise_fraction=0.9),
        ss.Sine(30.0, 5.0, offset=20.0),
        ss.Sawtooth(65.0, 5.0),
    ],
    ids=["ramps", "sine", "jumps"],
)
def test_a_table_of_a_drive_is_within_its_precision(wave: ss.Sine) -> None:
    drive = wave.drive(0.5)
    table = at_piezo(Piezo(WIDER), drive, 0.5, 1e-4)
    times = np.unique(np.concatenate([np.linspace(0.0, 0.5, 50_001), drive.start[drive.start < 0.5]]))
    volts = evaluate(drive, times)[0]
    exact = by_hand(WIDER, np.append(drive.before, volts))[1:]
    assert np.abs(evaluate(table, times)[0] - exact).max() < 1e-4


def test_a_stage_walks_with_it_and_every_period_closes() -> None:
    saw = ss.Sawtooth(65.0, 20.0)
    plain = ss.load_actuator("kang2007").replace(stage_reaction=False)
    bent, own = (plain.replace(piezo=Piezo(kind(0.3, 0.05))) for kind in (BoucWen, OwnBoucWen))
    # the tolerance of either is 1 nm
    assert ss.steady_step(own, saw) == pytest.approx(ss.steady_step(bent, saw), abs=1e-9)
    assert abs(ss.steady_step(own, saw) / ss.steady_step(plain, saw) - 1.0) > 0.02


def test_what_is_no_model_is_refused() -> None:
    with pytest.raises(TypeError, match="dict is no record"):
        register_piezo(dict, lambda model, u, h, up: 0.0)
    with pytest.raises(TypeError, match=r"slope must be a function of \(model, u, h, up\)"):
        register_piezo(Wider, lambda model, u: 0.0)
    with pytest.raises(TypeError, match=r"way must be a function of \(model, h, u, goal\)"):
        register_piezo(Wider, lambda model, u, h, up: 0.0, way=lambda h: h)
    assert is_duhem(WIDER)
    assert not is_duhem(0.3)
    with pytest.raises(QuantityError, match="Infinite: h is not finite between 0 V and 65 V"):
        at_piezo(Piezo(Infinite(65.0)), ss.Sawtooth(65.0, 5.0).drive(0.5), 0.5, 1e-4)


@pytest.mark.parametrize("how", ["compiler", "numba", "python"])
def test_a_model_of_ones_own_runs_compiled_or_called_back(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same numbers either way, on samples and on the segments of a drive."""
    volts = np.random.default_rng(1).uniform(-60.0, 90.0, 8)
    drive = ss.Sawtooth(65.0, 5.0).drive(0.2)
    expected = duhem_output(WIDER, volts), at_piezo(Piezo(WIDER), drive, 0.2, 1e-3)
    if how != "compiler":
        monkeypatch.setattr(compiled_law, "compiler", lambda: None)
    if how == "python":
        monkeypatch.setattr(numba_laws, "find_spec", lambda name: None)
    monkeypatch.setattr(law_of, "_KNOWN", {})
    np.testing.assert_allclose(duhem_output(WIDER, volts), expected[0], rtol=1e-13)
    made = at_piezo(Piezo(WIDER), drive, 0.2, 1e-3)
    np.testing.assert_allclose(made.start, expected[1].start, rtol=1e-13)
    np.testing.assert_allclose(made.polynomial, expected[1].polynomial, rtol=1e-9, atol=1e-9)
    assert law_of.law_of(WIDER, interface=DUHEM).how == how


def test_models_of_the_package_come_from_the_library() -> None:
    """All of them, without a compiler at run time: `BoucWen`, for now."""
    own = [model for model in _IMPLEMENTATIONS if of_package(model)]
    assert {model.__name__ for model in own} == set(library.packaged("duhem")) == {"BoucWen"}
    made = law_of.law_of(BoucWen(0.3, 0.05, 0.02), interface=DUHEM)
    assert made.how == "package"
    assert made.pointer.parameters == 3


def test_a_lambda_is_compiled_as_a_function_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is an argument, alone in its statement or line; of two it is not known which."""
    monkeypatch.setattr(law_of, "_KNOWN", {})
    assert law_of.law_of(OwnBoucWen(0.2, 0.06), interface=DUHEM).how == "compiler"
    one, other = (lambda u: u + 1.0), (lambda u: u + 2.0)
    for function in (one, other):
        with pytest.raises(TranslationError, match="the only lambda of its statement"):
            Translation().function(function, (REAL,))


def test_what_a_model_raises_reaches_its_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(model: Wider, u: float, h: float, up: float) -> float:
        if u > 40.0:
            raise RuntimeError("no such voltage")
        return 0.1

    register_piezo(Failing, failing)
    monkeypatch.setattr(compiled_law, "compiler", lambda: None)
    with pytest.raises(RuntimeError, match="no such voltage") as raised:
        duhem_output(Failing(0.0), [30.0, 50.0])
    assert "slope of the piezo model Failing" in raised.value.__notes__[0]


def test_the_equations_of_bouc_wen_in_python() -> None:
    """One way by `bent` against SciPy, its corner by `crossing`, and its slope by a difference."""
    random = np.random.default_rng(3)
    for _ in range(40):
        beta = float(10.0 ** random.uniform(-2.0, -1.0))
        one = BoucWen(float(random.uniform(0.05, 0.45)), beta, beta * float(random.uniform(-0.1, 0.9)))
        h, u, goal = (float(x) for x in random.uniform((-4.0, -50.0, -50.0), (4.0, 50.0, 50.0)))
        up = math.copysign(1.0, goal - u)

        def rate(_: float, h: NDArray[np.float64], one: BoucWen = one, up: float = up) -> NDArray[np.float64]:
            return one.alpha - one.beta * up * h - one.gamma * np.abs(h)

        way = solve_ivp(rate, (u, goal), [h], rtol=1e-10, atol=1e-12, dense_output=True)
        assert bouc_wen.bent(one, h, u, goal) == pytest.approx(float(way.y[0, -1]), abs=1e-7)
        assert bouc_wen.bent(one, h, u, u) == h
        at = bouc_wen.crossing(one, h, u, goal)
        assert min(u, goal) <= at <= max(u, goal)
        assert (at != goal) == (h * float(way.y[0, -1]) < 0.0)
        if at != goal:
            assert float(way.sol(at)[0]) == pytest.approx(0.0, abs=1e-6)
        assert bouc_wen.bouc_wen_slope(one, u, h, up) == pytest.approx(
            float(rate(u, np.array([h]))[0]), abs=1e-12
        )
