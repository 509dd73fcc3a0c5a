"""Reader of frequency responses of other instruments or programs: tables of frequency, gain and phase.

Columns are found by their names: "Frequency (Hz)", "Gain (dB)", "Phase (deg)"; or real and imaginary parts,
also from complex numbers in MAT and NPZ files. Frequency responses in a universal file (UFF) are read too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities.units import QuantityError
from .. import RecordingError
from ..conversion import Conversion
from .file_units import to_si_unit
from .formats import find_format
from .opening import source_of
from .reading import named_file
from .source import Column, FileChannel, FileContent, Rows, find_channel, listing
from .uff import data_sets, point

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

# Roles of columns in a frequency response, each with a pattern of their names. The first match counts; the
# role "" is for columns that are not used.
_ROLES = (
    ("", r"log|unwrap|coher|group delay|time"),
    ("frequency", r"freq|frequenz|omega|\bhz\b|^[fwω]$|^wout$"),
    ("phase", r"phas|\barg\b|angle|^[φϕ]"),
    ("real", r"\breal\b|\bre\b"),
    ("imag", r"\bimag|\bim\b"),
    ("gain", r"gain|magn|\bmag\b|ratio|transfer|\bfrf\b|\|.*\||\bdb\b|^abs\b"),
    ("amplitude", r"ampl"),  # taken as the gain only if no column has a name of a gain
)
# Pattern of units at the end of a header in spellings of frequency responses: "(dB)", "in °", "Phase_deg".
_UNITS = re.compile(
    r"[\[(<]([^\[\]()<>:]+)[\])>]\s*$|\bin (\S+)\s*$|[,_/ ](dB|deg|degrees?|°|rad|Hz|kHz|MHz|rad/s)\s*$"
)
_OMEGA = re.compile(r"omega|^[wω]$|^wout$", re.IGNORECASE)
_DECIBEL = re.compile(r"db", re.IGNORECASE)
# Function types in a universal file: frequency response, transmissibility.
_RESPONSES = (4, 5)
_MEANT = {"°": "deg", "degree": "deg", "degrees": "deg", "hz": "Hz", "khz": "kHz", "rad/sec": "rad/s"}
_MEANT |= {text.lower(): text for text in ("deg", "rad", "dB", "rad/s")}
_TWO_PI = 2.0 * np.pi


class ResponseColumns(NamedTuple):
    """Indices of the channels of a frequency response.

    Fields: `frequency`; `pairs`, a tuple of two indices for each output: gain and phase if `polar`, otherwise
    real and imaginary part.
    """

    frequency: int
    polar: bool
    pairs: tuple[tuple[int, int], ...]


def read_frequency_response(
    path: str | os.PathLike[str],
    columns: Mapping[str, Column] | None = None,
    units: Mapping[str, str] | None = None,
    *,
    scale: str = "1",
) -> xr.Dataset:
    """Read a frequency response from a table or a universal file, for `identify_frequency`.

    Args:
        path: text, MAT, NPZ, HDF5 or another file of columns, or a universal file (UFF, data set 58).
        columns: column, as for `read_recording`, of "frequency" with "gain" and "phase", or with "real" and
            "imag"; by default found by their names, also for several outputs.
        units: units of "frequency" (Hz, rad/s), "gain" (dB, "1", "um/V") and "phase" (deg, rad), which
            override those of the file. The unit of the gain is also used for real and imaginary parts.
        scale: response, with its unit, that a gain of 1 (0 dB) means: "0.5 um/V".

    Returns:
        Dataset over "frequency" [Hz, ascending, above 0], "output" and "input" (both from 1) with the
        variable `response`, complex, in SI. It has no `deviation`: all frequencies have equal weights in
        `identify_frequency`.

    Raises:
        RecordingError: there is no frequency response in the file, a unit is missing or wrong, a value is not
            a number, a frequency is negative or repeated, or fewer than two are above 0.
    """
    path = Path(path)
    with named_file(path):
        kind = find_format(path)
        if kind == "uff" and not columns:
            return _of_functions(data_sets(path), (units or {}).get("gain", ""), scale, path)
        if kind == "nc":
            raise RecordingError("is a recording: stickslip.identify.frequency_response gives its response")
        source = source_of(path, kind)
        found = _asked(source.channels, columns) if columns else response_columns(source.channels)
        if found is None:
            raise RecordingError(
                "no columns are called frequency, gain and phase (or real and imag); say columns="
                "{'frequency': ..., 'gain': ..., 'phase': ...}. "
                f"The file has {listing(source.channels)}"
            )
        return _read(source, found, units or {}, scale, path)


def response_columns(channels: Sequence[FileChannel]) -> ResponseColumns | None:
    """Return the columns of a frequency response among the channels, found by their names; None if the
    channels do not form a response."""
    roles = [_role(one) if one.numeric else "" for one in channels]
    frequency = [i for i, role in enumerate(roles) if role == "frequency"]
    if not frequency:
        return None
    frequency.sort(key=lambda i: not _unit(channels[i]) and bool(_OMEGA.search(channels[i].name.strip())))
    by_role = {name: [i for i, role in enumerate(roles) if role == name] for name in dict(_ROLES)}
    gains = by_role["gain"] or by_role["amplitude"]
    for first, second, polar in ((gains, by_role["phase"], True), (by_role["real"], by_role["imag"], False)):
        if first and len(first) == len(second):
            return ResponseColumns(frequency[0], polar, tuple(zip(first, second, strict=True)))
    return None


def _role(channel: FileChannel) -> str:
    text = re.sub(r"[_.]+", " ", channel.shown).strip().lower()
    # The patterns are compared with the header, and with the header without its unit.
    texts = (text, re.split(r"\s*[\[(<]", text)[0])
    return next((name for name, pattern in _ROLES if any(re.search(pattern, one) for one in texts)), "")


def _asked(channels: Sequence[FileChannel], columns: Mapping[str, Column]) -> ResponseColumns:
    for polar, names in ((True, ("frequency", "gain", "phase")), (False, ("frequency", "real", "imag"))):
        if set(columns) == set(names):
            at = [find_channel(channels, columns[name]) for name in names]
            return ResponseColumns(at[0], polar, ((at[1], at[2]),))
    raise RecordingError(
        f"columns = {dict(columns)!r} must say frequency, gain and phase, or frequency, real and imag"
    )


def _read(
    source: FileContent, found: ResponseColumns, units: Mapping[str, str], scale: str, path: Path
) -> xr.Dataset:
    known = {"frequency", "gain", "phase"}
    if set(units) - known:
        raise RecordingError(f"units has {min(set(units) - known)!r}; it may say {', '.join(sorted(known))}")
    indices = [found.frequency, *(i for pair in found.pairs for i in pair)]
    arrays = dict(zip(indices, source.read(indices, Rows()), strict=True))
    for i, values in arrays.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise RecordingError(
                f"{source.place(int(bad[0]))}: {source.channels[i].shown!r} is empty, NaN or infinite"
            )
        if values.size != arrays[found.frequency].size:
            raise RecordingError(
                f"{source.channels[i].shown!r} has {values.size} values, the frequency "
                f"{arrays[found.frequency].size}"
            )
    channels = source.channels
    frequency = _frequency(channels[found.frequency], arrays[found.frequency], units.get("frequency", ""))
    responses, unit = [], ""
    for first, second in found.pairs:
        value, unit = _gain(channels[first], arrays[first], units.get("gain", ""), scale, found.polar)
        if found.polar:
            phase = _phase(channels[second], arrays[second], units.get("phase", ""))
            responses.append(value * np.exp(1j * phase))
        else:
            other, _ = _gain(channels[second], arrays[second], units.get("gain", ""), scale, False)
            responses.append(value + 1j * other)
    return _dataset(frequency, np.array(responses).T[:, :, None], unit, path)


def _unit(channel: FileChannel) -> str:
    """Return the unit of a column, from its description or the end of its header, whether the package knows
    this unit or not; "" without a unit."""
    said = _UNITS.search(channel.shown)
    text = channel.unit or next((group for group in (said.groups() if said else ()) if group), "")
    text = text.strip()
    return _MEANT.get(text, _MEANT.get(text.lower(), text))


def _frequency(channel: FileChannel, values: Array, said: str) -> Array:
    """Return the frequencies of a column in Hz.

    Args:
        channel, values: column and its values.
        said: unit from the user; "": the column's unit or, without one, Hz.

    Raises:
        RecordingError: the column is called omega and has no unit, the unit is wrong, or a frequency is
            negative.
    """
    unit = said or _unit(channel)
    if not unit:
        if _OMEGA.search(channel.name.strip()):
            raise RecordingError(
                f"{channel.shown!r}: no unit is said. Say units={{'frequency': 'rad/s'}}, or 'Hz'"
            )
        unit = "Hz"
    conversion = _converted(channel, unit, ("rad/s", "Hz", "1/s"), "frequency", "Hz or rad/s")
    by = _TWO_PI if conversion.unit == "rad/s" else 1.0
    frequency = conversion.factor * values / by
    if np.any(frequency < 0.0):
        raise RecordingError(f"{channel.shown!r} has the frequency {frequency.min():g} Hz, below 0")
    return frequency


def _phase(channel: FileChannel, values: Array, said: str) -> Array:
    unit = said or _unit(channel)
    if not unit:
        raise RecordingError(f"{channel.shown!r}: no unit is said. Say units={{'phase': 'deg'}}, or 'rad'")
    return _converted(channel, unit, ("rad",), "phase", "deg or rad").factor * values


def _gain(channel: FileChannel, values: Array, said: str, scale: str, polar: bool) -> tuple[Array, str]:
    """Return gains (or real or imaginary parts) times the scale, in SI, and their unit ("1" for a ratio).

    Args:
        channel, values: column and its values.
        said: unit from the user; "": the column's unit.
        scale: response, with its unit, that a gain of 1 means.
        polar: True for a gain, which may be in dB.

    Raises:
        RecordingError: a unit or the scale is wrong, or the unit of a gain is missing.
    """
    unit = said or (_unit(channel) if polar else channel.unit)
    whole = _converted(channel, scale, None, "scale", "a number and a unit, '0.5 um/V'")
    if _DECIBEL.match(unit) and polar:
        return 10.0 ** (values / 20.0) * whole.factor, whole.unit or "1"
    if not unit:
        if not polar:
            return values * whole.factor, whole.unit or "1"
        raise RecordingError(
            f"{channel.shown!r}: no unit is said. Say units={{'gain': 'dB'}}, '1' for a ratio, or 'um/V'"
        )
    own = _converted(channel, unit, None, "gain", "dB, '1', or a unit")
    return values * own.factor * whole.factor, _product(own.unit, whole.unit)


def _product(own: str, scale: str) -> str:
    if own and scale and own != "1" and scale != "1":
        raise RecordingError(f"the gain is in {own} already: scale = ... {scale} would change its unit")
    return next((one for one in (own, scale) if one not in ("", "1")), "1")


def _converted(
    channel: FileChannel, unit: str, of: tuple[str, ...] | None, name: str, expected: str
) -> Conversion:
    """Return the conversion of a unit, or of a number with a unit, to SI.

    Args:
        channel: column, for messages.
        unit: text to convert.
        of: allowed SI units; None: any.
        name, expected: name of the quantity and description of its units, for messages.

    Raises:
        RecordingError: the unit is unknown or not allowed.
    """
    try:
        number = re.match(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)", unit)
        factor, text = (float(number[1]), number[2].strip()) if number else (1.0, unit.strip())
        found = _ratio(text) if text and text != "1" else Conversion("", 1.0, 0.0)
        if of is None or found.unit in of:
            return found._replace(factor=factor * found.factor)
        raise QuantityError(f"{unit!r} is no {name}")
    except (QuantityError, ValueError) as error:
        raise RecordingError(f"{channel.shown!r}: {error}. Say units={{{name!r}: ...}}: {expected}") from None


def _ratio(unit: str) -> Conversion:
    """Return the conversion of a unit to SI, also of a ratio of two units ("um/N"). Raises QuantityError for
    unknown units."""
    above, _, below = unit.rpartition("/")
    try:
        return to_si_unit(unit)
    except QuantityError:
        if not above:
            raise
    one, other = to_si_unit(above), to_si_unit(below)
    return Conversion(f"{one.unit or 1}/{other.unit}", one.factor / other.factor, 0.0)


def _of_functions(functions: Sequence[dict[str, Any]], said: str, scale: str, path: Path) -> xr.Dataset:
    """Return the frequency response in the functions of a universal file, as the dataset of
    `read_frequency_response`.

    Args:
        functions: functions in the file, as the dictionaries of pyuff; their response points become the
            outputs, their reference points the inputs.
        said: unit of the response from the user; "": that in the file.
        scale: response, with its unit, that a gain of 1 means.
        path: path of the file.

    Raises:
        RecordingError: there are no responses, they have different frequencies, or some are missing.
    """
    responses = [one for one in functions if one.get("func_type") in _RESPONSES]
    if not responses:
        raise RecordingError("the universal file (UFF) holds no frequency responses")
    frequency = np.asarray(responses[0]["x"], float)
    outputs = list(dict.fromkeys(point(one) for one in responses))
    inputs = list(dict.fromkeys(_reference(one) for one in responses))
    values = np.full((frequency.size, len(outputs), len(inputs)), np.nan, complex)
    for one in responses:
        if not np.array_equal(np.asarray(one["x"], float), frequency):
            raise RecordingError("its responses are at different frequencies: save them one by one")
        values[:, outputs.index(point(one)), inputs.index(_reference(one))] = one["data"]
    if np.isnan(values).any():
        raise RecordingError(
            f"it holds {len(responses)} responses of {len(outputs)} points to {len(inputs)}: some are missing"
        )
    labels = (
        str(responses[0].get(f"{axis}_axis_units_lab", "")).strip() for axis in ("ordinate", "orddenom")
    )
    above, below = ("1" if text in ("", "NONE") else text for text in labels)
    channel = FileChannel("response", above if below == "1" else f"{above}/{below}")
    real, unit = _gain(channel, np.real(values), said, scale, polar=False)
    imag, _ = _gain(channel, np.imag(values), said, scale, polar=False)
    return _dataset(frequency, real + 1j * imag, unit, path)


def _reference(one: dict[str, Any]) -> str:
    return point({"rsp_node": one.get("ref_node", 0), "rsp_dir": one.get("ref_dir", 0)})


def _dataset(frequency: Array, values: NDArray[Any], unit: str, path: Path) -> xr.Dataset:
    """Return the dataset of a response [frequency, output, input], sorted by frequency [Hz]. The frequency 0
    is left out, because there is no phase. `unit` is that of the response; the name of the file `path`
    becomes the attribute "source".

    Raises:
        RecordingError: there are fewer than two frequencies above 0, or one is repeated.
    """
    import xarray as xr

    order = np.argsort(frequency, kind="stable")
    order = order[frequency[order] > 0.0]
    frequency, values = frequency[order], values[order]
    if frequency.size < 2:
        raise RecordingError(f"it has {frequency.size} frequencies above 0")
    again = np.flatnonzero(np.diff(frequency) == 0.0)
    if again.size:
        raise RecordingError(
            f"it has two lines at {frequency[again[0]]:g} Hz: give each sweep a file of its own"
        )
    return xr.Dataset(
        {
            "response": (
                ("frequency", "output", "input"), values, {"units": unit, "long_name": "frequency response"},
            )
        },
        {
            "frequency": ("frequency", frequency, {"units": "Hz", "long_name": "frequency"}),
            "output": np.arange(1, values.shape[1] + 1),
            "input": np.arange(1, values.shape[2] + 1),
        },
        {"source": path.name},
    )  # fmt: skip
