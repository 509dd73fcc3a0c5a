"""Model to export, from any kind of input, and for each of its values the unit, meaning and source."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..estimate.result import Fit
from ..gate.errors import GateError, damaged
from ..gate.results import results_numbers
from ..identify.results import chain_of, model_of, numbers_of_fit
from ..parameters import ParameterSetError, load_set
from ..physics.actuator import Actuator, PulledSlider, load_actuator, load_pulled_slider
from ..quantities.records import quantities_of
from ..recording.chain import Chain
from .piezo import refused


class ExportError(ValueError):
    """Error: a model cannot be exported, or not to this folder; the message says why."""


class Exported(NamedTuple):
    """A model to export.

    `sources` has the source of each value of the model in words, by field such as "friction.sigma_0". `chain`
    is the signal chain of the position channel, or None if no fit to recordings determined one.
    """

    model: Any
    sources: dict[str, str]
    chain: Chain | None = None


def exported(source: Any) -> Exported:
    """Return the model to export, with the sources of its values.

    Args:
        source: name or file of a parameter set, path of a results.json, a `Fit`, an `Actuator` or a
            `PulledSlider`.

    Raises:
        ExportError: the source has no actuator, is of another kind, or its model has unsupported parts.
        ParameterSetError, QuantityError: a file is missing or wrong.
    """
    model = getattr(source, "model", source)
    _refuse(model)
    if isinstance(source, Actuator | PulledSlider):
        return Exported(source, _sources(source, {}))
    if isinstance(source, Fit):
        if not isinstance(source.model, Actuator | PulledSlider):
            raise ExportError(
                f"this fit describes no actuator but {type(source.model).__name__}: export a fit of "
                "identify_friction, or put its values into an Actuator"
            )
        errors = source.standard_errors
        fitted = {
            name: f"fitted, r^2 {source.r_squared:.4f}, standard error {errors[name]:.3g}"
            for name in source.values
        }
        own = getattr(getattr(source.predict, "__self__", None), "chain", None)
        return Exported(source.model, _sources(source.model, fitted), own)
    if not isinstance(source, str | os.PathLike):
        raise ExportError(
            f"a {type(source).__name__} cannot be exported: give an Actuator, a PulledSlider, a Fit, the "
            "name or file of a parameter set, or a results.json"
        )
    text = os.fspath(source)
    if text.endswith(".json"):
        return _of_results(Path(text))
    kind = load_set(text).kind
    if kind == "friction":
        raise ExportError(f"{text} is a friction law alone; export an actuator that has it")
    return exported(load_pulled_slider(text) if kind == "pulled_slider" else load_actuator(text))


def _refuse(model: Any) -> None:
    """Raise ExportError for a model with parts that exported code does not support.

    These parts are some piezo models (`refused`), and a normal force that varies along the stroke.
    """
    said = refused(getattr(model, "piezo", None))
    if not said and getattr(model, "normal_force", None) is not None:
        said = "a normal force along the stroke is not part of exported code: set normal_force to None"
    if said:
        raise ExportError(said)


def _of_results(file: Path) -> Exported:
    """Read the actuator that ``stickslip identify`` wrote into a results.json.

    The sources of fitted values have their standard errors; the signal chain is read if the file has one.

    Raises:
        ExportError: the file cannot be read, is damaged, or has no model of a walk, or the model has parts
            that exported code does not support.
    """
    try:
        numbers = numbers_of_fit(results_numbers(file))
        found = numbers["model"]
    except OSError as error:
        raise ExportError(f"{file} cannot be read: {error.strerror}") from error
    except (GateError, KeyError):
        raise ExportError(
            f"{file} holds no actuator: only the fit of a walk (kind: walk) gives one that can be exported"
        ) from None
    with damaged(ExportError, str(file)):
        model = model_of(found)
        chain = chain_of(numbers) if "signal_chain" in numbers else None
        fitted = {
            name: f"fitted, standard error {entry['standard_error']:.3g}"
            for name, entry in numbers.get("parameters", {}).items()
            if entry.get("standard_error") is not None
        }
    _refuse(model)
    return Exported(model, _sources(model, fitted), chain)


def _sources(model: Any, fitted: dict[str, str]) -> dict[str, str]:
    """Return the source of each value of a model in words, by field.

    Args:
        model: actuator or pulled slider; its parameter set, if it has one, is read again for the sources.
        fitted: source of each fitted value by the last part of its field, such as "sigma_0".

    Returns:
        A text such as "fitted, ...", "ASSUMED: ...", a citation, "default" or "given by hand", by field.
    """
    load = load_actuator if isinstance(model, Actuator) else load_pulled_slider
    parameters, original = None, {}
    if model.name:
        with suppress(ParameterSetError):  # the set's file may have been deleted since the model was loaded
            parameters = load_set(model.name)
            original = exported_values(load(model.name))
    found = {}
    for name, value in exported_values(model).items():
        entry = parameters.entries().get(name) if parameters else None
        if name.rpartition(".")[2] in fitted:
            found[name] = fitted[name.rpartition(".")[2]]
        elif parameters is None:
            found[name] = "given by hand"
        elif name not in original or not _same(value, original[name]):
            found[name] = f"changed since {model.name} was loaded"
        elif entry is None:
            found[name] = "default"
        elif entry.assumed:
            found[name] = f"ASSUMED: {entry.reason}"
        elif entry.source:
            found[name] = f"{', '.join(parameters.citations)}, {entry.source}"
        else:
            found[name] = "no source given"
    return found


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-12)
    return a == b


def exported_values(model: Any) -> dict[str, Any]:
    """Return the numbers of a model by field, such as "friction.sigma_0" or "piezo.creep.shares".

    A value is a bool, a number, or a tuple of numbers; texts, None and empty tuples are left out.
    """
    found = {}
    for name, value in model._asdict().items():
        if hasattr(value, "_fields"):
            found |= {f"{name}.{inner}": v for inner, v in exported_values(value).items()}
        elif isinstance(value, bool | int | float | tuple) and value != ():
            found[name] = value
    return found


def meaning(model: Any, name: str) -> tuple[str, str, str]:
    """Return unit, symbol and meaning of the value `name`, a key of `exported_values`.

    Unit and symbol may be "". A value that is no declared quantity, such as a bool, has its name as meaning.
    """
    path, _, field = name.rpartition(".")
    owner = model
    for part in path.split(".") if path else ():
        owner = getattr(owner, part)
    spec = quantities_of(owner, model).get(field)
    if spec is None:
        return "", "", field.replace("_", " ")
    return spec.unit, spec.symbol, spec.meaning
