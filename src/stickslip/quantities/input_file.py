"""Common rules of input files in YAML, as pydantic schemas: quantities with units, no unknown keys, errors in
one line."""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Sequence
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, get_args, get_type_hints

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ..gate.errors import GateError
from ..gate.text import parsed
from ..gate.yaml_text import load_yaml as gate_yaml
from .places import assignment, place_of
from .records import Field as RecordField
from .records import did_you_mean, fields_with_quantity
from .units import ANGLE, QuantityError, to_si

T = TypeVar("T")
_UNKNOWN = "unknown_field"
_TAG = ("union_tag_invalid", "union_tag_not_found")
_NAMED = (_UNKNOWN, *_TAG)  # pydantic's types of errors for which `reason` names the key in its message


class InputFileError(ValueError):
    """Error: an input file cannot be used. The message names the file and the field."""


def quantity(unit: str) -> BeforeValidator:
    """Return the annotation that makes a schema's field a quantity.

    The file gives a number in the SI `unit`, or a text with another unit, such as "30.7 g"; the field is the
    number in SI.
    """

    def convert(value: Any, info: ValidationInfo) -> float:
        return to_si(value, unit, str(info.field_name))

    return BeforeValidator(convert, json_schema_input_type=float | str)


Seconds = Annotated[float, quantity("s")]
Hertz = Annotated[float, quantity("Hz")]


class Strict(BaseModel):
    """Base of the schemas of parts of a file, in which unknown keys are errors.

    An unknown key is reported before all other errors, because a mistyped key is often their cause.
    """

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


class NullIsDefault(Strict):
    """Base of the schemas in which null means the default of a field that has one."""

    @model_validator(mode="before")
    @classmethod
    def _without_null(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        optional = [name for name, field in cls.model_fields.items() if not field.is_required()]
        return {key: value for key, value in content.items() if value is not None or key not in optional}


class RecordFields(NullIsDefault):
    """Base of the schemas that `fields_of` makes: a part of a file with fields of a record."""

    of_record: ClassVar[tuple[str, ...]] = ()

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    @property
    def given(self) -> dict[str, Any]:
        """Return the values of the record's fields that the file gives, by name, without defaults."""
        return {name: getattr(self, name) for name in self.of_record if name in self.model_fields_set}


@functools.cache
def fields_of(record: type, *names: str) -> type[RecordFields]:
    """Return the schema of a part of a file that gives some fields of a record.

    Each value is a number, or a text with a unit, in the range that the record declares. Instead of a length
    the file may give an angle, because this part of the file does not say whether the actuator is rotary.
    Values of such a field are therefore converted only when the record is constructed.

    Args:
        record: class of the record, whose fields declare a `Quantity`.
        names: names of the fields; by default all. A field without a default must be given.
    """
    hints, known = get_type_hints(record, include_extras=True), fields_with_quantity(record)
    of_record = names or tuple(record._fields)  # type: ignore[attr-defined]
    defaults = record._field_defaults  # type: ignore[attr-defined]
    fields: dict[str, Any] = {}
    for name in of_record:
        kind = _number(name, known[name]) if name in known else _with_parts(hints[name])
        fields[name] = (kind, _default(defaults[name]) if name in defaults else ...)
    made = create_model(
        record.__name__, __base__=RecordFields, __doc__=record.__doc__, __module__=record.__module__, **fields
    )
    made.of_record = of_record
    return made


def _default(value: Any) -> Any:
    """Return the default of a field in the form that pydantic takes. Infinity, NaN and records, for which
    JSON has no value, are not shown in the JSON schema."""
    endless = isinstance(value, float) and not math.isfinite(value)
    return Field(default_factory=lambda: value) if endless or hasattr(value, "_fields") else value


def _number(name: str, field: RecordField) -> Any:
    """Return the pydantic type of a record's field that has a `Quantity`. It checks unit and range, and
    allows an angle instead of a length. `name` is the name of the field, for messages."""
    quantity = field.quantity
    turned = field._replace(quantity=quantity.along(ANGLE))

    def read(value: Any) -> Any:
        try:
            found = field.check(value, name)
        except QuantityError as error:
            try:
                turned.check(value, name)
            except QuantityError:
                raise error from None
            return value
        return found if turned == field else value

    bounds = {
        "minimum": quantity.minimum,
        "exclusiveMinimum": quantity.above,
        "maximum": quantity.maximum,
        "exclusiveMaximum": quantity.below,
    }
    shown = {key: bound for key, bound in bounds.items() if bound is not None and math.isfinite(bound)}
    one: dict[str, Any] = {"anyOf": [{"type": "number", **shown}, {"type": "string"}]}
    schema = {"type": "array", "items": one} if field.sequence else one
    return Annotated[
        Any,
        PlainValidator(read),
        WithJsonSchema({**schema, "description": quantity.meaning, "unit": quantity.unit}),
    ]


def _with_parts(kind: Any) -> Any:
    """Return the pydantic type of a record's field without a `Quantity`, from its annotation `kind`. A
    record, or a record that may be None, becomes a `Part`; other annotations are returned unchanged."""
    kinds = [one for one in get_args(kind) or (kind,) if one is not NoneType]
    if len(kinds) > 1 or not hasattr(kinds[0], "_fields"):
        return kind
    part: Any = Annotated[kinds[0], RecordPart()]
    return part | None if NoneType in get_args(kind) else part


class RecordPart:
    """Annotation of a schema's field that is a record: the file gives the record's fields as a mapping.

    Args:
        without: names of fields of the record that the file does not give here.
    """

    def __init__(self, *, without: tuple[str, ...] = ()) -> None:
        self._without = without

    def __get_pydantic_core_schema__(self, record: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        names = [name for name in record._fields if name not in self._without]

        def make(content: Any, read: Any) -> Any:
            return content if isinstance(content, record) else record(**read(content).given)

        return core_schema.no_info_wrap_validator_function(
            make,
            handler.generate_schema(fields_of(record, *names)),
            serialization=core_schema.plain_serializer_function_ser_schema(_as_content),
        )


# Annotation of a schema's field that is a record: ``slip: Part[Slip] = Field(default_factory=Slip)``.
Part = Annotated[T, RecordPart()]


def _as_content(value: Any) -> Any:
    """Return a value as it is written in a file: a record as a mapping of its fields by name (records in it,
    too), infinity and NaN as text."""
    if hasattr(value, "_asdict"):
        return {name: _as_content(one) for name, one in value._asdict().items()}
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def load_yaml(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> dict[str, Any]:
    """Return the content of a YAML file, with changes.

    Args:
        path: path of the file.
        changes: texts "FIELD=VALUE", as for ``--set``. Dots separate nested fields, the elements of a list
            are numbered from 0, and values are YAML ("recordings.0.use=verify").

    Raises:
        InputFileError: the file cannot be read, is no YAML, or is no mapping; a change names no place in it.
    """
    try:
        found = parsed(gate_yaml, path)
    except GateError as error:
        raise InputFileError(str(error)) from error
    except OSError as error:
        raise InputFileError(f"{path}: {error.strerror or error}") from error
    content = _mapping(found, str(path))
    for change in changes:
        _change(content, change)
    return content


def _change(content: dict[str, Any], change: str) -> None:
    """Set one value in the `content` of a file, in place, by a text "FIELD=VALUE" as `load_yaml` describes;
    create missing mappings that lead to the field.

    Raises:
        InputFileError: the text is not "FIELD=VALUE", or its field is no place in the content.
    """
    try:
        name, text = assignment("--set", change, "FIELD=VALUE, or FIELD.FIELD=VALUE")
        value = yaml_mapping(f"value: {text}", f"--set {change}")["value"]
        place, key = place_of(content, name.split("."))
    except QuantityError as error:
        said = str(error)
        raise InputFileError(said if said.startswith("--set") else f"--set {change}: {said}") from None
    place[key] = value


def yaml_mapping(text: bytes | str, source: str) -> dict[str, Any]:
    """Return the content of a YAML text; `source` is its name in errors.

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
        raise InputFileError(
            f"{source}: the file must be a mapping, with 'title' and so on; "
            "`stickslip new campaign RECORDING...` writes one for recordings"
        )
    return found


def yaml_text(content: dict[str, Any]) -> str:
    """Return the content of a file as YAML text, with the keys in their given order."""
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def explain(
    path: str | os.PathLike[str], error: ValidationError, inside: str = "", *, content: Any
) -> InputFileError:
    """Return an error for a file in one line: the first unknown key, or else the first error of the schema.

    Args:
        path: path of the file.
        error: all errors of the schema; the message gives the number of those that it does not show.
        inside: place of the content in the file, such as "steps.0.", if only a part of the file was checked.
        content: content that was checked; only keys that it contains are shown as the place of the error.
    """
    found = error.errors(include_url=False)
    first = next((one for one in found if one["type"] == _UNKNOWN), found[0])
    place = _keys(content, first["loc"]) + [
        str(part) for part in first["loc"][-1:] if first["type"] == "missing"
    ]
    # An error without a place concerns the whole file; it is then shown at the key "kind".
    where = (inside + ".".join(place)).rstrip(".") or ("" if first["type"] in _NAMED else "kind")
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    message = f"{reason(first)}{more}"
    if first["type"] in _NAMED and not place[1:] and "did you mean" not in message:
        message += _other_command(content)
    return InputFileError(": ".join(filter(None, (str(path), where, message))))


def _other_command(content: Any) -> str:
    """Return a sentence that names the command for which a file seems to be written, judged by its keys; ""
    if no command fits."""
    keys = set(content) if isinstance(content, dict) else set()
    kinds = {
        "study": "measure" in keys,
        "run": "steps" in keys,
        "record": {"runs", "channels"} <= keys,
        "move": "target" in keys,
        "identify": "kind" in keys,
        "campaign": "recordings" in keys,
    }
    found = next((command for command, shown in kinds.items() if shown), None)
    return f". This looks like a file for `stickslip {found}`" if found else ""


def reason(error: Any) -> str:
    """Return the message of one error (an item of pydantic's `errors()`), without its place in the file.
    Messages of QuantityError, and about wrong words, are those of this package; others are pydantic's."""
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, QuantityError):
        return str(cause)
    return _about_kind(error) or _about_choice(error) or error["msg"]


def _about_kind(error: Any) -> str:
    """Return the message for an error of pydantic about the key that selects the schema of a part, such as
    "kind", if the key is missing or has an unknown value; "" for other errors."""
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
    """Return the message for an error of pydantic about a value that must be one of a few words; "" for other
    errors."""
    if error["type"] != "literal_error":
        return ""
    words = re.findall("'([^']*)'", error["ctx"]["expected"])
    return f"{error['input']!r}{did_you_mean(str(error['input']), words)}: it is {error['ctx']['expected']}"


def _keys(content: Any, place: Sequence[int | str]) -> list[str]:
    """Return the parts of an error's location that are keys or indices of the content, as texts.

    pydantic's location also has names of alternatives (of a union), which are left out.
    """
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
