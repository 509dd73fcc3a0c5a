"""Limits and permits of a site: no experiment exceeds them, in a program and in the rig's process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stickslip.rig import (
    Capabilities,
    Capture,
    ControllerSpec,
    HostedRig,
    InterlockError,
    LimitError,
    Limits,
    Link,
    RigError,
    armed,
    interlock_of,
    measure,
    regulate,
)
from stickslip.rig.description import own_device, virtual_device
from stickslip.rig.site import site_of
from stickslip.waveform import Sawtooth, Step

from rig.laboratory import ACTUATOR, IDEAL  # isort: skip
from rig.own_controllers import Ramping  # isort: skip
from rig.own_rigs import Powered  # isort: skip

CAPTURE = Capture(0.3, 1e-3, 0.02)
POSITION = {"end_effector_position": IDEAL["end_effector_position"]}
Write = Callable[[str], object]


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    path = tmp_path / "site.toml"
    monkeypatch.setenv("STICKSLIP_SITE", str(path))
    return lambda text: path.write_text(text, encoding="utf-8")


@pytest.fixture
def link(tmp_path: Path, site: Write) -> Iterator[Link]:
    site("")
    made = Link(tmp_path / "rig", "a test")
    yield made
    made.close()


@pytest.fixture(params=["here", "hosted"])
def rig(request: pytest.FixtureRequest, link: Link) -> Powered | HostedRig:
    return Powered() if request.param == "here" else HostedRig(link, own_device(Powered, {}))


def test_limits_are_only_narrowed(site: Write) -> None:
    site(
        """
        [limits]
        max_voltage = "60 V"
        max_slew = "500 V/s"
        min_position = "-0.1 mm"
        watchdog = "10 s"
        [rigs.one.limits]
        max_voltage = "50 V"
        [rigs.two.limits]
        max_voltage = "70 V"
        """
    )
    found = site_of().narrowed(Limits(max_voltage=150.0, min_position=-1e-3, watchdog=5.0))
    assert found == Limits(max_voltage=60.0, max_slew=500.0, min_position=-1e-4, stop_slew=500.0)
    assert site_of().narrowed(Limits(max_voltage=20.0)).max_voltage == 20.0
    assert [site_of(name).narrowed(Limits()).max_voltage for name in ("one", "two")] == [50.0, 60.0]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[limit]", r"\[limit\] is unknown .*did you mean 'limits'"),
        ("[limits]\nmax_volts = '3 V'", r"\[limits\.max_volts\] is unknown"),
        ("[limits]\nmax_voltage = '3 m'", r"limits\.max_voltage"),
        ("[limits]\nmax_voltage = '-3 V'", r"max_voltage"),
        ("[permits.door]\ninput = 'door'", r"\[permits\.door\] input needs a minimum"),
        ("[permits]\ndoor = 3", r"\[permits\.door\] must be a table"),
        ("limits = [", r"site\.toml"),
    ],
)
def test_a_wrong_file_lets_nothing_start(rig: Powered | HostedRig, site: Write, text: str, why: str) -> None:
    site(text)
    with armed("a test"), pytest.raises(RigError, match=why) as caught:
        measure(rig, Step(10.0), IDEAL, CAPTURE, Limits())
    assert "site.toml" in str(caught.value)


def test_a_named_file_that_is_not_there_lets_nothing_start(site: Write) -> None:
    with armed("a test"), pytest.raises(RigError, match=r"site\.toml cannot be read"):
        measure(Powered(), Step(10.0), IDEAL, CAPTURE, Limits())


def test_an_experiment_cannot_exceed_the_limits_of_the_site(rig: Powered | HostedRig, site: Write) -> None:
    site('[limits]\nmax_voltage = "60 V"\nmax_position = "5 um"')
    with armed("a test"):
        with pytest.raises(LimitError, match=r"of 60 V.*; the limit is that of the site, .*site\.toml"):
            measure(rig, Step(65.0), IDEAL, CAPTURE, Limits())
        with pytest.raises(
            LimitError, match=r"above the greatest voltage of 20 V: change the drive or the limits$"
        ):
            measure(rig, Step(65.0), IDEAL, CAPTURE, Limits(max_voltage=20.0))
        measure(rig, Step(40.0), IDEAL, CAPTURE, Limits())
        with pytest.raises(LimitError, match="beyond the end stop at 5 µm"):
            measure(rig, Sawtooth(55.0, 20.0), IDEAL, CAPTURE, Limits(max_position=1.0))


def test_neither_does_a_closed_loop(site: Write) -> None:
    site('[limits]\nmax_voltage = "30 V"')
    with armed("a test"):
        made = regulate(Powered(), Ramping(0.05, 40.0), 0.0, IDEAL, Limits(), 0.06)
    assert made["asked_voltage"].max() == pytest.approx(40.0)
    assert made["drive_voltage"].max() < 30.5


def test_a_simulated_rig_has_no_site(link: Link, site: Write) -> None:
    site('[limits]\nmax_voltage = "10 V"')
    rig = HostedRig(link, virtual_device(ACTUATOR, "kang2007-bench", 3, False))
    made = measure(rig, Step(60.0), IDEAL, CAPTURE, Limits())
    assert made["drive_voltage"].max() > 50.0


def ran(rig: Powered | HostedRig, volts: float, loop: bool) -> float:
    """Where the end-effector has been at most, m."""
    if loop:
        spec = ControllerSpec(Ramping, {"slope": 0.05, "top": volts})
        made = regulate(rig, spec, 0.0, POSITION, Limits(), 0.06)
    else:
        made = measure(rig, Step(volts), POSITION, CAPTURE, Limits())
    return float(made["end_effector_position"].max())


@pytest.mark.parametrize("loop", [False, True])
def test_an_input_withdraws_its_permit(rig: Powered | HostedRig, site: Write, loop: bool) -> None:
    """The drive is the input here, which leaves what the permit allows at 20 V."""
    site('[permits.door]\ninput = "drive"\nmaximum = "20 V"')
    with armed("a test"):
        assert ran(rig, 15.0, loop) > 0.0
        with pytest.raises(LimitError, match="the permit 'door' is withdrawn: the input 'drive' reads"):
            ran(rig, 30.0, loop)
        with pytest.raises(InterlockError, match="not acknowledged: the permit 'door' is withdrawn"):
            ran(rig, 15.0, loop)
        interlock_of(rig).acknowledge("a test", "the door is shut again")
        assert ran(rig, 15.0, loop) > 0.0


def test_an_input_that_the_rig_does_not_have_lets_nothing_start(
    rig: Powered | HostedRig, site: Write
) -> None:
    site('[permits.door]\ninput = "door"\nminimum = "2 V"')
    with armed("a test"), pytest.raises(ValueError, match="a permit of the site needs the input 'door'"):
        measure(rig, Step(10.0), IDEAL, CAPTURE, Limits())


def test_a_permit_that_people_give(rig: Powered | HostedRig, site: Write) -> None:
    site('[permits.vacuum]\nreason = "below 1e-3 mbar"')
    with armed("a test"):
        with pytest.raises(InterlockError, match="'vacuum' is missing: nobody, it was never given"):
            measure(rig, Step(10.0), IDEAL, CAPTURE, Limits())
        interlock_of(rig).permit("vacuum", True, "Ada", "8e-4 mbar")
        measure(rig, Step(10.0), IDEAL, CAPTURE, Limits())
        interlock_of(rig).permit("vacuum", False, "Ada", "vented")
        with pytest.raises(InterlockError, match=r"'vacuum' is missing: Ada.*vented"):
            measure(rig, Step(10.0), IDEAL, CAPTURE, Limits())


class Narrowing(Powered):
    """A device whose range somebody narrows at its own panel."""

    most = 150.0

    def refresh(self) -> None:
        self.most -= 50.0

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(max_voltage=self.most)


def test_limits_of_a_device_are_read_at_each_start() -> None:
    rig = Narrowing()
    with armed("a test"):
        measure(rig, Step(60.0), IDEAL, CAPTURE, Limits())
        with pytest.raises(LimitError, match="above the greatest voltage of 50 V"):
            measure(rig, Step(60.0), IDEAL, CAPTURE, Limits())
