"""Models and waveforms for the command line: a parameter set, and a drive, with the changes of --set and
--law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..physics.actuator import Actuator, PulledSlider
    from ..waveform.signal import Waveform

# Fields of waveforms that have a command-line option of their own; all other fields are set by --set.
OPTIONS = ("amplitude", "frequency", "periods")
_OWNERS = ("friction", "waveform")
_WRITE = "FIELD=VALUE, friction.FIELD=VALUE or waveform.FIELD=VALUE"
_LAW = "another law is --law {value}; a value of the law, --set friction.FIELD=VALUE"
# Names that --set does not accept although users may try them, each with the advice for the error message.
# "{value}" in the advice is replaced by the given value.
_ELSEWHERE = {
    "friction": _LAW,
    "law": _LAW,
    "friction.law": _LAW,
    "name": "the name is that of the parameter set, which comes first: stickslip simulate {value}",
    "waveform": "another drive is --waveform {value}; a field of it, --set waveform.FIELD=VALUE",
    **{name: f"of the drive it is --{name} '{{value}}'" for name in OPTIONS},
}


def parts_of(changes: list[str]) -> dict[str, dict[str, str]]:
    """Return the values given by --set as {part: {field: text}}, for the parts "model", "friction" and
    "waveform".

    `changes` are texts such as "friction.sigma_0=1e6"; a field without "friction." or "waveform." belongs to
    the model.

    Raises:
        ValueError: a text has another form, or a field is set by another option.
    """
    from ..quantities.places import assignment

    parts: dict[str, dict[str, str]] = {"model": {}, **{owner: {} for owner in _OWNERS}}
    for change in changes:
        path, value = assignment("--set", change, _WRITE)
        owner, dot, field = path.rpartition(".")
        if not field or (dot and owner not in _OWNERS):
            raise ValueError(f"--set {change}: write {_WRITE}")
        if path in _ELSEWHERE:
            raise ValueError(f"--set {change}: {_ELSEWHERE[path].format(value=value)}")
        parts[owner or "model"][field] = value
    return parts


def model_of(name: str) -> Actuator | PulledSlider:
    """Load the model of a parameter set, by its name or file: an actuator or a pulled slider.

    Raises:
        ParameterSetError: there is no such set, or the file is wrong.
    """
    from ..parameters import load_set
    from ..physics.actuator import load_actuator, load_pulled_slider

    return load_pulled_slider(name) if load_set(name).kind == "pulled_slider" else load_actuator(name)


def changed_model(
    parameters: str, changes: dict[str, str], friction: dict[str, str], law_name: str = ""
) -> Actuator | PulledSlider:
    """Return the model of a parameter set with changed values.

    Args:
        parameters: name or file of the parameter set.
        changes: new values of fields of the model by name, as texts with or without units.
        friction: new values of fields of the friction law by name, likewise.
        law_name: another friction law, which keeps the values that both laws have; "" for the set's law.

    Raises:
        ParameterSetError: there is no such set, or the file is wrong.
        ValueError: a field is unknown or missing, a value is out of range, or there is no such law.
    """
    from ..quantities import registry

    model = model_of(parameters)
    given = {field: _read(text, model.friction, field) for field, text in friction.items()}
    if law_name:
        kind = registry.laws.find(law_name)
        kept = {field: value for field, value in model.friction._asdict().items() if field in kind._fields}
        law = kind(**kept | given)
    else:
        law = model.friction._replace(**given)
    return model.replace(
        **{field: _read(text, model, field) for field, text in changes.items()}, friction=law
    )


def _read(text: str, record: Any, field: str) -> Any:
    """Return a text of the command line as a value for a field of a record (model or law): True or False for
    a flag, a list of texts for a field with several numbers, otherwise the text itself. The record checks the
    value later."""
    now = getattr(record, field, None)
    if isinstance(now, bool):
        return {"true": True, "yes": True, "false": False, "no": False}.get(text.lower(), text)
    return text.split(",") if isinstance(now, tuple) else text


def shape_of(name: str) -> Any:
    """Return the waveform class for a name such as "reverse-sawtooth", "ReverseSawtooth" or "FILE.py:NAME".
    Raises RegistryError, a ValueError, for an unknown name."""
    from ..quantities.registry import own_path
    from ..waveform.signal import shape

    if name.islower() and not own_path(name)[0]:
        return shape("".join(word.capitalize() for word in name.split("-")))
    return shape(name)


def drive_of(name: str, model: Actuator | PulledSlider, fields: dict[str, str]) -> Waveform:
    """Return the waveform that drives a model.

    The drive of an actuator is a voltage [V], that of a pulled slider a position [m].

    Args:
        name: name of the waveform's type, as for `shape_of`.
        model: the model, which determines the unit of the drive.
        fields: fields of the waveform by name, as texts with or without units.

    Raises:
        ValueError: a field is missing (the message names its option) or wrong, or there is no such type.
    """
    from ..physics.actuator import Actuator
    from ..quantities.records import quantities, sequences

    made = shape_of(name)
    unit = "V" if isinstance(model, Actuator) else "m"
    for field, quantity in quantities(made).items():
        if field not in fields and field not in made._field_defaults:
            option = f"--{field}" if field in OPTIONS else f"--set waveform.{field}=..."
            what = f"{quantity.meaning} of the {name}, in {quantity.unit.replace('V', unit)}"
            raise ValueError(f"{option} is missing: {what}")
    many = sequences(made)
    given = {key: text.split(",") if key in many else text for key, text in fields.items()}
    return made(**given, unit=unit)


def names_to_set(parameters: str, law_name: str, waveform: str) -> list[str]:
    """Return the names of the fields that --set accepts, such as "end_effector_mass", "friction.sigma_0" or
    "waveform.offset".

    Args:
        parameters: name or file of the parameter set.
        law_name: name of another friction law; "" for the set's law.
        waveform: name of the drive's type.
    """
    from ..quantities import registry
    from ..quantities.records import quantities

    model = model_of(parameters)
    law = registry.laws.find(law_name) if law_name else type(model.friction)
    drive = quantities(shape_of(waveform))
    return [
        *(name for name, value in model._asdict().items() if _is_settable(model, name, value)),
        *(f"friction.{name}" for name in quantities(law)),
        *(f"waveform.{name}" for name in drive if name not in OPTIONS),
    ]


def _is_settable(model: Any, name: str, value: Any) -> bool:
    from ..quantities.records import quantities

    return name in quantities(type(model)) or isinstance(value, bool)
