"""Model of a fitted actuator, from the results that a command wrote."""

from __future__ import annotations

from pathlib import Path

from ...gate.errors import damaged
from ...gate.text import read_json
from ...identify.results import chain_of, model_of
from ...identify.saved import FORMAT, load_fit
from ...identify.walk.prediction import Predictor
from ...physics.actuator import Actuator
from ...recording.chain import Chain
from .file import AnalysisError


def model_and_chain(path: Path) -> tuple[Actuator, Chain]:
    """Return the actuator of a results.json or of a saved fit, and the chain of its position channel.

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
            numbers = content["numbers"]
            return model_of(numbers["model"]), chain_of(numbers)
        except KeyError as error:
            raise AnalysisError(
                f"{said}: there is no {error} in it; what stickslip identify, campaign or run has written of "
                "a walk holds one"
            ) from error
