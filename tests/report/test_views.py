"""Views of results: each type of result gives one document, on paper, in a notebook and in a terminal."""

from __future__ import annotations

import html
import json
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.control import tune
from stickslip.design import waveform_front
from stickslip.design.optimised import motion_by
from stickslip.estimate import Fit
from stickslip.identify import identify_conditions
from stickslip.identify.frequency.response import frequency_response
from stickslip.report import Document, Number, document_of, write_report
from stickslip.report.figures.plotting import DRAWN


@dataclass
class Wear:
    """Something that the package does not know."""

    depth: float


@pytest.fixture(scope="module")
def model() -> ss.Actuator:
    return ss.load_actuator("kang2007")


def walked(model: ss.Actuator, seed: int, amplitude: float = 65.0) -> xr.Dataset:
    """A simulated walk with 3 nm of noise."""
    drive = ss.Sawtooth(amplitude=amplitude, frequency=20.0)
    made = ss.simulate(model, drive, duration=0.2, sample_rate=5e3)
    noise = 3e-9 * np.random.default_rng(seed).standard_normal(made.sizes["time"])
    position = made["end_effector_position"]
    changed = (position + noise).assign_attrs(position.attrs)
    return made.assign(end_effector_position=changed).assign_attrs(voltage=amplitude, title=f"walk {seed}")


@pytest.fixture(scope="module")
def fit(model: ss.Actuator) -> Fit:
    return ss.identify_friction([walked(model, 1)], model, ["sigma_0", "coulomb_force"])


def checked(document: Document, folder: Path) -> dict:
    """The document, written and read again; its text and its page show all of its tables and pictures."""
    page = html.unescape(write_report(document, folder).read_text("utf-8")).replace("\u00a0%", " %")
    text, cell = str(document), document._repr_html_()
    for table in document.tables():
        assert table.caption in text
        assert table.caption in page
    for picture in document.pictures():
        assert picture.caption in text
        assert (folder / "figures" / f"{picture.name}.svg").is_file()
    assert cell.startswith("<iframe srcdoc=")
    assert document.title in html.unescape(cell)
    assert "results.json beside this file" in page
    assert "beside this file" not in cell  # of a notebook
    return json.loads((folder / "results.json").read_text("utf-8"))


def test_a_fit_is_shown_with_its_parameters_and_its_recordings(fit: Fit, tmp_path: Path) -> None:
    document = ss.view(fit, "Walk on the bench")
    written = checked(document, tmp_path)
    assert written["title"] == "Walk on the bench"
    for name, value in fit.values.items():
        assert written["numbers"]["parameters"][name]["value"] == value
        assert name in str(document)
    assert written["numbers"]["model"]["friction"]["sigma_0"]["value"] == fit.values["sigma_0"]
    assert [picture.name for picture in document.pictures()] == ["fit"]


def test_the_text_of_a_table_has_units_and_columns_that_line_up(fit: Fit) -> None:
    lines = str(ss.view(fit)).splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("recording"))
    assert re.match(r"recording\s+r²\s+rms error \[[pnµ]m\]$", lines[head])
    assert lines[head + 1].startswith("walk 1")
    assert len(lines[head + 1]) == len(lines[head])  # numbers end where their heads end


def test_a_verification_says_how_far_off_it_is(fit: Fit, model: ss.Actuator, tmp_path: Path) -> None:
    seen = ss.verify(fit, [walked(model, 2)])
    written = checked(ss.view(seen), tmp_path)
    assert written["numbers"]["verification"]["walk 2"]["rmse"]["value"] == pytest.approx(seen.rmse)
    of_force = ss.view(replace(seen, observed="friction_force", unit="N"))
    assert of_force.pictures()[0].caption == "walk 2: friction force, measured and predicted."


def test_a_step_map_says_where_the_walk_is_fastest(model: ss.Actuator, tmp_path: Path) -> None:
    found = ss.step_map(model, voltage=[40.0, 80.0], frequency=[10.0, 60.0])
    document = ss.view(found)
    checked(document, tmp_path)
    assert "voltage 80 V, frequency 60 Hz" in document.summary
    fastest = dict(document.highlights)["fastest walk"]
    assert fastest == Number(float(np.abs(found["speed"]).max()), "m/s")


def test_a_map_of_more_lines_than_colours_says_how_to_draw_it(model: ss.Actuator, tmp_path: Path) -> None:
    masses = {"end_effector_mass": [0.08, 0.1], "rise_fraction": [0.9, 1.0]}
    found = ss.step_map(model, voltage=[40.0, 80.0], frequency=[10.0, 60.0], parameters=masses)
    document = ss.view(found)
    checked(document, tmp_path)
    assert not document.pictures()
    assert document.summary.startswith("16 of 16 points have a steady step.")
    said = "Net step per period is not drawn: a picture of 8 lines is too many: choose with map.sel("
    assert said in str(document)
    assert said in (tmp_path / "report.html").read_text("utf-8")
    drawn = ss.view(found.isel(rise_fraction=1, end_effector_mass=0))
    assert [one.name for one in drawn.pictures()][:2] == ["map-net-step", "map-speed"]


def datasets(model: ss.Actuator) -> dict[str, xr.Dataset]:
    """A small dataset of each kind that `plot` draws, by the dimension that it is drawn over."""
    drive, noise = ss.Sawtooth(65.0, 20.0), np.random.default_rng(0).standard_normal(256)
    plan = ss.plan_experiment(
        model, {"a": drive}, free=["sigma_1"], noise="20 nm", duration=0.1, recordings=1
    )
    sheet = ss.from_data_sheet(step="10 um", stroke="17.4 um", max_voltage=150, resonance=525.7, draws=100)
    return {
        "time": walked(model, 3),
        "frequency": frequency_response(noise, 1e-7 * noise, 1e3),
        "member": ss.steady_steps(model, drive, parameters={"sigma_1": [10.0, 30.0]}),
        "candidate": plan.dataset,
        "quantity": sheet.dataset,
        "phase": motion_by(model, {"optimised": drive, "sawtooth": drive}),
    }


def test_every_dataset_that_is_drawn_has_a_view(model: ss.Actuator, tmp_path: Path) -> None:
    made = datasets(model)
    assert made.keys() == DRAWN.keys()
    for over, data in made.items():
        written = checked(ss.view(data), tmp_path / over)
        assert written["title"] == data.attrs.get("title", DRAWN[over].title)
        assert written["summary"].startswith(f"{data.sizes[over]} values over {over}: ")
        assert not {"value", "low", "stated", "predicted"} & written["numbers"].keys()  # of several units


def test_recordings_and_responses_are_shown_with_their_ranges(model: ss.Actuator, tmp_path: Path) -> None:
    walk = walked(model, 3)
    written = checked(ss.view(walk), tmp_path)
    assert written["title"] == "walk 3"
    largest = written["numbers"]["end_effector_position"]["largest"]
    assert largest == {"value": float(walk["end_effector_position"].max()), "unit": "m"}
    renamed = checked(ss.view(walk.rename(end_effector_position="value")), tmp_path / "renamed")
    assert renamed["numbers"]["value"]["largest"] == largest


def test_conditions_and_searches_have_views(model: ss.Actuator, tmp_path: Path) -> None:
    walks = [walked(model, 4), walked(model, 5, amplitude=80.0)]
    under = identify_conditions(walks, model, ["coulomb_force"], "voltage")
    written = checked(ss.view(under), tmp_path / "conditions")
    assert written["numbers"]["by_condition"]["conditions"]["condition_2"]["voltage"]["value"] == 80.0
    front = waveform_front(model, goals=("speed", "ripple"), max_voltage=100.0, points=6, generations=3)
    assert checked(ss.view(front), tmp_path / "front")["numbers"]["evaluations"]["value"] == front.evaluations


def test_a_tuning_says_which_margins_it_keeps(model: ss.Actuator, tmp_path: Path) -> None:
    found = tune(model, 20e3)
    written = checked(ss.view(found), tmp_path)
    assert written["numbers"]["gain_margin"]["value"] == found.margins.gain_margin
    assert found.margins.report() in str(ss.view(found))


def test_what_has_no_view_is_refused_with_what_has_one() -> None:
    with pytest.raises(ss.QuantityError, match=r"no view of dict: .*Fit.*Verification"):
        ss.view({"sigma_0": 1.0})


def test_a_type_of_ones_own_gets_a_view() -> None:
    @document_of.register
    def _(wear: Wear) -> Document:
        return Document("Wear", "Worn.", (), numbers={"depth": Number(wear.depth, "m")})

    assert ss.view(Wear(2e-6), "After a week").title == "After a week"
    assert math.isclose(ss.view(Wear(2e-6)).numbers["depth"].value, 2e-6)
