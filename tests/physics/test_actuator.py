"""The actuator and the pulled slider as records: fields, derived values, loading, credit."""

from __future__ import annotations

import math
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.friction import Coulomb, Dahl, LuGre
from stickslip.parameters import references
from stickslip.physics.actuator import Actuator, PulledSlider, load_actuator
from stickslip.quantities.units import QuantityError

LUGRE = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401, 1e-3)
THESIS = Actuator(
    gain=0.1057e-6,
    natural_frequency=3303.1,
    damping_ratio=0.524,
    stage_mass=0.0998,
    end_effector_mass=0.1,
    friction=LUGRE,
)
STATIC = THESIS.replace(natural_frequency=math.inf)
SLIDER = PulledSlider(0.0307, 168.0, 0.0, Coulomb(0.1))


def test_the_thesis_actuator() -> None:
    loaded = load_actuator("kang2007")
    assert loaded == THESIS.replace(min_voltage=0, max_voltage=150, name="kang2007")
    assert loaded.stage_reaction is True
    assert loaded.clamped is False


def test_replace_as_a_user_does() -> None:
    changed = load_actuator("kang2007").replace(
        gain=0.1057e-6,
        natural_frequency=3303.1,
        damping_ratio=0.524,
        stage_reaction=False,
        end_effector_mass="100 g",
        friction=LUGRE._replace(sigma_0="1.399 N/um"),
    )
    assert type(changed) is Actuator
    assert changed == load_actuator("kang2007")._replace(stage_reaction=False)
    assert pickle.loads(pickle.dumps(changed)) == changed
    assert {changed: 1}[changed] == 1
    assert changed != load_actuator("changli1999")


def test_every_shipped_actuator() -> None:
    for name in ("kang2007", "changli1999", "pohl1987"):
        loaded = load_actuator(name)
        assert loaded.name == name
        assert loaded.static == (name == "pohl1987")
        assert 0 <= loaded.min_voltage < loaded.max_voltage


def test_derived_values() -> None:
    # Of y'' + (c/m) y' + (k/m) y = (T/m) u the poles and the gain at rest are what zeta, omega_n and C say.
    m, c, k = THESIS.stage_mass, THESIS.stage_damping, THESIS.stage_stiffness
    poles = np.linalg.eigvals(np.array([[0.0, 1.0], [-k / m, -c / m]]))
    expected = 3303.1 * (-0.524 + 1j * math.sqrt(1 - 0.524**2))
    assert sorted(poles, key=np.imag)[1] == pytest.approx(expected, rel=1e-12)
    assert THESIS.drive_force_per_volt / k == pytest.approx(0.1057e-6, rel=1e-14)


def test_a_static_stage_needs_its_own_force_constant() -> None:
    assert STATIC.static
    assert STATIC.stage_stiffness == STATIC.stage_damping == math.inf
    with pytest.raises(QuantityError, match=r"blocked_force_per_volt \[N/V\]"):
        _ = STATIC.drive_force_per_volt
    assert STATIC.replace(blocked_force_per_volt="20 mN/V").drive_force_per_volt == 0.02
    with pytest.raises(QuantityError, match=r"blocked_force_per_volt \[N/V\] is for a static stage"):
        THESIS.replace(blocked_force_per_volt=0.1)
    assert STATIC.replace(damping_ratio=0).stage_damping == math.inf


@pytest.mark.parametrize(
    ("incline", "expected"),
    [
        (0.0, 0.25),
        ("90 deg", 0.25 - 0.980665),  # +x points up, the weight pulls back
        (-math.pi / 2, 0.25 + 0.980665),
        ("30 deg", 0.25 - 0.980665 / 2),
    ],
)
def test_axial_force(incline: Any, expected: float) -> None:
    tilted = THESIS.replace(incline=incline, external_force=0.25)
    assert tilted.axial_force == pytest.approx(expected, rel=1e-14)


def test_from_parts() -> None:
    parts: dict[str, Any] = {
        "piezo_mass": "4 g",
        "stage_mass": 0.0982,
        "piezo_stiffness": "1 N/um",
        "stage_stiffness": 8.9e4,
        "piezo_damping": 300.0,
        "stage_damping": 45.0,
        "force_per_volt": 0.115,
    }
    made = Actuator.from_parts(**parts, end_effector_mass=0.1, friction=LUGRE, clamped=True)
    assert made.stage_mass == pytest.approx(0.0982 + 4 * 0.004 / math.pi**2, rel=1e-14)
    assert made.stage_stiffness == pytest.approx(1.089e6, rel=1e-12)
    assert made.stage_damping == pytest.approx(345.0, rel=1e-12)
    assert made.drive_force_per_volt == pytest.approx(0.115, rel=1e-12)
    assert made.clamped
    # The same numbers as the thesis identified, for these parts were made up from its c, k and T.
    assert made.natural_frequency == pytest.approx(3303.1, rel=1e-3)
    assert made.damping_ratio == pytest.approx(0.524, rel=2e-3)
    with pytest.raises(QuantityError, match=r"Actuator\.friction is missing"):
        Actuator.from_parts(**parts, end_effector_mass=0.1)


def test_wrong_values() -> None:
    """Beside the bounds of single fields."""
    for field, value, says in (
        *(
            ("friction", one, "must be a law with its values: Coulomb, ")
            for one in (LuGre, "LuGre", None, THESIS)
        ),
        ("stage_reaction", 1, "must be True or False"),
        ("name", 3, "must be a text"),
        ("sigma_0", 1.0, "Actuator has no field 'sigma_0'"),
    ):
        for model in (THESIS, SLIDER) if field in ("friction", "name") else (THESIS,):
            with pytest.raises(QuantityError, match=re.escape(says)) as caught:
                model.replace(**{field: value})
            assert field in str(caught.value)


def test_voltage_range() -> None:
    with pytest.raises(
        QuantityError, match=r"min_voltage = 150 V is out of range: it must be < max_voltage = 150 V"
    ):
        THESIS.replace(min_voltage=150, max_voltage=150)
    assert THESIS.min_voltage == -math.inf
    assert THESIS.max_voltage == math.inf


def test_pulled_slider() -> None:
    made = PulledSlider("30.7 g", 168, 0, Coulomb("100 mN"))  # type: ignore[arg-type]
    assert made == SLIDER
    assert made.replace(mass=1.0).mass == 1.0
    assert made.citation_keys == ("coulomb1785", "olsson1998", "kang2007")


def test_citation_of_a_loaded_actuator() -> None:
    loaded = load_actuator("kang2007")
    text = loaded.citation
    assert loaded.citation_keys == ("kang2007", "canudas1995")
    assert text.startswith(f"{references()['kang2007']}\n\n{references()['canudas1995']}\n")
    remarks = text[text.index("% ") :]
    assert all(line.startswith("%") for line in remarks.splitlines())  # the whole can go into a .bib file
    assert "%   end_effector_mass = 0.1 kg: brass with a metal block" in remarks
    assert "natural_frequency" not in remarks
    assert "Changed" not in remarks
    assert loaded.assumptions.keys() == {"end_effector_mass", "min_voltage", "friction.stribeck_velocity"}


def test_citation_says_what_was_changed() -> None:
    loaded = load_actuator("kang2007")
    same = loaded.replace(gain=loaded.gain * (1 + 1e-15))
    assert "Changed" not in same.citation
    changed = loaded.replace(end_effector_mass=0.05, stage_reaction=False, gain="0.2 um/V")
    lines = changed.citation.splitlines()
    assert "%   gain = 200 nm/V (in the set: 105.7 nm/V)" in lines
    assert "%   stage_reaction = False (in the set: True)" in lines
    assert "%   end_effector_mass = 0.05 kg (in the set: 0.1 kg)" in lines
    assert "end_effector_mass" not in changed.assumptions  # no longer the set's
    other = loaded.replace(friction=Dahl(1.399e6, 0.5401))
    lines = other.citation.splitlines()
    assert references()["dahl1976"].splitlines()[0] in lines
    assert "%   friction = Dahl (in the set: LuGre)" in lines
    assert "%   friction.exponent = 1 (in the set: none)" in lines
    assert not [line for line in lines if line.startswith("%   friction.sigma_0")]  # as before
    assert "friction.stribeck_velocity" not in other.assumptions


def test_citation_without_a_set(tmp_path: Path) -> None:
    assert THESIS.assumptions == {}
    assert THESIS.citation_keys == ("kang2007", "canudas1995")  # the model and the law
    assert THESIS.citation.endswith("% The values are of no parameter set.")
    gone = THESIS.replace(name=str(tmp_path / "gone.toml"))
    assert gone.citation.splitlines()[-1].startswith(
        "% The values are of no parameter set that can be read now"
    )
    assert gone.assumptions == {}
