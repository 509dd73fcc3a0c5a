"""Sections of the campaign's report from small known data: features, posterior, profiles, choice of model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from stickslip.estimate.bent import straight
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.goodness import Goodness
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.posterior import sample
from stickslip.estimate.problem import Residuals
from stickslip.identify.candidates import Comparison
from stickslip.identify.walk.compare import walk_candidates
from stickslip.jobs.analysis.alignment import Aligned
from stickslip.jobs.analysis.comparison import named
from stickslip.jobs.campaign.additional import Additional
from stickslip.jobs.campaign.additional_sections import additional_numbers, additional_sections
from stickslip.jobs.campaign.features import feature_numbers, features_of, features_section
from stickslip.quantities.units import QuantityError
from stickslip.recording import make_recording
from stickslip.report import Number
from stickslip.report.figures.posterior import posterior_corner
from stickslip.report.views.comparison import conclusion

T = np.linspace(0.0, 1.0, 200)
Y = 1.0 + 2.0 * T + 0.05 * np.random.default_rng(0).standard_normal(T.size)
LINE = [Parameter("a", 0.5, -9.0, 9.0, "N", log=False), Parameter("b", 1.0, 0.01, 99.0, "m")]


def line(wrong: float = 0.0):
    function = lambda v: v["a"] + v["b"] * T + wrong * T**2 - Y  # noqa: E731
    return fit_least_squares([Residuals(function, Y, None, "walk", "m")], LINE)


def found(**additional):
    fit = line()
    return SimpleNamespace(friction=fit, stage=None, additional=Additional(**additional))


def choice(rmse: dict[str, float]) -> Comparison:
    fits = {name: line(0.0 if name == "LuGre" else 2.0 * value) for name, value in rmse.items()}
    seen = {name: Goodness("v", 100, 100 * v**2, 100.0, 0.0, "m") for name, v in rmse.items()}
    return Comparison(fits, seen)


def test_nothing_asked_for_is_nothing_said() -> None:
    assert additional_sections(found(), figures=True) == []
    assert additional_numbers(found()) == {}


def test_profiles_and_samples_stand_beside_the_linearised_intervals() -> None:
    centre = np.array([1.0, np.log(2.0)])
    samples = sample(
        lambda q: (-0.5 * np.sum(((q - centre) / 0.02) ** 2, axis=1), q),
        LINE,
        straight([centre], [4e-4 * np.eye(2)]),
        max_simulations=4000,
    )
    what = found(profiles={"a": (0.9, 1.2)}, posterior=samples)
    numbers = additional_numbers(what)
    assert numbers["posterior"]["a"].value == pytest.approx(1.0, abs=0.01)
    assert numbers["posterior"]["b"].standard_error == pytest.approx(0.04, rel=0.2)
    assert (numbers["profiles"]["a"].low, numbers["profiles"]["a"].unit) == (0.9, "N")
    (section,) = additional_sections(what, figures=True)
    compared, chain = section.tables
    assert [c.name for c in compared.columns] == [
        "parameter", "linearised", "profile likelihood", "posterior",
    ]  # fmt: skip
    assert [row[0] for row in compared.rows] == ["a", "b"]
    assert compared.rows[1][2] is None  # no profile of b
    assert isinstance(chain.rows[0][1], Number)
    assert "the stage is taken as known" in " ".join(section.paragraphs)
    assert samples.message[1:] in " ".join(section.paragraphs)
    assert section.figures[0].name == "campaign-posterior"


def test_contours_hold_their_share_and_the_estimate_is_marked() -> None:
    x, y = np.random.default_rng(1).standard_normal((2, 4000))
    figure = posterior_corner({"a": x, "b": 1e-6 * (y + x)}, {"a": "", "b": "m"}, {"a": 0.5, "b": 1e-6})
    labels = [panel.get_xlabel() for panel in figure.axes]
    assert labels.count("a") == 1
    assert any("b" in panel.get_ylabel() for panel in figure.axes)
    below = next(panel for panel in figure.axes if "b" in panel.get_ylabel())
    assert below.lines[0].get_xdata()[0] == 0.5


@pytest.mark.parametrize(
    ("rmse", "words"),
    [
        ({"LuGre": 0.01, "Dahl": 0.02}, "confirmed."),
        ({"LuGre": 0.02, "Dahl": 0.01}, "do not confirm it"),
        ({"LuGre": 0.13, "Dahl": 0.01}, "LuGre, the usual choice, is 1,200 % above the least error"),
        ({"LuGre": 0.01, "Twin": 0.01001}, "cannot tell it from Twin"),
    ],
)
def test_the_conclusion_follows_from_the_numbers(rmse: dict[str, float], words: str) -> None:
    made = choice(rmse)
    if "Twin" in rmse:
        made = Comparison({"LuGre": line(), "Twin": line()}, made.verifications)
    assert words in conclusion(made)
    what = found(choice=made)
    assert additional_numbers(what)["model_choice"]["LuGre"]["verification_rmse"].value == pytest.approx(
        rmse["LuGre"]
    )
    (section,) = additional_sections(what, figures=True)
    assert section.tables[0].rows[0][0] == min(rmse, key=rmse.__getitem__)  # the best first
    assert section.figures[0].name == "models"


def test_models_are_chosen_by_name() -> None:
    every = walk_candidates(0.5, 1e6, 30.0)
    assert named(every, True) == every
    assert [c.label for c in named(every, ["LuGre", "Dahl"])] == ["LuGre", "Dahl"]
    with pytest.raises(QuantityError, match=r"no 'Lugre' \(did you mean 'LuGre'"):
        named(every, ["Lugre"])


def walk() -> xr.Dataset:
    """Eight strokes of 4 um of which 1.5 um are lost at each slip, and 10 nm of noise."""
    t = np.arange(0.0, 2.0, 1e-3)
    since = np.clip(t - 0.2, 0.0, 1.6 - 1e-9)
    n, phase = np.floor(since / 0.2), (since / 0.2) % 1.0
    u = np.where((t > 0.2) & (t < 1.8), 65.0 * phase, 0.0)
    done = t >= 1.8
    x = np.where(done, 8 * 2.5, 2.5 * n + 4.0 * phase) * 1e-6
    x += 1e-8 * np.random.default_rng(2).standard_normal(t.size)
    return make_recording(t, {"end_effector_position": x, "drive_voltage": u}, title="walk")


def test_features_are_numbers_and_tables_and_say_where_there_are_none() -> None:
    flat = walk().copy(deep=True)
    flat["end_effector_position"][:] = 0.0
    walks = [
        Aligned("walk", walk(), 0.2, 1e-8, None, None, use="fit"),
        Aligned("flat", flat.assign_attrs(title="flat"), 0.2, 1e-8, None, None, use="verify"),
    ]
    features = features_of(walks)
    numbers = feature_numbers(features)
    assert numbers["walk"]["forward"]["step_of_peaks"].value == pytest.approx(2.5e-6, rel=0.01)
    assert numbers["walk"]["forward"]["up"].value == pytest.approx(4e-6, rel=0.02)
    assert numbers["walk"]["forward"]["down"].value == pytest.approx(1.5e-6, rel=0.03)
    assert "throughout" in numbers["flat"]["none"]
    section = features_section(features)
    assert section.points[0].startswith("end_effector_position")
    assert section.tables[0].rows[0][:3] == ("walk", "forward", 8)
