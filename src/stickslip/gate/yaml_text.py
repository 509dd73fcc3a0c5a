"""Parse YAML from outside: values are built from the parser's events, one by one, within limits.

A parser that first composes a tree exhausts the stack at 50,000 brackets, and the memory at eight lines of
references (anchors and aliases). Here depth and values are counted at each event before anything is built;
values behind a reference count each time it is used. Some features of YAML 1.1 are missing: numbers of base
60 (``1:30`` is a text), tags other than ``!!str``, ``!!map`` and ``!!seq``, keys that are not texts (``1:``
is the text "1"), directives except %YAML, and several documents in a text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

from .errors import GateError
from .text import MOST_BYTES, MOST_DEPTH, MOST_DIGITS, decoded, too_deep, too_large, too_long, too_many

# Largest number of values in a YAML text, which count again at each reference. A file of 1 MB has as many
# numbers of 9 digits.
MOST_YAML_VALUES = 100_000
_TAG = "tag:yaml.org,2002:"
_PLAIN = (None, "!")
# The parser in C, if installed, is 10 times as fast as the one in Python.
_PARSER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_RULES: dict[str | None, list[tuple[str, re.Pattern[str]]]] = yaml.SafeLoader.yaml_implicit_resolvers
_NUMERIC = re.compile(r"[-+.]?[0-9][-+0-9_.:a-fA-Fxo]*")


class _Held(NamedTuple):
    """A parsed `value` with its `size`, the number of all values in it including itself. The size is counted
    again at each reference to the value."""

    value: Any
    size: int


class _Open:
    """A list or mapping that is being read.

    `made` is its content so far, `anchor` its name for references, and `size` the number of values in it.
    `key` is the key of a mapping whose value comes next, and `merged` are the mappings given by "<<".
    """

    def __init__(self, made: Any, anchor: str | None) -> None:
        self.made, self.anchor, self.size = made, anchor, 1
        self.key: str | None = None
        self.merged: list[dict[str, Any]] = []


def load_yaml(raw: bytes | str, source: str) -> Any:
    """Return the content of a YAML text: mappings with texts as keys, lists, numbers, texts, dates, None.

    Args:
        raw: the text, or its bytes in UTF-8.
        source: name of the text in errors, such as the path of its file.

    Raises:
        GateError: the text is no YAML or not UTF-8, uses a missing feature (see the module), or gives a key
            twice; or it has more than `MOST_BYTES` characters, is nested too deeply, or has too many values
            or a number of too many digits.
    """
    text = decoded(raw, source)
    if len(text) > MOST_BYTES:
        raise too_large(source, len(text), MOST_BYTES)
    # Lines that start with "%" (directives) are refused. The parser compares each directive with all previous
    # ones, which takes quadratic time.
    if re.search(r"^%(?!YAML)", text, re.MULTILINE):
        raise GateError(f"{source}: a line starts with '%', which input files do not use")
    try:
        return _Built(source).of(yaml.parse(text, Loader=_PARSER))
    except GateError:
        raise
    # A date that does not exist raises ValueError.
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        said = " ".join(str(error).replace('"<unicode string>"', "it").split())
        raise GateError(
            f"{source} is no YAML: {said}. Check brackets, quotes and indentation there"
        ) from error


class _Built:
    """Builder of a YAML document's value from the events of the parser; `source` names the text in errors.

    The method `of` takes the events and returns the value, None for an empty document.
    """

    def __init__(self, source: str) -> None:
        self._source, self._count = source, 0
        self._open: list[_Open] = []
        # Value of each anchor (name for references) by its name; None while the value is being read.
        self._named: dict[str, _Held | None] = {}
        self._whole: list[Any] = []

    def of(self, events: Iterator[Any]) -> Any:
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                self._scalar(event)
            elif isinstance(event, yaml.CollectionStartEvent):
                self._start(event)
            elif isinstance(event, yaml.CollectionEndEvent):
                self._end()
            elif isinstance(event, yaml.AliasEvent):
                self._reference(event)
            elif isinstance(event, yaml.DocumentStartEvent) and self._whole:
                raise self._error(event, "a second document ('---') starts; a file holds one")
        return self._whole[0] if self._whole else None

    def _scalar(self, event: Any) -> None:
        place = self._open[-1] if self._open else None
        if place is not None and isinstance(place.made, dict) and place.key is None:
            self._add_key(place, event)
            return
        value = self._value(event)
        if event.anchor:
            self._named[event.anchor] = _Held(value, 1)
        self._put(_Held(value, 1))

    def _value(self, event: Any) -> Any:
        """Return the value of the parser's event for a scalar: a number, bool, date or None if its unquoted
        text has the form of one, else the text. Raises GateError for an unknown tag or a number of too many
        digits."""
        text, tag = event.value, event.tag
        if tag in _PLAIN:
            if not event.implicit[0] or tag == "!":
                return text
            if len(text) > MOST_DIGITS:
                if _NUMERIC.fullmatch(text):
                    raise too_long(self._source, event.start_mark.line + 1)
                return text
            rules = _RULES.get(text[:1], []) + _RULES.get(None, [])
            tag = next((kind for kind, pattern in rules if pattern.match(text)), "")
            if ":" in text and tag in (f"{_TAG}int", f"{_TAG}float"):
                # A number of base 60, such as 1:30, is returned as text.
                return text
        elif tag == f"{_TAG}str":
            return text
        else:
            raise self._error(event, f"the tag {tag[:60]!r} is not known")
        maker = _MAKERS.get(tag)
        return text if maker is None else maker(_CONSTRUCTOR, yaml.ScalarNode(tag, text))

    def _add_key(self, place: _Open, event: Any) -> None:
        key = event.value
        if event.tag not in (*_PLAIN, f"{_TAG}str"):
            raise self._error(event, f"a key has the tag {event.tag[:60]!r}")
        if key in place.made or (key == "<<" and place.merged):
            raise self._error(event, f"the key {key[:60]!r} is given twice")
        place.key = key
        # The key is entered now, so that the keys keep their order. The value is set later.
        place.made[key] = None
        self._add(1)

    def _start(self, event: Any) -> None:
        if event.tag not in (*_PLAIN, f"{_TAG}map", f"{_TAG}seq"):
            raise self._error(event, f"the tag {event.tag[:60]!r} is not known")
        if len(self._open) >= MOST_DEPTH:
            raise too_deep(self._source, event.start_mark.line + 1)
        self._check_no_key(event)
        if event.anchor:
            self._named[event.anchor] = None
        self._add(1)
        self._open.append(_Open({} if isinstance(event, yaml.MappingStartEvent) else [], event.anchor))

    def _end(self) -> None:
        closed = self._open.pop()
        value = closed.made
        for one in closed.merged:
            value = {**one, **value}
        if closed.anchor:
            self._named[closed.anchor] = _Held(value, closed.size)
        self._place(_Held(value, closed.size))

    def _reference(self, event: Any) -> None:
        self._check_no_key(event)
        if event.anchor not in self._named:
            raise self._error(event, f"'*{event.anchor[:60]}' refers to nothing above it")
        held = self._named[event.anchor]
        if held is None:
            raise self._error(event, f"'*{event.anchor[:60]}' refers to itself")
        self._put(held)

    def _check_no_key(self, event: Any) -> None:
        place = self._open[-1] if self._open else None
        if place is not None and isinstance(place.made, dict) and place.key is None:
            raise self._error(event, "a key is no text")

    def _put(self, held: _Held) -> None:
        self._add(held.size)
        self._place(held)

    def _place(self, held: _Held) -> None:
        if not self._open:
            self._whole.append(held.value)
            return
        place = self._open[-1]
        place.size += held.size
        if isinstance(place.made, list):
            place.made.append(held.value)
        elif place.key == "<<":
            del place.made["<<"]
            place.merged = self._merged(held.value)
        else:
            place.made[place.key] = held.value
        place.key = None

    def _merged(self, value: Any) -> list[dict[str, Any]]:
        found = value if isinstance(value, list) else [value]
        if not found or not all(isinstance(one, dict) for one in found):
            raise GateError(f"{self._source}: '<<' takes a mapping, or a list of mappings")
        return found

    def _add(self, count: int) -> None:
        self._count += count
        if self._count > MOST_YAML_VALUES:
            raise too_many(self._source, MOST_YAML_VALUES)

    def _error(self, event: Any, said: str) -> GateError:
        return GateError(f"{self._source}: line {event.start_mark.line + 1}: {said}")


_CONSTRUCTOR = yaml.constructor.SafeConstructor()
_MAKERS: dict[str, Any] = {
    f"{_TAG}null": yaml.constructor.SafeConstructor.construct_yaml_null,
    f"{_TAG}bool": yaml.constructor.SafeConstructor.construct_yaml_bool,
    f"{_TAG}int": yaml.constructor.SafeConstructor.construct_yaml_int,
    f"{_TAG}float": yaml.constructor.SafeConstructor.construct_yaml_float,
    f"{_TAG}timestamp": yaml.constructor.SafeConstructor.construct_yaml_timestamp,
}
