"""Conversion of a results.json of an identification to a parameter set, and its summary."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...gate.text import read_json
from ...identify.results import numbers_of_fit
from ...parameters.writing import parameter_text
from ...quantities.registry import use_file
from ...quantities.units import QuantityError
from .results import model_and_chain


def fit_parameters(path: Path, title: str, source: str, used: Sequence[str] = ()) -> str:
    """Return a parameter set, as TOML text, with the fitted values and standard errors of a results.json.

    Args:
        path: path of the results.json.
        title: title of the set.
        source: origin of the values, which the set states for each.
        used: paths of the user's own Python files, which are run first: the results may name their laws.

    Raises:
        AnalysisError, QuantityError: the file does not contain a fit with a model.
    """
    for file in used:
        use_file(file)
    model, _ = model_and_chain(path)
    try:
        found = numbers_of_fit(read_json(path)["numbers"]).get("parameters", {}).items()
    except (LookupError, TypeError, AttributeError):
        raise QuantityError("its results.json holds no mapping of parameters") from None
    known = {name: one.get("standard_error") for name, one in found if isinstance(one, dict)}
    errors = {name: float(one) for name, one in known.items() if isinstance(one, int | float)}
    return parameter_text(model, title, source, errors)


def results_summary(path: Path) -> str:
    """Return the summary of a results.json, a few sentences; "" if it has none."""
    return str(read_json(path).get("summary", ""))
