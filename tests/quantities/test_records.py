"""Records of quantities: checked at construction, frozen, equal only to their like."""

from __future__ import annotations

import copy
import importlib
import inspect
import math
import operator
import pickle
import pkgutil
from collections.abc import Iterator
from contextlib import suppress
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import stickslip
from stickslip.friction import Dahl, LuGre, MaxwellSlip
from stickslip.quantities.records import Quantity, did_you_mean, quantities, record, sequences
from stickslip.quantities.units import QuantityError


@record
class Beam(NamedTuple):
    """A beam, for these tests."""

    mass: Annotated[float, Quantity("kg", "m", "mass", above=0)]
    stiffness: Annotated[float, Quantity("N/m", "k", "stiffness", minimum=0)]
    share: Annotated[float, Quantity("", "s", "share of it", minimum=0, below=1)] = 0.5
    limit: Annotated[float, Quantity("V", "u", "limit", minimum=-math.inf, maximum=math.inf)] = math.inf
    load: Annotated[float | None, Quantity("N", "F", "load")] = None
    modes: Annotated[tuple[float, ...], Quantity("rad/s", "ω", "frequency of each mode", above=0)] = ()
    label: str = ""

    def _check(self) -> None:
        if self.load is not None and self.load > self.stiffness:
            raise QuantityError("Beam.load is too large for its stiffness")


@record
class Plank(NamedTuple):
    """Other fields, other type, the same values possible."""

    weight: Annotated[float, Quantity("kg", "m", "mass", above=0)]
    hardness: Annotated[float, Quantity("N/m", "k", "stiffness", minimum=0)]


@record
class Bridge(NamedTuple):
    """A record of records."""

    beam: Beam
    plank: Plank | None = None
    open: bool = True
    name: str = ""


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"beam": 5}, "Bridge.beam = 5 must be Beam"),
        ({"beam": Plank(1.0, 2.0)}, r"Bridge.beam = Plank\(.*\) must be Beam"),
        ({"plank": (1.0, 2.0)}, r"Bridge.plank = \(1.0, 2.0\) must be Plank or None"),
        ({"open": 1}, "Bridge.open = 1 must be True or False"),
        ({"name": None}, "Bridge.name = None must be a text"),
    ],
)
def test_what_is_no_quantity_is_of_its_kind(wrong: dict[str, object], said: str) -> None:
    right = Bridge(Beam(1.0, 2.0), Plank(1.0, 2.0), open=False, name="a")
    with pytest.raises(QuantityError, match=said):
        right._replace(**wrong)


def test_strings_become_si_and_tuples_stay_tuples() -> None:
    beam = Beam("98.2 g", "1.399 N/um", share="25 %", load="1 mN", modes=["1 kHz", 5.0], label="a")  # type: ignore[arg-type]
    assert beam == Beam(0.0982, 1.399e6, 0.25, math.inf, 1e-3, (2000 * math.pi, 5.0), "a")
    assert all(type(value) is float for value in (*beam[:5], *beam.modes))
    assert Beam(1, 2, modes=np.array([3, 4])).modes == (3.0, 4.0)  # type: ignore[arg-type]
    assert Beam(1, 2).load is None


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("mass", -1, "-1 kg is out of range: mass must be > 0 kg"),
        ("mass", 0, "0 kg is out of range: mass must be > 0 kg"),
        ("mass", "-5 g", "'-5 g' is out of range: mass must be > 0 kg"),
        ("mass", "65 A", "'65 A' has the unit 'A', which is no kg (expected kg): mass must be > 0 kg"),
        ("mass", math.nan, "nan kg is not finite: mass must be > 0 kg"),
        ("mass", "nan kg", "is not finite: mass must be > 0 kg"),
        ("mass", math.inf, "inf kg is not finite: mass must be > 0 kg"),
        ("mass", True, "is not a number (expected kg): mass must be > 0 kg"),
        ("mass", None, "is not a number (expected kg): mass must be > 0 kg"),
        ("mass", "", "does not start with a number (expected kg): mass must be > 0 kg"),
        ("mass", "heavy", "does not start with a number (expected kg): mass must be > 0 kg"),
        ("mass", 10**400, "too large for a number (expected kg): mass must be > 0 kg"),
        ("mass", (1.0, 2.0), "is not a number (expected kg): mass must be > 0 kg"),
        ("stiffness", -1e-9, "stiffness must be >= 0 N/m"),
        ("share", 1, "share of it must be >= 0 and < 1"),
        ("limit", math.nan, "limit must be a finite number in V"),
        ("load", math.inf, "load must be a finite number in N"),
        ("load", -math.inf, "load must be a finite number in N"),
        ("modes", 3.0, "must be a list, each value > 0 rad/s"),
        ("modes", "3 Hz", "must be a list, each value > 0 rad/s"),
        ("modes", None, "must be a list, each value > 0 rad/s"),
        ("modes", [1.0, -1.0], "[1] = -1 rad/s is out of range: frequency of each mode must be > 0 rad/s"),
        ("modes", [[1.0]], "[0] = [1.0] is not a number"),
    ],
)
def test_refuses(field: str, value: object, says: str) -> None:
    good = Beam(1.0, 2.0)
    for attempt in (
        lambda: Beam(**{"mass": 1.0, "stiffness": 2.0, field: value}),  # type: ignore[arg-type]
        lambda: good._replace(**{field: value}),
    ):
        with pytest.raises(QuantityError) as caught:
            attempt()
        assert str(caught.value).startswith(f"Beam.{field}")
        assert says in str(caught.value)


def test_infinity_only_where_it_is_the_limit() -> None:
    assert Beam(1, 2, limit=-math.inf).limit == -math.inf
    one_sided = Quantity("V", "u", "upper", above=0, maximum=math.inf)
    assert one_sided.check("inf V", "u") == math.inf
    with pytest.raises(QuantityError, match="must be > 0 V"):
        one_sided.check(-math.inf, "u")


def test_arguments() -> None:
    with pytest.raises(QuantityError, match=r"Beam\.stiffness is missing \(stiffness, >= 0 N/m\)"):
        Beam(1.0)  # type: ignore[call-arg]
    with pytest.raises(
        QuantityError, match=r"Beam has no field 'stifness' \(did you mean 'stiffness'\?\); it has mass, "
    ):
        Beam(1.0, stifness=2.0)  # type: ignore[call-arg]
    with pytest.raises(QuantityError, match=r"Beam\.mass is given twice"):
        Beam(1.0, 2.0, mass=1.0)  # type: ignore[misc]
    with pytest.raises(QuantityError, match=r"Beam has 7 fields \(mass, .*\), 8 values were given"):
        Beam(*range(1, 9))  # type: ignore[call-arg]
    with pytest.raises(QuantityError, match=r"Beam has no field 'sigma_0'; it has"):
        Beam(1.0, 2.0)._replace(sigma_0=1.0)


def test_the_record_as_a_whole_is_checked() -> None:
    with pytest.raises(QuantityError, match="too large"):
        Beam(1, 2, load=3)
    with pytest.raises(QuantityError, match="too large"):
        Beam(1, 2, load=1)._replace(stiffness=0.5)
    with pytest.raises(QuantityError, match="must be > 0 kg"):
        Beam._make([-1.0, 2.0, 0.5, 0.0, None, (), ""])


def test_equal_only_to_its_like() -> None:
    beam, plank = Beam(1, 2), Plank(1, 2)
    short = Plank(1.0, 2.0)
    assert plank == short
    assert not operator.ne(plank, short)
    assert hash(plank) == hash(short)
    assert {beam, Beam(1, 2), plank, short} == {beam, plank}
    for other in (beam, (1.0, 2.0), [1.0, 2.0], None, 1.0):
        assert plank != other
        assert not operator.eq(plank, other)
        assert other != plank
    dahl, lugre = Dahl(1e6, 0.5), LuGre(1e6, 0.5, 0.0, 0.5, 0.5)
    assert dahl != LuGre._make(lugre)
    assert lugre != tuple(lugre)


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r))])
@pytest.mark.parametrize(
    "made", [Beam(1, 2, modes=(3.0,)), MaxwellSlip((1e6, 2e6), (0.1, 0.2)), Dahl(1e6, 0.5)]
)
def test_copies_are_equal_and_of_the_same_type(made: object, duplicate: object) -> None:
    again = duplicate(made)  # type: ignore[operator]
    assert again == made
    assert type(again) is type(made)


def test_frozen() -> None:
    beam = Beam(1, 2)
    with pytest.raises(AttributeError):
        beam.mass = 2.0  # type: ignore[misc]
    with pytest.raises(AttributeError):
        beam.colour = "red"  # type: ignore[attr-defined]
    assert beam._replace(mass=3) == Beam(3, 2)
    assert beam == Beam(1, 2)


def test_what_tools_see() -> None:
    assert list(inspect.signature(Beam).parameters) == [
        "mass",
        "stiffness",
        "share",
        "limit",
        "load",
        "modes",
        "label",
    ]
    assert inspect.signature(Beam).parameters["share"].default == 0.5
    assert Beam.__doc__ == "A beam, for these tests."
    assert (Beam.__name__, Beam.__module__) == ("Beam", __name__)
    assert list(quantities(Beam)) == ["mass", "stiffness", "share", "limit", "load", "modes"]
    assert quantities(Beam)["mass"] == Quantity("kg", "m", "mass", above=0)
    assert did_you_mean("sigma0", ("sigma_0", "mass")) == " (did you mean 'sigma_0'?)"
    assert did_you_mean("xyz", ("sigma_0", "mass")) == ""


@given(st.floats())
def test_range_of_any_float(number: float) -> None:
    try:
        assert Quantity("", "s", "share", minimum=0, below=1).check(number, "s") == number
        assert 0 <= number < 1
    except QuantityError:
        assert not 0 <= number < 1


def every_record() -> Iterator[Any]:
    """The records with quantities of all modules of the package, but of those that are no Python."""
    for module in pkgutil.walk_packages(stickslip.__path__, "stickslip."):
        if not module.name.endswith(("__main__", "._engine")):
            for one in vars(importlib.import_module(module.name)).values():
                own = inspect.isclass(one) and one.__module__ == module.name and hasattr(one, "_fields")
                # What holds a recording is no record: its type is imported for type checkers only.
                with suppress(NameError):
                    if own and quantities(one):
                        yield one


def wrong_values(quantity: Quantity) -> Iterator[object]:
    """What a single value may not be: no number, another unit, not finite, and each bound passed."""
    yield from (math.nan, True, "much", "", [[1.0]], {}, 10**400, "3 cd", f"nan {quantity.unit}", 1j)
    for limit, allowed, way in (
        (quantity.minimum, True, -math.inf), (quantity.above, False, -math.inf),
        (quantity.maximum, True, math.inf), (quantity.below, False, math.inf),
    ):  # fmt: skip
        if limit is not None and math.isfinite(limit):
            wrong = np.nextafter(limit, way) if allowed else limit
            yield from (float(wrong), f"{float(wrong)!r} {quantity.unit}")
    for endless, limit in ((math.inf, quantity.maximum), (-math.inf, quantity.minimum)):
        if limit != endless:
            yield endless


def some_value(quantity: Quantity) -> float:
    return next(x for x in (1.0, 0.5, 2.0, 0.0, 10.0, 300.0, 1e-3, -1.0, 1e6) if quantity.allows(x))


def test_every_field_of_every_record_refuses_by_its_name() -> None:
    """Of bounds, units and kinds, each as the record itself says them."""
    accepted, records = [], list(every_record())
    assert len(records) > 75
    for one in records:
        known, several = quantities(one), sequences(one)
        good = {name: "V" if name == "unit" else None for name in one._fields}
        good |= {n: (some_value(q),) if n in several else some_value(q) for n, q in known.items()}
        for name, quantity in known.items():
            wrong = [[value] if name in several else value for value in wrong_values(quantity)]
            for value in [*wrong, *(["3", 3.0] if name in several else [[1.0, 2.0]])]:
                try:
                    one(**{**good, name: value})
                except QuantityError as error:
                    if not str(error).startswith(f"{one.__name__}.{name}"):
                        accepted.append(f"{one.__name__}.{name} = {value!r}: {error}")
                except Exception as error:
                    accepted.append(f"{one.__name__}.{name} = {value!r}: {error!r}")
                else:
                    accepted.append(f"{one.__name__}.{name} = {value!r} is accepted")
    assert not accepted, "\n".join(accepted)


def test_a_record_is_printed_with_units_and_represented_in_si() -> None:
    law = LuGre("1.4 N/um", 35.0, 0.0, "0.5 N", "0.5 N")
    assert str(law).startswith("LuGre(sigma_0=1.4 MN/m, sigma_1=35 N s/m")
    assert "sigma_0=1400000.0" in repr(law)
    turning = stickslip.load_actuator("kang2007").replace(
        rotary=True, gain="0.1 urad/V", end_effector_mass=8e-5
    )
    assert "sigma_0=1.399 MN m/rad" in str(turning)
    assert "(0 V, 5 V)" in str(stickslip.physics.piezo.PrandtlIshlinskii([0.0, 5.0], [0.9, 0.1]))
