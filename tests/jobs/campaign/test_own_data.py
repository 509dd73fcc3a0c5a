"""A report of a user's own data speaks of their actuator; that of the thesis's, of the thesis."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.report.origin import origin_of

# Some other actuator: nothing of it is that of a parameter set but for the equations.
MINE = ss.load_actuator("kang2007").replace(
    gain=0.06e-6,
    natural_frequency=5650.0,
    damping_ratio=0.2,
    stage_mass=0.0499,
    end_effector_mass=0.05,
    friction=ss.LuGre(0.9e6, 20.0, 0.0, 0.4, 0.4, 1e-3),
    name="",
)
# A law of their own, in a file beside the campaign's.
MY_LAW = """
from typing import Annotated, NamedTuple

from stickslip.friction import register_law
from stickslip.quantities.records import Quantity, record


@record
class MyDahl(NamedTuple):
    sigma_0: Annotated[float, Quantity("N/m", "σ₀", "bristle stiffness", above=0)]
    coulomb_force: Annotated[float, Quantity("N", "F_C", "Coulomb friction", above=0)]


def my_dahl(law, v, z):
    return law.sigma_0 * z, v - law.sigma_0 * abs(v) / law.coulomb_force * z


register_law(MyDahl, my_dahl)
"""
OWN = {
    "law": "my_law.py:MyDahl",
    "fields": {"sigma_0": "1 N/um", "coulomb_force": "0.5 N"},
    "free": ["sigma_0", "coulomb_force"],
}
TAKEN = "end_effector_mass = 0.1 kg: taken over from the parameter set kang2007, which is of another actuator"


def table(path: Path, model: ss.Actuator, drive: Any, length: float, seed: int) -> Path:
    """A recording as a table, after 50 ms of rest, with noise."""
    shown = ss.simulate(
        model, ss.waveform.Sequence(ss.waveform.Rest(0.05), (drive, length)), 0.05 + length, sample_rate=10e3
    )
    noise = 20e-9 * np.random.default_rng(seed).standard_normal(shown["time"].size)
    moved = shown["end_effector_position"] + noise
    columns = np.column_stack([1e3 * shown["time"], shown["drive_voltage"], 1e6 * moved])
    np.savetxt(path, columns, "%.9g", ",", header="time [ms],drive [V],position [um]", comments="")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a campaign of three tables as `new` writes it, and what it found."""
    made = tmp_path_factory.mktemp("own")
    files = [
        table(made / "clamped.csv", MINE.replace(clamped=True), ss.Step(50.0), 0.1, 1),
        table(made / "slow.csv", MINE, ss.Sawtooth(80.0, 10.0, periods=4), 0.45, 2),
        table(made / "fast.csv", MINE, ss.Sawtooth(60.0, 20.0, periods=4), 0.25, 3),
    ]
    run("new", "campaign", *files, "--out", made / "campaign.yaml")
    file = yaml.safe_load((made / "campaign.yaml").read_text("utf-8"))
    (made / "my_law.py").write_text(MY_LAW, "utf-8")
    file |= {"profiles": True, "model_choice": ["LuGre", OWN]}
    (made / "campaign.yaml").write_text(yaml.safe_dump(file), "utf-8")
    run("campaign", made / "campaign.yaml", "--out", made / "out")
    return made


def run(*arguments: object) -> Any:
    done = CliRunner().invoke(app, [str(one) for one in arguments], prog_name="stickslip")
    assert done.exit_code == 0, done.output
    return done


def text_of(out: Path) -> str:
    """All that a report says, but for the words of the program: styles, scripts, paths of pictures."""
    page = (out / "report.html").read_text("utf-8")
    page = re.sub(r"<(style|script).*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", page)))


@pytest.mark.usefixtures("no_term_is_tried")
@pytest.mark.filterwarnings("default")
def test_no_report_of_ones_own_data_speaks_of_another_actuator(folder: Path) -> None:
    run("new", "identification", folder / "slow.csv", folder / "fast.csv", "--out", folder / "walks.yaml")
    walks = yaml.safe_load((folder / "walks.yaml").read_text("utf-8"))
    (folder / "models.yaml").write_text(
        yaml.safe_dump(
            {key: walks[key] for key in ("title", "model", "change", "friction", "recordings")}
            | {"kind": "comparison", "laws": ["Pohl: static", OWN]}
        ),
        "utf-8",
    )
    file = folder / "walks.yaml"
    done = CliRunner().invoke(app, ["identify", str(file), "--out", str(folder / "walks")])
    assert (folder / "walks" / "results.json").is_file(), done.output
    done = CliRunner().invoke(app, ["run", str(folder / "models.yaml"), "--out", str(folder / "models")])
    assert (folder / "models" / "results.json").is_file(), done.output
    run("verify", folder / "out" / "results.json", folder / "fast.csv", "--out", folder / "verified")
    for out in ("out", "walks", "models", "verified"):
        said = text_of(folder / out)
        results = (folder / out / "results.json").read_text("utf-8")
        assert TAKEN in said
        assert TAKEN in results
        for words in ("thesis", "chapter", "fig. 5", "app. ", "brass", "Parameter set kang2007"):
            # The title of the source that a value is taken over from holds its kind of publication.
            found = said.replace("@mastersthesis{kang2007", "")
            assert words not in found, f"{out}: {words}"
            assert words not in results.replace("@mastersthesis{kang2007", ""), f"{out}: {words}"


def test_what_is_known_of_ones_own_actuator_is_taken_over_from_none(folder: Path) -> None:
    walk = ss.read_recording(folder / "slow.csv")
    model = MINE.replace(name="kang2007")
    free = ["sigma_0", "sigma_1", "sigma_2", "coulomb_force", "stiction_force"]
    origin = origin_of(model, [walk], free)
    assert origin.assumptions == []
    assert "kang" not in origin.citations
    assert "canudas1995" in origin.citations
    (said,) = origin_of(model.replace(gain=0.1057e-6), [walk], free).assumptions
    assert said.startswith("gain = 105.7 nm/V: taken over from the parameter set kang2007, ")


def test_a_law_of_ones_own_is_compared(folder: Path) -> None:
    results = json.loads((folder / "out" / "results.json").read_text("utf-8"))
    choice = results["numbers"]["model_choice"]
    assert set(choice) == {"LuGre", "MyDahl"}
    # It is Dahl's law, which lacks the damping that the actuator has.
    noise = 20e-9
    errors = {law: found["verification_rmse"]["value"] for law, found in choice.items()}
    assert 0.9 * noise < errors["LuGre"] < errors["MyDahl"]


def test_recordings_that_name_their_set_are_of_its_actuator() -> None:
    model = ss.load_actuator("kang2007")
    walk = ss.simulate(model, ss.Step(50.0), 0.01)
    assert "name='kang2007'" in walk.attrs["model"]
    origin = origin_of(model, [walk])
    assert origin.citations == model.citation
    assert len(origin.assumptions) == len(model.assumptions)
    assert len(origin_of(model, [walk], model.assumptions).assumptions) == 0


def test_two_measures_of_a_step_have_two_names(folder: Path) -> None:
    said = text_of(folder / "out")
    assert said.count("net step, measured") == 1
    assert said.count("step of the peaks [95 %]") == 1
    assert "net step [95 %]" not in said
    numbers = json.loads((folder / "out" / "results.json").read_text("utf-8"))["numbers"]
    peaks = numbers["features"]["slow"]["forward"]["step_of_peaks"]
    mean = numbers["verification"]["slow"]["net_step"]
    assert "net_step" not in numbers["features"]["slow"]["forward"]
    assert peaks["value"] == pytest.approx(mean["value"], rel=0.1)
    assert "published" not in said
