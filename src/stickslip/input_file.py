"""Common rules of input files in YAML: quantities with units, no unknown keys, errors in one line."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import Annotated, Any

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from .gate.errors import GateError
from .gate.text import parsed
from .gate.yaml_text import load_yaml as gate_yaml
from .records import did_you_mean
from .units import QuantityError, to_si

_UNKNOWN = "unknown_field"
_TAG = ("union_tag_invalid", "union_tag_not_found")
_NAMED = (_UNKNOWN, *_TAG)  # errors that name the key themselves


class InputFileError(ValueError):
    """An input file that cannot be used; the message names the file and the field."""


def quantity(unit: str) -> BeforeValidator:
    """Makes a field a quantity: a number in SI, or a text with a unit such as "30.7 g"."""

    def convert(value: Any, info: ValidationInfo) -> float:
        return to_si(value, unit, str(info.field_name))

    return BeforeValidator(convert, json_schema_input_type=float | str)


Seconds = Annotated[float, quantity("s")]
Hertz = Annotated[float, quantity("Hz")]


class Strict(BaseModel):
    """A part of a file: unknown keys are errors, and told before anything else, for they explain the rest."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _known(cls, content: Any) -> Any:
        for key in content if isinstance(content, dict) else ():
            if key not in cls.model_fields:
                hint = (
                    did_you_mean(str(key), cls.model_fields) or f"; there are {', '.join(cls.model_fields)}"
                )
                raise PydanticCustomError(
                    _UNKNOWN, "{said}", {"said": f"there is no field {str(key)!r}{hint}"}
                )
        return content


def load_yaml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the content of a YAML file.

    Raises:
        InputFileError: the file cannot be read, is no YAML, or is no mapping.
    """
    try:
        found = parsed(gate_yaml, path)
    except GateError as error:
        raise InputFileError(str(error)) from error
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    return _mapping(found, str(path))


def yaml_mapping(text: bytes | str, source: str) -> dict[str, Any]:
    """Return the content of a YAML text; `source` is what errors call it.

    Raises:
        InputFileError: the text is no YAML, or no mapping.
    """
    try:
        found = gate_yaml(text, source)
    except GateError as error:
        raise InputFileError(str(error)) from error
    return _mapping(found, source)


def _mapping(found: Any, source: str) -> dict[str, Any]:
    if not isinstance(found, dict):
        raise InputFileError(f"{source}: the file must be a mapping, with 'title' and so on")
    return found


def yaml_text(content: dict[str, Any]) -> str:
    """The YAML of a file's content, in the order that it has."""
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def explain(
    path: str | os.PathLike[str], error: ValidationError, inside: str = "", *, content: Any
) -> InputFileError:
    """What is wrong in a file, in one line: a mistyped key, else the first thing.

    Args:
        path: of the file.
        error: what the schema says.
        inside: where in the file the content is, "steps.0.".
        content: what was checked: the place is told by its keys, not by the schema's names of alternatives.
    """
    found = error.errors(include_url=False)
    first = next((one for one in found if one["type"] == _UNKNOWN), found[0])
    place = _keys(content, first["loc"]) + [
        str(part) for part in first["loc"][-1:] if first["type"] == "missing"
    ]
    # A file that does not say its kind is wrong as a whole: there is no field to name.
    where = (inside + ".".join(place)).rstrip(".") or ("" if first["type"] in _NAMED else "kind")
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    cause = first.get("ctx", {}).get("error")
    text = (
        str(cause)
        if isinstance(cause, QuantityError)
        else _about_kind(first) or _about_choice(first) or first["msg"]
    )
    return InputFileError(": ".join(filter(None, (str(path), where, f"{text}{more}"))))


def _about_kind(error: Any) -> str:
    """What is wrong with the key that says which of several kinds a part is; "" for other errors."""
    if error["type"] not in _TAG:
        return ""
    key = error["ctx"]["discriminator"].strip("'")
    if error["type"] == "union_tag_invalid":
        kinds = [one.strip("'") for one in error["ctx"]["expected_tags"].split(", ")]
        tag = error["ctx"]["tag"]
        return f"there is no {key} {tag!r}{did_you_mean(tag, kinds)}; there are {', '.join(kinds)}"
    given = error["input"] if isinstance(error["input"], dict) else {}
    wrong = next((one for one in map(str, given) if did_you_mean(one, [key])), None)
    return f"there is no field {wrong!r} (did you mean {key!r}?)" if wrong else f"{key} is missing"


def _about_choice(error: Any) -> str:
    """What is wrong with a value that must be one of a few words; "" for other errors."""
    if error["type"] != "literal_error":
        return ""
    words = re.findall("'([^']*)'", error["ctx"]["expected"])
    return f"{error['input']!r}{did_you_mean(str(error['input']), words)}: it is {error['ctx']['expected']}"


def _keys(content: Any, place: Sequence[int | str]) -> list[str]:
    """Of a place in a schema those parts that are keys of the content: the others name alternatives."""
    found = []
    for part in place:
        if (
            part in content
            if isinstance(content, dict)
            else isinstance(content, list) and isinstance(part, int)
        ):
            content = content[part]  # type: ignore[index]
            found.append(str(part))
    return found
