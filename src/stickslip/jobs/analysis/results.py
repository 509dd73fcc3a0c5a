"""Reading of results.json files: the model of a fitted actuator in them, and their JSON Schema."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from ...gate.errors import damaged
from ...gate.text import read_json
from ...identify.results import chain_of, model_of, numbers_of_fit
from ...identify.saved import FORMAT, load_fit
from ...identify.walk.prediction import Predictor
from ...physics.actuator import Actuator
from ...recording.chain import Chain
from ...report.results import Results
from .file import AnalysisError


def model_and_chain(path: Path) -> tuple[Actuator, Chain]:
    """Return the actuator of a results.json or of a saved fit, and the signal chain of its position channel.

    Raises:
        AnalysisError: the file does not contain a fit with a model.
    """
    said = f"{path}: no results of an identification with a model"
    with damaged(AnalysisError, said):
        content = read_json(path)
        if content.get("format") == FORMAT:
            predictor = getattr(load_fit(path).predict, "__self__", None)
            if not isinstance(predictor, Predictor):
                raise ValueError("it is a saved fit, but of no walk")
            return predictor.model, predictor.chain
        try:
            numbers = numbers_of_fit(content["numbers"])
            return model_of(numbers["model"]), chain_of(numbers)
        except KeyError as error:
            raise AnalysisError(
                f"{said}: there is no {error} in it; what stickslip identify, campaign or run has written of "
                "a walk holds one"
            ) from error


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of results.json, made from the record types that write it."""
    schema = TypeAdapter(Results).json_schema()
    defined = schema["$defs"]
    numbers = {"$ref": "#/$defs/Numbers"}
    defined["Numbers"] = {
        "description": "Quantities and texts by name, at any depth. What has a value is a quantity.",
        "anyOf": [
            {"$ref": "#/$defs/Quantity"},
            {"type": "object", "not": {"required": ["value"]}, "additionalProperties": numbers},
            {"type": ["string", "boolean", "null"]},
            {"type": "array", "items": {"type": "string"}},
        ],
    }
    schema["properties"]["numbers"]["additionalProperties"] = numbers
    null = {"properties": {"value": {"const": None}}}
    defined["Quantity"] |= {"if": null, "then": {"required": ["reason"]}}
    for closed in (schema, defined["WrittenTable"], defined["WrittenColumn"]):
        closed["additionalProperties"] = False
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema
