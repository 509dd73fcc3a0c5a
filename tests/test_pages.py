"""The pages of docs/ whose code runs in the documentation: what they show is so."""

from __future__ import annotations

import inspect
import json
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from public_names import everything

from stickslip.identify.frequency.modal import modal_response
from stickslip.parameters.load import SetEntry
from stickslip.physics.actuator import load_actuator

DOCS = Path(__file__).resolve().parents[1] / "docs"
KANG = load_actuator("kang2007")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], dict[str, Any]]]:
    """Run the cells and programs of a page in order, some with less to do; the names that they leave."""
    monkeypatch.chdir(tmp_path)

    def of(name: str, smaller: Mapping[str, str] = MappingProxyType({})) -> dict[str, Any]:
        text = (DOCS / name).read_text(encoding="utf-8")
        for size, less in smaller.items():
            assert size in text
            text = text.replace(size, less)
        names: dict[str, Any] = {}
        for code in re.findall(r"```(?:\{code-cell\} ipython3|python)\n(.*?)```", text, re.DOTALL):
            exec(code, names)
        return names

    yield of
    plt.close("all")


def test_first_walk(run: Callable, capsys: pytest.CaptureFixture[str]) -> None:
    names = run("first-walk.md")
    assert 0.0 < names["walk"].attrs["error_estimate"] <= 1e-9
    steps = [float(text) for text in re.findall(r": ([\d.]+) um per period", capsys.readouterr().out)]
    assert len(steps) == 3
    assert steps == sorted(steps)
    assert steps[1] == pytest.approx(3.139, abs=1e-3)


def test_parameter_set(run: Callable, tmp_path: Path) -> None:
    text = (DOCS / "parameter-sets.md").read_text(encoding="utf-8")
    (toml,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "my_actuator.toml").write_text(toml, encoding="utf-8")
    actuator = run("parameter-sets.md")["actuator"]
    assert actuator.natural_frequency == pytest.approx(2.0 * np.pi * 540.0)
    assert actuator.friction.sigma_0 == 1.4e6
    assert set(actuator.assumptions) == {
        f"friction.{name}" for name in ("sigma_0", "sigma_1", "sigma_2", "stiction_force")
    }
    described = "".join(re.findall(r"^\| (.*?) \|", text, re.MULTILINE))
    assert set(re.findall(r"`(\w+)`", described)) == set(SetEntry._fields)


def test_verification(run: Callable) -> None:
    names = run("verify.md")
    verified, intervals = names["verified"], names["fit"].confidence_intervals()
    assert verified.statements == ()
    assert verified.table["net_step_error"].values.max() < 1e-3
    assert verified.rmse == pytest.approx(20e-9, rel=0.05)
    low, high = intervals["coulomb_force"]
    assert low < KANG.friction.coulomb_force < high
    assert names["curve"].max() < 0.5 * 20e-9 < names["samples"].min()
    assert names["samples"].min() == pytest.approx(1.96 * 20e-9, rel=0.05)
    text = (DOCS / "verify.md").read_text(encoding="utf-8")
    for figure in re.findall(r"`(\w+)`", text[text.index("| figure") : text.index("`verified.table`")]):
        assert figure in verified.table


def test_every_public_call_is_on_a_page() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("*.md")))
    named = set(re.findall(r"\w+", " ".join(re.findall(r"```.*?```|`[^`]+`", text, re.DOTALL))))
    calls = {name for name, one in everything().items() if inspect.isfunction(one)}
    assert len(calls) > 200
    assert not sorted(name for name in calls if name.split(".")[-1] not in named)


def test_every_name_of_the_package_on_a_page_exists() -> None:
    pages = [*DOCS.rglob("*.md"), DOCS.parent / "README.md"]
    found = set[str]()
    for page in pages:
        code = re.findall(r"```.*?```|`[^`\n]+`", page.read_text(encoding="utf-8"), re.DOTALL)
        found |= {name for one in code for name in re.findall(r"(?<![\w.])ss\.([a-z]\w*(?:\.\w+)*)", one)}
    assert len(found) > 100
    assert not sorted(name for name in found if not _exists(name))


def _exists(name: str) -> bool:
    """Return whether ``stickslip.NAME`` is a module or a member of one."""
    try:
        pkgutil.resolve_name(f"stickslip.{name}")
    except (AttributeError, ImportError):
        return False
    return True


def test_piezo(run: Callable, capsys: pytest.CaptureFixture[str]) -> None:
    names = run("piezo.md")
    assert "before it moves" in names["fit"].failures[0]
    assert names["fit"].rmse < 2e-3 * 16e-6
    assert names["left"].std() < 3e-8
    printed = re.findall(r"([\d.]+) (?:nm rms\n|um per)", capsys.readouterr().out)
    by_inverse, by_line, plain, bent, by_voltage, by_charge = map(float, printed)
    assert by_inverse < 0.1 * by_line
    assert bent < 0.9 * plain
    assert by_voltage < by_charge  # which has no hysteresis


def test_design(run: Callable) -> None:
    names = run("design.md")
    assert names["found"].net_step.max() == pytest.approx(12.8e-6, rel=0.1)
    assert names["found"].net_step.sel(voltage=64.0, frequency=5.0) == pytest.approx(3.1e-6, rel=0.05)
    assert names["both"].inequality.values[0] == pytest.approx(0.0, abs=1e-3)
    assert 0.3 < names["least"] < 20.0
    assert names["force"] == pytest.approx(0.160, abs=2e-3)
    assert 500.0 < names["highest"] < 600.0
    assert names["low"] < 3.14 < names["high"]
    assert names["table"].interpolation_error < 30e-9
    fast = names["fast"]
    assert np.all(fast.table["value"].values >= fast.table["sawtooth"].values)
    built = names["built"]
    assert built.value > 1.3 * built.given_value
    assert built.load * KANG.friction.coulomb_force >= 0.5


def test_plan(run: Callable) -> None:
    names = run("plan.md")
    assert names["plan"].table["narrower"].min() > 10.0
    assert len(names["recorded"]) == len(names["plan"].recordings)


def test_bench_to_drive(run: Callable, capsys: pytest.CaptureFixture[str]) -> None:
    smaller = {'drive, "0.4 s"': 'drive, "0.3 s"', "draws=8": "draws=2, budget=400"}
    names = run("bench-to-drive.md", smaller | {"noise=rest)": "noise=rest, hops=0)"})
    mine, values = names["mine"], names["fit"].values
    for name in names["free"]:
        truth = getattr(mine, name, getattr(mine.friction, name, None))
        assert values[name] == pytest.approx(truth, rel=1e-3)
    assert "does not explain" not in names["fit"].report()
    printed = capsys.readouterr().out
    narrower = [float(text) for text in re.findall(r"([\d.]+) times narrower", printed)]
    assert len(narrower) == 6
    assert min(narrower) > 1.2
    assert np.median(narrower) > 4.0
    table = names["fast"].table
    assert table["value"].min() > 1.5 * table["sawtooth"].min()
    pairs = re.findall(r"measured ([\d.]+) mm/s, predicted ([\d.]+)", printed)
    assert len(pairs) == 3
    for measured, predicted in pairs:
        assert float(measured) == pytest.approx(float(predicted), rel=2e-3)


def test_many_simulations(run: Callable) -> None:
    found = run("scaling.md")["found"]
    assert found.sizes["member"] == 10_000
    assert np.ptp(found["net_displacement"].values) > 1e-6


def test_study(run: Callable) -> None:
    steps = run("studies.md", {"members=256": "members=16"})["steps"]
    assert np.all(np.diff(steps.net_step.mean("member").values) > 0.5e-6)


def test_python_control(run: Callable) -> None:
    names = run("bridges/python-control.md")
    assert names["transfer"](0.0).real == pytest.approx(KANG.gain, rel=1e-3)
    assert names["stage"].values["natural_frequency"] == pytest.approx(KANG.natural_frequency, rel=0.02)
    modal, s = names["modal"], 2j * np.pi * np.array([50.0, 500.0])
    assert modal.natural_frequency[0] == pytest.approx(KANG.natural_frequency, rel=1e-3)
    np.testing.assert_allclose(
        names["system"](s).ravel(), modal_response(modal, s.imag / (2 * np.pi)).ravel(), rtol=1e-3
    )


def test_pandas(run: Callable) -> None:
    names = run("bridges/pandas.md")
    assert set(names["intervals"].index) >= {"gain", "natural_frequency", "damping_ratio"}
    assert len(names["table"]) == 3


def test_scipy(run: Callable) -> None:
    names = run("bridges/scipy.md")
    assert np.abs(names["smooth"].end_effector_position - names["position"]).max() < 1e-6
    assert np.abs(names["difference"]).max() < 0.01 * 60.0 * KANG.gain


def test_jupyter(run: Callable) -> None:
    assert run("bridges/jupyter.md")["widget"].frame


def test_fmpy(run: Callable) -> None:
    found = run("bridges/fmpy.md")["difference"]
    assert np.abs(found).max() < 0.004 * 8 * KANG.gain * 65.0


ACCURACY = (DOCS / "accuracy.md").read_text(encoding="utf-8")


def test_every_claim_of_accuracy_links_to_what_shows_it() -> None:
    rows = [
        line for line in ACCURACY.splitlines() if line.startswith("| ") and not line.startswith("| claim")
    ]
    assert len(rows) >= 15
    for row in rows:
        claim, measured, conditions, shown = (cell.strip() for cell in row.strip("| ").split(" | "))
        assert claim
        assert measured
        assert conditions
        assert "](" in shown or shown == "the same", row
    for target in re.findall(r"\]\(([^)#]+)", ACCURACY):
        assert (DOCS / target).is_file(), target


def test_figures_of_accuracy_are_those_that_were_measured() -> None:
    folder = DOCS / "benchmarks"
    random = (folder / "random-actuators.md").read_text(encoding="utf-8")
    found = re.search(r"\| all \| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", random)
    assert found
    count, median, most, worst = found.groups()
    assert f"error {median} nm (median), below {float(most):.2f} nm for 99 %" in ACCURACY
    assert f"of {int(count):,} | random actuators" in ACCURACY
    assert f"The worst, {float(worst):.1f} nm" in ACCURACY
    found = re.search(rf"for ([\d.]+) % of {count}, more than 3 times too small for ([\d.]+) %", random)
    assert found
    assert f"within a factor of 3 for {found[1]} %, more than 3 times too small for {found[2]} %" in ACCURACY
    orbits = (folder / "random-orbits.md").read_text(encoding="utf-8")
    cells = re.search(r"^\| all \| (.+) \|$", orbits, re.MULTILINE)
    assert cells
    known, found_ones, middle, most, _, above, _ = cells[1].split(" | ")
    assert f"{found_ones} of {known} found, {middle} tolerances (median), below {most} for 99 %" in ACCURACY
    assert f"for 99 %, above 3 for {above} |" in ACCURACY
    coverage = (folder / "coverage.md").read_text(encoding="utf-8")
    for name in ("ζ", "ω_n", "gain", "F_C", "σ₀", "σ₁"):
        share = re.search(rf"^\| {name} \| ([\d.]+ %)", coverage, re.MULTILINE)
        assert share
        assert f"{share[1]} ({name})" in ACCURACY
    lack = json.loads((folder / "lack-of-fit.json").read_text(encoding="utf-8"))
    right = lack.pop("LuGre")
    wrong = {key: sum(law[key] for law in lack.values()) for key in right}
    assert f"{wrong['noticed_of_visible']} of {wrong['visible']} where it leaves more" in ACCURACY
    assert f"{wrong['noticed']} of {wrong['campaigns']} of all" in ACCURACY
    curved = lack["Stribeck"]
    hidden = curved["noticed"] - curved["noticed_of_visible"], curved["campaigns"] - curved["visible"]
    assert "| {} of {} noticed |".format(*hidden) in ACCURACY
    assert f"{right['noticed']} of {right['campaigns']} reported" in ACCURACY
    page = (folder / "README.md").read_text(encoding="utf-8")
    second = re.search(r"200 actuators .* worst ([\d.]+)\.$", page, re.MULTILINE)
    assert second
    assert f"worst of 200: {second[1]} nm" in ACCURACY
    members = re.search(r"has errors of ([\d.]+ nm \(median\), [\d.]+ nm at most)\.", page)
    assert members
    assert members[1] in ACCURACY
    assert "2,392 of 2,392 trials" in ACCURACY
    assert "Failures in 2,392 trials" in (folder / "faults.md").read_text(encoding="utf-8")


def test_control(run: Callable, capsys: pytest.CaptureFixture[str]) -> None:
    names = run("control.md")
    printed = capsys.readouterr().out
    assert "gains refused, over 3 models" in printed
    assert names["tuning"].margins.sensitivity <= 1.7
    assert [phase for phase, _ in names["simulated"].history] == [
        *("rest", "return", "step", "wait", "scan", "hold")
    ]
    assert names["ended"].rms < 1e-9
    assert not np.isnan(names["ended"].times).any()


def test_extended_control(run: Callable, capsys: pytest.CaptureFixture[str]) -> None:
    names = run("control-more.md")
    printed = capsys.readouterr().out
    assert names["left"]["inverse"] < 0.003 * 5e-6 < names["left"]["gain"]
    bands = [(float(a), float(b)) for a, b in re.findall(r"([\d.]+) to ([\d.]+) um", printed)]
    assert bands[0][0] < 151.2 < bands[0][1]
    assert bands[1][1] - bands[1][0] < 0.5 * (bands[0][1] - bands[0][0])
    assert "the same to the bit: True" in printed
    (missing,) = re.findall(r"([-\d.]+) nm are missing", printed)
    assert abs(float(missing)) < 1.0
