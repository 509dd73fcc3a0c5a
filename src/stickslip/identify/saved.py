"""Saving of complete fits as JSON files, and loading."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from .._version import __version__
from ..estimate.advice import Advice
from ..estimate.covariance import Uncertainty
from ..estimate.disturbances import Disturbance
from ..estimate.goodness import Goodness
from ..estimate.judgement import Judgement
from ..estimate.lack import KnownNoise
from ..estimate.minima import Minimum
from ..estimate.parameter import Parameter
from ..estimate.problem import FitError
from ..estimate.result import Fit
from ..estimate.saved import packed, unpacked
from ..estimate.systematic import Systematic
from ..friction import is_law
from ..gate.errors import damaged
from ..gate.text import MOST_RESULT_BYTES, read_json
from ..physics.actuator import Actuator
from ..physics.electronics import Filter
from ..physics.piezo import Piezo
from ..quantities import registry
from ..recording.chain import Chain
from ..recording.replacing import replaced_whole
from .frequency.amplitude import AmplitudeModel
from .frequency.modal import ModalModel
from .loops.response import LoopPrediction
from .piezo.prediction import PiezoPrediction
from .step.fit import StepPrediction
from .walk.prediction import Predictor
from .walk.static import StaticPrediction

FORMAT = "stickslip fit"
_TYPES: tuple[type, ...] = (
    Actuator, Advice, AmplitudeModel, Chain, Disturbance, Filter, Uncertainty, KnownNoise, Minimum,
    Parameter, Fit, Goodness, Judgement, LoopPrediction, ModalModel, Piezo, PiezoPrediction, Predictor,
    StaticPrediction, StepPrediction, Systematic,
)  # fmt: skip


def saved_types() -> dict[str, type]:
    """Return the classes of objects that a saved fit may contain, by class name: the fit, its parts, and the
    package's friction laws and piezo models."""
    return {one.__name__: one for one in _TYPES} | registry.laws.packaged() | registry.piezos.packaged()


def save_fit(fit: Fit, path: str | os.PathLike[str]) -> None:
    """Save a complete fit as a JSON file: values, uncertainty, residuals, and its prediction.

    An existing file is replaced as a whole.

    Raises:
        FitError: the fit contains an object that is no record (such as a user's function), or the file would
            be too large to read. Records of types that `load_fit` does not know raise no error here.
    """
    law = getattr(fit.model, "friction", fit.model)
    said = registry.laws.written(type(law)) if is_law(law) else {}
    try:
        text = json.dumps({"format": FORMAT, "version": __version__, **said, "fit": packed(fit)})
    except TypeError as error:
        raise FitError(f"{path}: {error}") from error
    if len(text) > MOST_RESULT_BYTES:
        raise FitError(
            f"{path}: the fit has {len(text) / 1e6:.0f} MB as a file, and files of up to "
            f"{MOST_RESULT_BYTES / 1e6:g} MB are read again: fit fewer samples of each recording"
        )
    with replaced_whole(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def load_fit(path: str | os.PathLike[str]) -> Fit:
    """Return a fit that `save_fit` wrote, with its prediction and report.

    Raises:
        FitError: the file cannot be read, does not contain a fit, or contains a fit of a user's law that is
            not registered in this program.
    """
    types = saved_types()
    with damaged(FitError, f"{path}: there is no fit in it (ss.save_fit writes one)"):
        content = read_json(path)
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r:.60}, not {FORMAT!r}")
        try:
            if "law_of" in content:
                types[str(content["law"])] = registry.laws.of_results(content)
        except registry.RegistryError as error:
            raise FitError(f"{path}: {error}") from error
        fit = unpacked(content["fit"], types)
        if not isinstance(fit, Fit):
            raise TypeError(f"but a {type(fit).__name__}")
        with np.errstate(all="ignore"):
            repr(fit)  # a report of the fit fails if values, uncertainty and parameters do not match
        return fit
