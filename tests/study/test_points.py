"""Points of studies: every part of them is what it is of the whole."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import qmc

import stickslip as ss
import study_functions
from stickslip.quantities.units import QuantityError
from stickslip.study import Draws, Grid, Own, Random, Range, SteadySteps, Study
from stickslip.study.description import described, differences, identity
from stickslip.study.layout import Layout, StudyVariable, cut, usual

KANG = ss.load_actuator("kang2007")
SAW = ss.Sawtooth(65.0, 5.0)
STEADY = SteadySteps(KANG, SAW)


def whole(study: Study) -> dict[str, np.ndarray]:
    return dict(study.columns({dim: slice(0, n) for dim, n in zip(study.dims, study.shape, strict=True)}))


def test_a_grid_is_all_combinations_in_order_and_in_si() -> None:
    study = Study(Grid({"amplitude": ["40 V", "65 V"], "sigma_0": ["1 N/um", 2e6, 3e6]}), STEADY)
    assert (study.dims, study.shape) == (("amplitude", "sigma_0"), (2, 3))
    pairs = list(itertools.product([40.0, 65.0], [1e6, 2e6, 3e6]))
    np.testing.assert_array_equal(np.column_stack([*whole(study).values()]), pairs)


@pytest.mark.parametrize("method", ["sobol", "halton", "uniform"])
def test_members_of_a_random_design_do_not_depend_on_how_it_is_cut(method) -> None:
    ranges = {"sigma_0": Range("1 N/um", "2 N/um", spacing="log"), "coulomb_force": ("0.3 N", "0.8 N")}
    design = Random(ranges, 100, method, seed=3)
    one = whole(Study(design, STEADY))
    for size in (1, 7, 64):
        study = Study(design, STEADY)
        order = [*range(0, 100, size)]
        for start in [*order[1:], *order]:  # forward, and then from the beginning again
            part = study.columns({"member": slice(start, min(start + size, 100))})
            for name, column in one.items():
                np.testing.assert_array_equal(part[name], column[start : start + size])
    assert 1e6 <= one["sigma_0"].min() < one["sigma_0"].max() <= 2e6
    assert np.median(one["sigma_0"]) == pytest.approx(np.sqrt(2.0) * 1e6, rel=0.1)
    assert 0.3 <= one["coulomb_force"].min() < one["coulomb_force"].max() <= 0.8
    other = whole(Study(Random(ranges, 100, method, seed=4), STEADY))
    assert not np.any(one["sigma_0"] == other["sigma_0"])


def test_a_sobol_design_is_that_of_scipy() -> None:
    study = Study(Random({"x": (0, 1), "y": (0, 1)}, 64, seed=5), Own(f"{study_functions.__file__}:squares"))
    expected = qmc.Sobol(2, rng=np.random.default_rng(5)).random(64)
    np.testing.assert_array_equal(np.column_stack([*whole(study).values()]), expected)


def test_designs_and_draws_are_multiplied() -> None:
    draws = {"sigma_0": [1e6, 2e6], "coulomb_force": [0.4, 0.5]}
    study = Study([Random({"amplitude": (40, 90)}, 3), Draws(draws), Grid({"frequency": [5, 10]})], STEADY)
    assert (study.dims, study.shape) == (("member", "draw", "frequency"), (3, 2, 2))
    found = whole(study)
    assert found["sigma_0"].tolist() == 3 * [1e6, 1e6, 2e6, 2e6]
    assert found["coulomb_force"].tolist() == 3 * [0.4, 0.4, 0.5, 0.5]
    assert found["frequency"].tolist() == 6 * [5.0, 10.0]
    part = study.columns({"member": slice(2, 3), "draw": slice(1, 2), "frequency": slice(0, 2)})
    for name, column in found.items():
        np.testing.assert_array_equal(part[name], column[10:12])


RANGES = {"coulomb_force": (0.3, 0.8), "gain": (0.9e-7, 1.1e-7)}
VALUES = {"amplitude": [40.0, 65.0], "frequency": [5.0, 10.0, 20.0]}


@pytest.mark.parametrize(
    ("part", "same"),
    [
        (lambda how: Random(how(RANGES), 8), False),
        (lambda how: Grid(how(VALUES)), False),
        (lambda how: Draws(how({name: [1.0, 2.0] for name in RANGES})), True),
    ],
)
def test_another_order_of_names_is_another_study_where_it_is_other_members(part, same: bool) -> None:
    one, other = (Study([part(how)], STEADY) for how in (dict, lambda names: dict(reversed(names.items()))))
    alike = all(np.array_equal(whole(one)[name], whole(other)[name]) for name in whole(one))
    assert alike == same
    assert (identity(described(one)) == identity(described(other))) == same
    told = differences(described(one), described(other))
    assert any(line.startswith("order: ") for line in told) != same


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([], "nothing varies"),
        (Grid({"amplitude": [40, 40]}), "amplitude has the same value twice"),
        (Grid({"amplitud": [40]}), "did you mean 'amplitude'"),
        (Grid({"amplitude": ["40 N"]}), "amplitude.*'40 N'"),
        ([Grid({"amplitude": [40]}), Random({"amplitude": (1, 2)}, 3)], "'amplitude' varies twice"),
        (Random({"amplitude": (2, 1)}, 3), "low = 2 must be below high = 1"),
        (Random({"amplitude": Range(0, 1, spacing="log")}, 3), "log needs values above 0"),
        (Random({"amplitude": Range(1, 2, "lgo")}, 3), "spacing is 'linear' or 'log', not"),  # type: ignore[arg-type]
        (Random({"amplitude": (1, 2)}, 0), "members = 0"),
        (Random({"amplitude": (1, 2)}, 3, "sobel"), "not 'sobel'"),  # type: ignore[arg-type]
        (Random({"amplitude": (1, 2)}, 2**31), "Sobol sequence has 1,073,741,824 members"),
        (Random({"amplitude": (1, 2)}, 3, seed=-1), "seed = -1"),
        (Draws({"amplitude": [1, 2], "frequency": [1]}), "arrays of one length"),
    ],
)
def test_points_that_cannot_be(points, message: str) -> None:
    with pytest.raises(QuantityError, match=message):
        _ = Study(points, STEADY).axes


def test_tasks_cover_all_members_once() -> None:
    variable = StudyVariable("value", ("a", "b", "c"), (), "float64", {})
    layout = Layout(("a", "b", "c"), (5, 4, 7), cut((5, 4, 7), 20), (variable,))
    assert layout.task == (1, 2, 7)
    covered = np.zeros(layout.shape, int)
    for number in range(layout.tasks):
        covered[tuple(layout.place(number).values())] += 1
    assert np.all(covered == 1)
    assert len({layout.key(variable, i) for i in range(layout.tasks)}) == layout.tasks == 10


def test_usual_tasks() -> None:
    assert usual(10**6, 40) == 8192
    assert usual(1000, 40) == 8
    assert usual(3, 40) == 1
    assert usual(10**6, 10**6) == 64  # of 1 MB each
