"""The function `view`, which makes the document of a result for reports, notebooks and terminals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, singledispatch
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from ..quantities.units import QuantityError
from . import views
from .document import Document


def view(result: Any, title: str = "") -> Document:
    """Return the document of a result: a summary, sections with tables and figures, and every number.

    A notebook shows it as a page, ``print`` as text; `report.write_report` writes it as ``report.html`` and
    ``results.json``.

    Args:
        result: a `Fit`, a `Verification`, a `Comparison` of models, `Conditions` or a `Posterior`; a result
            of `step_map`, `plan_experiment`, `optimise_waveform`, `waveform_front`, `optimise_actuator`,
            `from_data_sheet`, `tune` or `fit_steps`; a recording, a trajectory or a frequency response.
        title: title of the document; by default that of the kind of result.

    Raises:
        QuantityError: there is no view of this type, or a Dataset cannot be drawn.
    """
    _register_views()
    made = document_of(result)
    return replace(made, title=title) if title else made


@cache
def _register_views() -> None:
    """Import all modules of `views`, so that each registers the types that it shows with `document_of`."""
    for module in iter_modules(views.__path__):
        import_module(f"{views.__name__}.{module.name}")


@singledispatch
def document_of(result: Any) -> Document:
    """Return the document of a result by its type; ``document_of.register`` adds a user's type.

    The package's own types are known after the first call of `view`. Raises QuantityError for a type without
    a view.
    """
    known = sorted(kind.__name__ for kind in document_of.registry if kind is not object)
    raise QuantityError(f"there is no view of {type(result).__name__}: there are views of {', '.join(known)}")
