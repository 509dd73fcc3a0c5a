"""Selection of the channels of a file that become variables of a recording, with their units and clocks (time
columns)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...quantities.units import ANGLE, QuantityError
from .. import STANDARD_NAMES, RecordingError
from ..conversion import Conversion, is_number
from .file_units import in_seconds, is_unsure, to_si_scale, to_si_unit
from .headers import ends_in_m
from .source import Column, FileChannel, find_channel, is_clock, listing, no_numbers


class FileVariable(NamedTuple):
    """A channel that becomes a variable of the recording, or one of its clocks.

    Fields: `name` in the recording; `column`, the channel's description; `conversion` to SI; and those below.
    """

    name: str
    channel: int  # index of the channel in the file
    column: FileChannel
    unit: str  # unit from the user or else in the file; "" if unknown
    conversion: Conversion
    clock: int | None  # index of the channel with its times; None: equally spaced
    # False: the unit comes from a name that ends in "_m", which may mean "measured".
    sure: bool = True
    # True: the package does not know the file's unit, so numbers are kept without a unit.
    unknown: bool = False

    @property
    def label(self) -> str:
        """Return the text for the variable in messages: its name, its column and its unit, if known."""
        return f"{self.name} (column {self.column.shown!r}{f' in {self.unit}' if self.unit else ''})"


class Selection(NamedTuple):
    """Result of a selection: `variables`, and `clocks`, the time column of each clock by the index of its
    channel, the common clock first. For equally spaced samples, the index and the time column are None."""

    clocks: Mapping[int | None, FileVariable | None]
    variables: tuple[FileVariable, ...]


def select(
    channels: Sequence[FileChannel],
    columns: Mapping[str, Column],
    units: Mapping[str, str],
    clocks: Mapping[str, Column],
    equally_spaced: bool,
) -> Selection:
    """Return the variables and clocks that the user's arguments select from the channels of a file, as a
    `Selection`.

    Args:
        channels: channels of the file.
        columns, units, clocks: arguments of `read_recording`.
        equally_spaced: True: the user gave a sample rate, so there is no clock.

    Raises:
        RecordingError: a column is missing or contains no numbers; there is no clock, more than one, or one
            beside a sample rate; `units` or `clocks` has another name; a unit is not known or has another
            dimension.
    """
    named = {name: find_channel(channels, column) for name, column in columns.items() if name != "time"}
    named = named or _all(channels)
    if not named:
        raise RecordingError("there are no columns of numbers besides time")
    for argument, names in (("units", units), ("clocks", clocks)):
        for name in set(names) - {"time", *named}:
            raise RecordingError(f"{argument} has {name!r}, but what is read is {', '.join(named)}")
    own = {name: find_channel(channels, column) for name, column in clocks.items()}
    if equally_spaced and ("time" in columns or own):
        raise RecordingError("say sample_rate or a time column, not both")
    common = None if equally_spaced else common_clock(channels, columns, named, own)
    # True: the common clock is a column that the file's layout does not mark as a clock. The layout's clocks
    # then do not count.
    said = common is not None and channels[common].clock != common

    variables = []
    for name, i in named.items():
        by_layout = None if equally_spaced or said else channels[i].clock
        clock = own.get(name, common if by_layout is None else by_layout)
        standard = STANDARD_NAMES[name].unit if name in STANDARD_NAMES else None
        variables.append(_variable(channels, i, name, units.get(name), clock, standard))
    used: dict[int | None, FileVariable | None] = {}
    for clock in (common, *(v.clock for v in variables)):
        used[clock] = None
        if clock is not None:
            used[clock] = _variable(channels, clock, "time", units.get("time"), clock, "s")
    return Selection(used, tuple(variables))


def _variable(
    channels: Sequence[FileChannel],
    i: int,
    name: str,
    unit: str | None,
    clock: int | None,
    standard: str | None,
) -> FileVariable:
    """Return channel `i` as a variable.

    Args:
        channels: channels of the file.
        i: index of the channel.
        name: name of the variable.
        unit: unit from the user; None: the file's unit.
        clock: index of the channel with its times; None: equally spaced.
        standard: SI unit that the name requires (or the corresponding one for rotary bodies); None: any.

    Raises:
        RecordingError: the channel contains no numbers, or its unit is unknown or wrong.
    """
    column = channels[i]
    if not column.numeric:
        raise RecordingError(f"{name}: {no_numbers(column)}")
    said = column.unit if unit is None else unit
    sure = unit is not None or column.unit != "m" or not ends_in_m(column.header)
    made = FileVariable(name, i, column, said, Conversion(standard or "", 1.0, 0.0), clock, sure)
    if unit is None and not column.unit:
        return made
    try:
        conversion = to_si_unit(said) if unit is None else _scale(unit, column.unit, standard or "V")
    except QuantityError as error:
        if unit is None and standard is None and not is_unsure(said):
            return made._replace(unknown=True)
        hint = f" (units={{{name!r}: ...}} says it)" if unit is None else ""
        raise RecordingError(f"{made.label}: {error}{hint}") from None
    if standard is not None and conversion.unit not in (standard, ANGLE.unit(standard)):
        scale = f". A sensor's scale says what a volt is: units={{{name!r}: '0.5 um/V'}}"
        hint = scale if conversion.unit == "V" and standard == "m" else ""
        raise RecordingError(f"{made.label}: {name} is a quantity in {standard}{hint}")
    return made._replace(conversion=conversion)


def _scale(said: str, own: str, standard: str) -> Conversion:
    """Return the conversion to SI for the user's unit `said` of a column whose unit in the file is `own`:
    "0.5 um/V" converts a column in V (or mV) to m.

    `standard` is an example of a unit for messages.

    Raises:
        QuantityError: `said` is no unit, or is for a column in V and the column is not.
    """
    if not isinstance(said, str) or (said.strip() != "1" and is_number(said)):
        raise QuantityError(f'{said!r} names no unit; a scale is said with one, "{said} {standard}"')
    made = to_si_scale(said)
    quantity, over, per = made.unit.rpartition("/")
    if not over or per != "V":
        return made
    volts = to_si_unit(own) if own else Conversion("V", 1.0, 0.0)
    if volts.unit != "V":
        raise QuantityError(f"{said!r} is for a column in V, not in {own}")
    return Conversion(quantity, made.factor * volts.factor, 0.0)


def _all(channels: Sequence[FileChannel]) -> dict[str, int]:
    """Return the indices of all channels of numbers that are not times, by names for the variables: the
    channels' names in lower case, with "_" for other signs. A name that is no identifier gets "column_"
    before it, a repeated one the channel's index after it."""
    result: dict[str, int] = {}
    for i, channel in enumerate(channels):
        if channel.numeric and channel.clock != i and not is_clock(channel) and not in_seconds(channel):
            name = re.sub(r"\W+", "_", channel.name.lower()).strip("_")
            name = name if name.isidentifier() and name != "time" else f"column_{name or i}"
            result[name if name not in result else f"{name}_{i}"] = i
    return result


def common_clock(
    channels: Sequence[FileChannel],
    columns: Mapping[str, Column],
    named: Mapping[str, int],
    own_clocks: Mapping[str, int],
) -> int:
    """Return the index of the common time channel: the user's, the file layout's, or the only one whose name
    or else unit is that of a time.

    Args:
        channels: channels of the file.
        columns: user's columns; "time" is the time column.
        named: indices of the selected channels by name.
        own_clocks: indices of other time columns, which are not the common one.

    Raises:
        RecordingError: no channel, or more than one, may be the time.
    """
    if "time" in columns:
        return find_channel(channels, columns["time"])
    by_layout = [clock for i in named.values() if (clock := channels[i].clock) is not None]
    if by_layout:
        return by_layout[0]
    found = [i for i, channel in enumerate(channels) if is_clock(channel) and i not in own_clocks.values()]
    found = found or [i for i, channel in enumerate(channels) if channel.numeric and in_seconds(channel)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise RecordingError(
            f"no column is called time; say columns={{'time': ...}} or sample_rate=... [Hz]. "
            f"The file has {listing(channels)}"
        )
    raise RecordingError(
        f"more than one column may be the time; say columns={{'time': ...}}, "
        f"and clocks={{name: ...}} for what is on another clock. The file has {listing(channels)}"
    )
