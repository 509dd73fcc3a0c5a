"""Export a model as portable C99: the library files and example programs."""

from __future__ import annotations

import math
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..engine.library import SOURCES
from ..physics.actuator import Actuator
from ..physics.electronics import Amplifier, StrainGauge
from ..quantities.records import of_kind
from ..quantities.units import QuantityError, optional_si, to_si, unit_for
from ..recording.chain import Chain
from ..simulation.drives import checked_drive
from ..simulation.jumps import cannot_jump, refuse_jumps
from ..simulation.two_port import driven_by_voltage
from ..waveform.periodic import Sawtooth, Sine
from ..waveform.signal import Waveform
from .equations import SignalChain, equations, layout
from .gain import observer_gain
from .source import Exported, ExportError, exported
from .table import played, table_h
from .values import parameters_c, plain
from .writing import whole

C = Path(__file__).parent / "c"
# Bandwidth of an amplifier of which only the slew rate is known, Hz: so large that it has no effect.
AT_ONCE = 1e7
# Fraction of the period in which the default sawtooth (5 Hz) falls, for a model that cannot follow a jump:
# 0.4 ms, 20 default steps.
FALL = 0.002
CORE = ("stickslip.c", "stickslip.h", "stickslip_follow.h", "stickslip_player.h")
_INCLUDED = re.compile(r'^#include "(?:engine/)?([^"]+)"', re.MULTILINE)
LICENCE = Path(__file__).parent / "c" / "LICENSE.txt"


def export_c(
    source: Any,
    out: str | os.PathLike[str],
    *,
    step: float | str = 20e-6,
    waveform: Waveform | None = None,
    duration: float | str | None = None,
    motion: Waveform | None = None,
    amplifier: Amplifier | None = None,
    piezo_capacitance: float | str | None = None,
    sensor: StrainGauge | None = None,
    chain: Chain | None = None,
    measurement_noise: float | str = 10e-9,
) -> Path:
    """Write a model as C99 without dependencies: plant, observer and feedforward, for a host and a
    microcontroller.

    Args:
        source: an `Actuator` or `PulledSlider`, a `Fit` of one, the name or file of a parameter set, or the
            results.json of ``stickslip identify`` on a walk.
        out: new folder.
        step: time step of the example programs and of the observer's gain, s; the plant takes any step.
        waveform: waveform of the example; by default a sawtooth of 65 V (or what the actuator takes) and 5
            Hz, for a pulled slider of 0.1 mm and 1 Hz. The default falls in 0.4 ms where the model cannot
            follow a jump (a static stage with a presliding law, a `MaxwellCapacitor`).
        duration: played part of the waveform, s; by default its own duration, or eight periods if that is
            infinite.
        motion: motion of the feedforward example, a waveform in m, or rad for a rotary actuator; by default a
            sine of a tenth of the stroke. A pulled slider has no such example.
        amplifier: amplifier between the input and the piezo; needs the `piezo_capacitance` [F]. A pulled
            slider has none, nor a slew rate of the chain.
        sensor: a linear sensor on the end-effector, with its bandwidth.
        chain: measuring channel of the end-effector's position, instead of a sensor: the exported output is
            delayed, in m or rad. Without an amplifier, its slew rate limits the drive voltage. By default the
            chain of a fit of walks or of a campaign's results.json, with 0 instead of a negative delay; a
            negative delay in `chain` itself is an error.
        measurement_noise: standard deviation of a measured position, m, or rad for a rotary actuator, for the
            observer's gain.

    Returns:
        The path of the folder.

    Raises:
        ExportError: the source cannot be exported, no gain of the observer is stable, or `out` exists.
        TranslationError: the law is not written in the subset of Python that can be translated to C.
        ParameterSetError, QuantityError: a file or a value is wrong, or the model cannot follow the waveform.
        OSError: a file cannot be written.
    """
    h = checked_step(step)
    farad, seconds = (
        optional_si(piezo_capacitance, "F", "piezo_capacitance"),
        optional_si(duration, "s", "duration"),
    )
    found = exported(source)
    noise = checked_noise(measurement_noise, found.model)
    parts = signal_chain(found, amplifier, farad, sensor, chain)
    amplifier = parts.amplifier
    if waveform is not None and not hasattr(waveform, "drive"):
        raise QuantityError(f"waveform = {waveform!r:.60} is no waveform, such as Sawtooth('65 V', '5 Hz')")
    drive = default_waveform(found.model, amplifier) if waveform is None else waveform
    if amplifier is None:  # the output of an amplifier stays in its range, so any input of it is allowed
        checked_drive(found.model, drive, h, periodic=False, tolerance=math.inf)
    elif drive.unit != "V":
        raise QuantityError(f"the input of an amplifier is in V, not in {drive.unit}")
    files = core_files(found, parts, h, noise)
    steps = played(drive, h, seconds)
    if amplifier is None and isinstance(found.model, Actuator):
        refuse_jumps(found.model, drive.drive(h * steps.steps), None)
    table = table_h("stickslip_waveform", repr_of(drive), steps, h)
    rest = f"#define STICKSLIP_REST_INPUT R({float(drive.drive(h).before)!r})"
    noise_line = f"#define STICKSLIP_MEASUREMENT_NOISE R({noise!r})"
    files["stickslip_waveform.h"] = table.replace("\n#endif\n", f"\n{rest}\n{noise_line}\n\n#endif\n")
    examples = ["walk.c"]
    if isinstance(found.model, Actuator):
        wanted = _default_motion(found.model, h) if motion is None else motion
        unit = unit_for(found.model, "m")
        if getattr(wanted, "unit", None) != unit:
            raise QuantityError(f"the wanted motion is in {unit}; motion = {wanted!r:.60} is not")
        files["stickslip_motion.h"] = table_h(
            "stickslip_motion", repr_of(wanted), played(wanted, h, None, 1e-7, "motion"), h
        )
        examples += ["observe.c", "scan.c"]
    with whole(out) as folder:
        write_files(folder, files)
        for name in ("Makefile", "README.txt", "LICENSE.txt"):
            shutil.copy(C / name, folder / name)
        for part, names in (("host", examples), ("bare", ["main.c", "count.c", "start.c", "board.ld"])):
            (folder / part).mkdir()
            for name in names:
                shutil.copy(C / part / name, folder / part / name)
    return Path(out)


def core_files(
    found: Exported, chain: SignalChain, h: float, noise: float, any_layout: bool = False
) -> dict[str, str]:
    """Return the C files that every export contains, as name -> text.

    Args:
        found: the model with the sources of its values.
        chain: amplifier and sensor.
        h: time step, s.
        noise: standard deviation of a measured position, m, or rad for a rotary actuator.
        any_layout: if True, parameters may change which bodies and elements the model has; the code is then
            slower.

    Raises:
        ExportError: no gain of the observer is stable.
        TranslationError: the friction law cannot be translated to C.
        QuantityError: the delay of the position channel is negative.
    """
    head = heading(found)
    files = {name: (C / name).read_text(encoding="utf-8") for name in CORE}
    files["stickslip_layout.h"] = head + layout(found.model)
    files |= {f"engine/{name}": text for name, text in _engine(*files.values()).items()}
    files["stickslip_equations.h"] = head + equations(found.model, chain, h, any_layout)
    gain = _observing(found.model, h, noise)
    files["stickslip_parameters.c"] = head + parameters_c(found, chain, gain)
    return files


def _engine(*texts: str) -> dict[str, str]:
    """Return the source files of the package's engine that C texts include, directly or indirectly.

    `texts` are the contents of C files. The result has the contents of the engine's files by name.
    """
    found: dict[str, str] = {}
    names = {name for text in texts for name in _INCLUDED.findall(text) if (SOURCES / name).exists()}
    while names := names - found.keys():
        found |= {name: (SOURCES / name).read_text(encoding="utf-8") for name in names}
        names = {name for text in found.values() for name in _INCLUDED.findall(text)}
    return found


def _observing(model: Any, h: float, noise: float) -> NDArray[np.float64]:
    """Return the observer's gain, as `gain.observer_gain` defines it.

    Args:
        model: actuator or pulled slider.
        h: time step, s.
        noise: standard deviation of a measured position, m, or rad for a rotary actuator.

    Raises:
        ExportError: no gain is stable; the message names a shorter step with a stable gain, if repeated
            halving down to 1 ns finds one.
    """
    does, why = None, "none is stable"
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            gain = observer_gain(model, h, noise)
            if gain is not None:
                return gain
            shorter = (h / 2**k for k in range(1, 24) if h / 2**k >= 1e-9)
            does = next((one for one in shorter if observer_gain(model, one, noise) is not None), None)
    except (ArithmeticError, ValueError) as error:  # SciPy finds no solution, or a number is infinite
        why = str(error)
    if does is not None:
        raise ExportError(
            f"the observer has no gain at step = {h:g} s that is stable in every state of the contact: "
            f"step = {does:g} s does"
        )
    name = "end_effector_mass" if isinstance(model, Actuator) else "mass"
    mass, kilogram = getattr(model, name), unit_for(model, "kg")
    raise ExportError(
        f"the observer has no gain at step = {h:g} s, {name} = {mass:g} {kilogram} and measurement_noise = "
        f"{noise:g} {unit_for(model, 'm')}: one of them is too small for the others ({why})"
    )


def heading(found: Exported) -> str:
    """Return the first comment of each generated C file: model, version, citations, units, licence."""
    keys = ", ".join(found.model.citation_keys) or "none"
    model, law = type(found.model).__name__, type(found.model.friction).__name__
    rotary = getattr(found.model, "rotary", False)
    turns = " * It turns: what is said to be in m, N and kg is in rad, N m and kg m^2.\n" if rotary else ""
    return (
        f"/* {model} {plain(found.model.name) or '(no parameter set)'} with {law} friction.\n"
        f" * Generated by stickslip {__version__}; do not edit, export again. Sources: {plain(keys)}.\n"
        " * The functions are translations of the Python functions that they name. All quantities in SI.\n"
        f"{turns}"
        " * BSD-3-Clause, see LICENSE.txt. No warranty: test it on your plant before it moves anything.\n"
        " */\n"
    )


def checked_step(step: float | str) -> float:
    """Convert a time step (a number in s, or a text with a unit) to s; return it.

    Raises QuantityError if the step is not within 1 ns to 1 s.
    """
    h = to_si(step, "s", "step")
    if not 1e-9 <= h <= 1.0:
        raise QuantityError(f"step = {h:g} s is out of range: it must be >= 1e-09 s and <= 1 s")
    return h


def checked_noise(noise: float | str, model: Any) -> float:
    """Convert the standard deviation of a measured position to m, or rad for a rotary model; return it.

    Raises QuantityError if it is not positive and finite.
    """
    unit = unit_for(model, "m")
    found = to_si(noise, unit, "measurement_noise")
    if not 0.0 < found < math.inf:
        raise QuantityError(f"measurement_noise = {found:g} {unit} must be > 0 {unit} and finite")
    return found


def signal_chain(
    found: Exported,
    amplifier: Amplifier | None,
    farad: float | None,
    sensor: StrainGauge | None,
    chain: Chain | None,
) -> SignalChain:
    """Check the devices around the actuator, and return the amplifier and the sensor to export.

    A signal chain of the position channel takes the place of a sensor. If there is no amplifier and the
    chain's slew rate is known, an amplifier with this slew rate and the model's voltage range is added; its
    bandwidth is so large, and its current so unlimited, that they have no effect.

    Args:
        found: the model, with the chain that recordings determined, which is used if `chain` is None.
        amplifier: amplifier, or None.
        farad: capacitance of the piezo, F, or None.
        sensor: sensor of the end-effector's position, or None.
        chain: signal chain of the position channel, or None.

    Raises:
        QuantityError: the devices exclude each other, a value is wrong or missing, or a model without a
            drive voltage has an amplifier or a slew rate.
    """
    parts = (("amplifier", amplifier, Amplifier), ("sensor", sensor, StrainGauge), ("chain", chain, Chain))
    for name, part, kind in parts:
        of_kind(part, kind | None, name)
    if not isinstance(found.model, Actuator):
        _refuse_volts(type(found.model).__name__, amplifier, chain)
    if farad is not None and not 0.0 < farad < math.inf:
        raise QuantityError(f"piezo_capacitance = {farad:g} F must be > 0 F and finite")
    if chain is None and found.chain is not None:
        chain = found.chain._replace(delay=max(found.chain.delay, 0.0))
    seen = sensor
    if chain is not None and chain != Chain():
        if sensor is not None:
            raise QuantityError("give a sensor or a chain of the position channel, not both")
        seen = chain
        if amplifier is None and chain.known_slew_rate is not None:
            low, high = max(found.model.min_voltage, -1e6), min(found.model.max_voltage, 1e6)
            amplifier = Amplifier(1.0, 0.0, AT_ONCE, chain.slew_rate, math.inf, low, high)
            farad = farad or 1e-6  # arbitrary: without a limit of the current, the capacitance has no effect
    if amplifier is None:
        return SignalChain(sensor=seen)
    if farad is None:
        raise QuantityError("an amplifier needs the piezo_capacitance [F] that it charges")
    if amplifier.rms_current < amplifier.max_current:
        raise QuantityError(
            f"Amplifier.rms_current = {amplifier.rms_current:g} A cannot be exported: the C code has one "
            "limit of the current, max_current"
        )
    return SignalChain(amplifier, farad, seen)


def _refuse_volts(model: str, amplifier: Amplifier | None, chain: Chain | None) -> None:
    """Raise QuantityError if there is an amplifier or a known slew rate; `model` is the name of the type of
    the model, which has no drive voltage.
    """
    if amplifier is not None:
        raise QuantityError(f"a {model} has no drive voltage: export it without an amplifier")
    if chain is not None and chain.known_slew_rate is not None:
        raise QuantityError(
            f"Chain.slew_rate = {chain.slew_rate:g} V/s limits a drive voltage, which a {model} does not "
            "have: give the chain without slew_rate"
        )


def default_waveform(model: Any, amplifier: Amplifier | None = None) -> Waveform:
    """Return the sawtooth of the example program, within the model's limits.

    For an actuator it has eight periods of 5 Hz and 65 V or less at the piezo; with an amplifier, its values
    are the amplifier's input. For a pulled slider it moves the spring's end by 0.1 mm, four times at 1 Hz.
    """
    if not isinstance(model, Actuator):
        return Sawtooth(1e-4, 1.0, periods=4, unit="m")
    if amplifier is not None:
        return Sawtooth((min(65.0, model.max_voltage) - amplifier.offset) / amplifier.gain, 5.0, periods=8)
    rise = 1.0 - FALL if cannot_jump(model) or driven_by_voltage(model) else 1.0
    return Sawtooth(min(65.0, model.max_voltage), 5.0, rise, periods=8, offset=max(0.0, model.min_voltage))


def _default_motion(model: Actuator, h: float) -> Waveform:
    """Return the wanted motion of the feedforward example: a sine of the stage's displacement, m or rad.

    Its frequency is about 10 Hz, or lower so that a period has at least 20 steps. Its amplitude is a tenth of
    the displacement at 65 V (or at the largest voltage, if that is less), around half of this displacement.
    Its period is a whole number of steps h [s], so that a table of one period can be repeated.
    """
    reach = 0.1 * abs(model.gain) * min(65.0, model.max_voltage)
    middle = 5.0 * reach + model.gain * max(0.0, model.min_voltage)
    period = max(round(0.1 / h), 20) * h
    return Sine(reach, 1.0 / period, offset=middle, periods=4, unit="rad" if model.rotary else "m")


def repr_of(waveform: Waveform) -> str:
    return plain(repr(waveform))


def write_files(folder: Path, files: dict[str, str]) -> None:
    """Write ASCII files to a folder and its subfolders, which are made; `files` has the texts by relative
    path.
    """
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="ascii")


__all__ = ["ExportError", "export_c"]
