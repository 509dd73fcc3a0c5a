"""A user's own parameter file is read like a shipped set; mistakes are named with file, field and unit."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.friction import Coulomb, MaxwellSlip
from stickslip.parameters import ParameterSetError, load_friction, load_kind, load_set
from stickslip.physics.actuator import Actuator, PulledSlider, load_actuator, load_pulled_slider
from stickslip.quantities.units import QuantityError

GOOD = """
title = "Mine"
citations = ["kang2007"]
kind = "actuator"

[gain]
value = 0.1
unit = "um/V"
source = "data sheet"

[natural_frequency]
value = 500
unit = "Hz"

[damping_ratio]
value = 50
unit = "%"
assumed = true
reason = "a guess"

[stage_mass]
value = 98.2
unit = "g"

[end_effector_mass]
value = 0.1
unit = "kg"

[clamped]
value = true

[friction]
law = "Coulomb"

[friction.coulomb_force]
value = 540
unit = "mN"
"""


def written(folder: Path, text: str, name: str = "my.toml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_a_users_file(tmp_path: Path) -> None:
    file = written(tmp_path, GOOD)
    mine = load_actuator(file)
    assert mine == load_actuator(str(file))
    assert mine.natural_frequency == pytest.approx(2 * 3.141592653589793 * 500)
    assert mine.replace(natural_frequency=1.0) == Actuator(
        gain=1e-7,
        natural_frequency=1.0,
        damping_ratio=0.5,
        stage_mass=0.0982,
        end_effector_mass=0.1,
        friction=Coulomb(0.54),
        clamped=True,
        name=str(file),
    )
    assert mine.assumptions["damping_ratio"] == "0.5: a guess"
    assert mine.assumptions["stage_mass"] == "0.0982 kg: no source given"
    assert "gain" not in mine.assumptions
    assert "Parameter set " in mine.citation


def test_by_name_in_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, GOOD)
    written(tmp_path, GOOD, "kang2007.toml")
    assert load_actuator("my.toml").gain == 1e-7
    assert load_actuator("kang2007.toml").gain == 1e-7  # a file
    assert load_actuator("kang2007").gain == 0.1057e-6  # the shipped set
    with pytest.raises(
        ParameterSetError, match=r"no parameter set 'my'.*available are changli1999, .*kang2007, .*pohl1987"
    ):
        load_actuator("my")


MISTAKES = [
    ("value = 0.1\nunit = \"um/V\"", 'value = 0.1\nunit = "A"', ["Actuator.gain = '0.1 A'", "no m/V"]),
    ("value = 98.2", "value = -98.2", ["Actuator.stage_mass = '-98.2 g' is out of range", "must be > 0 kg"]),
    ("value = 98.2", f"value = 1{'0' * 9000}", ["line 22 has a number of more than 100 digits"]),
    ("value = 98.2", "value = [98.2]", ["Actuator.stage_mass", "is not a number"]),
    ("value = 98.2", "value = true", ["Actuator.stage_mass = True is not a number"]),
    ("value = 98.2", 'value = "98.2 g"', ["[stage_mass] value = '98.2 g' must be a number"]),
    ('value = 98.2\nunit = "g"', "value = 98.2", ["[stage_mass] has no unit (expected kg)", "> 0 kg"]),
    ('98.2\nunit = "g"', '98.2\nunit = "foo"', ["stage_mass", "unknown unit 'foo'", "> 0 kg"]),
    ('value = 98.2\nunit = "g"', "value = 98.2\nunit = 1", ["[stage_mass] unit = 1 must be a str"]),
    ('value = 98.2\nunit = "g"', 'unit = "g"', ["[stage_mass] has no value"]),
    ('98.2\nunit = "g"', '98.2\nunits = "g"', ["key units (did you mean 'unit'?"]),
    ("value = true", "value = 1", ["Actuator.clamped = 1 must be True or False"]),
    ("value = true", 'value = true\nunit = "V"', ["[clamped]", "takes no unit"]),
    ("[gain]", "[gian]", ["[gian] is unknown (did you mean 'gain'?); known are gain, natural_frequency"]),
    ("[gain]", "[friction.gain]", ["[friction]: [gain] is unknown", "known are coulomb_force"]),
    ("[clamped]", "[name]", ["[name] is unknown"]),
    ("[clamped]", "[gain]", ["no valid TOML", "line"]),
    ('title = "Mine"', 'title = "Mine"\ntitle = "Yours"', ["no valid TOML", "line 3"]),
    ('title = "Mine"', "", ["title is missing"]),
    ('title = "Mine"', 'titel = "Mine"', ["titel is unknown at the top (did you mean 'title'?)"]),
    ('title = "Mine"', "title = 1", ["title = 1 must be a str"]),
    ('title = "Mine"', 'title = "Mine"\nkindd = "x"', ["kindd is unknown at the top (did you mean 'kind'?)"]),
    ('["kang2007"]', "[1]", ["citations must be a list of citation keys"]),
    ('kind = "actuator"', 'kind = "motor"', ["kind = 'motor' must be one of actuator, pulled_slider, "]),
    ('kind = "actuator"', 'kind = "pulled_slider"', ["is of kind 'pulled_slider', not 'actuator'"]),
    ('kind = "actuator"', 'kind = "friction"', ["[gain] is unknown in a set of kind 'friction'"]),
    ('law = "Coulomb"', 'law = "Colomb"', ["law = 'Colomb': there is no", "(did you mean 'Coulomb'?"]),
    ('law = "Coulomb"', 'lw = "Coulomb"', ["[friction] lw is unknown (did you mean 'law'?)"]),
    ('law = "Coulomb"', "law = [1]", ["law = '[1]': there is no law '[1]'"]),
    ('law = "Coulomb"', "", ["law = '': there is no law ''"]),
    ('law = "Coulomb"', 'law = "LuGre"', ["LuGre.sigma_0 is missing (bristle stiffness, > 0 N/m)"]),
    ("value = 540", "value = -540", ["[friction]: Coulomb.coulomb_force = '-540 mN'", "must be >= 0 N"]),
    ("value = 540", "value = 540\nassumed = true", ["[friction.coulomb_force] is assumed but"]),
    ("value = 540", 'value = 540\nreason = "x"', ["gives a reason but is not marked assumed"]),
    ("value = 540", 'value = 540\nassumed = "no"', ["assumed = 'no' must be a bool"]),
    ('[friction.coulomb_force]\nvalue = 540\nunit = "mN"', "coulomb_force = 0.54", ["must be a table with"]),
    ("[friction]", "[fraction]", ["[friction] law = '': there is no law ''"]),
    ('[stage_mass]\nvalue = 98.2\nunit = "g"\n', "", ["Actuator.stage_mass is missing"]),
    (GOOD[GOOD.index("[friction]") :], "", ["[friction] is missing; its law is one of Coulomb, "]),
    ("value = 0.1\nunit = \"kg\"", "value = 0.1\nunit = \"kg", ["no valid TOML"]),
]  # fmt: skip


def test_mistakes(tmp_path: Path) -> None:
    for old, new, says in MISTAKES:
        assert GOOD.count(old) == 1
        file = written(tmp_path, GOOD.replace(old, new))
        with pytest.raises(ParameterSetError) as caught:
            load_actuator(file)
        message = str(caught.value)
        assert message.startswith(str(file))
        assert not [part for part in says if part not in message], message
        assert isinstance(caught.value, QuantityError)


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b'title = "\xb5"')
    (tmp_path / "zeros.toml").write_bytes(b"\x00" * 100)
    (tmp_path / "deep.toml").write_text("a = " + "[" * 20000)
    (tmp_path / "folder.toml").mkdir()
    for name in ("latin.toml", "zeros.toml", "deep.toml", "folder.toml", "none.toml", "no/such.toml"):
        with pytest.raises(ParameterSetError) as caught:
            load_set(tmp_path / name)
        assert str(caught.value).startswith(str(tmp_path / name))


@given(st.text(max_size=60))
def test_any_name_is_a_set_or_refused(name: str) -> None:
    if name not in ("changli1999", "kang2007", "pohl1987"):
        with pytest.raises(ParameterSetError):
            load_kind(name, "actuator")


def test_a_pulled_slider_and_a_law_of_its_own(tmp_path: Path) -> None:
    law = """
        [friction]
        law = "MaxwellSlip"
        stiffness = { value = [1, 0.5], unit = "N/um" }
        strength = { value = [0.2, 0.3], unit = "N" }
        """
    head = 'title = "T"\ncitations = []\n'
    slider = written(
        tmp_path,
        head
        + 'kind = "pulled_slider"\nmass = { value = 30.7, unit = "g" }\n'
        + 'spring_stiffness = { value = 168, unit = "N/m" }\ndamping = { value = 0, unit = "N s/m" }\n'
        + law,
        "slider.toml",
    )
    friction = MaxwellSlip((1e6, 0.5e6), (0.2, 0.3))
    assert load_pulled_slider(slider) == PulledSlider(0.0307, 168.0, 0.0, friction, name=str(slider))
    assert load_friction(slider) == friction
    assert load_friction(written(tmp_path, head + 'kind = "friction"\n' + law, "law.toml")) == friction
    with pytest.raises(ParameterSetError, match="is of kind 'pulled_slider', not 'actuator'"):
        load_actuator(slider)
