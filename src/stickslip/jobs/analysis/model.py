"""Parts of an input file that name a model: a parameter set or a fit, and changes of its fields."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from ...physics.actuator import Actuator, load_actuator
from ...quantities.input_file import Strict
from ...quantities.records import quantities_of
from ...quantities.units import QuantityError, to_si
from ...recording.chain import Chain
from .file import AnalysisError
from .results import model_and_chain

Fields = Mapping[str, float | str | bool]


def named_model(folder: Path, name: str) -> Actuator:
    """Return the actuator of a parameter set, by name or by the name of a TOML file in the folder.

    Raises ParameterSetError if there is no such set.
    """
    own = folder / name
    return load_actuator(own if own.suffix == ".toml" and own.is_file() else name)


def with_changes(base: Actuator, change: Fields, friction: Mapping[str, float | str]) -> Actuator:
    """Return the actuator with some fields of the actuator and of its friction law changed.

    Args:
        base: the actuator.
        change: new values of the actuator's fields by name, in SI or with units.
        friction: new values of fields of its friction law by name, in SI or with units. If `change` makes the
            actuator rotary, the units are those of a rotary one (N m, rad).

    Raises:
        QuantityError: a field does not exist, or its value is wrong.
    """
    if "law" in friction:
        raise QuantityError(
            f"friction.law: only fields of {type(base.friction).__name__} change here; another law has a "
            "parameter set of its own, model: FILE.toml (stickslip new actuator writes one to be changed)"
        )
    known = quantities_of(base.friction, base._replace(rotary=bool(change.get("rotary", base.rotary))))
    law = {name: to_si(x, known[name].unit, name) if name in known else x for name, x in friction.items()}
    changes: dict[str, Any] = {**change, "friction": base.friction._replace(**law)}
    return base.replace(**changes)


class Changes(Strict):
    """Changes of a model: `change` sets fields of the actuator, `friction` fields of its friction law."""

    change: dict[str, float | str | bool] = Field(default_factory=dict)
    friction: dict[str, float | str] = Field(default_factory=dict)


class NamedModel(Changes):
    """Model from the parameter set `model` (a name or a TOML file), with changed fields."""

    model: str

    def load_model(self, folder: Path) -> Actuator:
        """Return the model with its changed fields; `folder` is the folder of the input file.

        Raises ParameterSetError if there is no such set, and QuantityError for a wrong field.
        """
        return with_changes(named_model(folder, self.model), self.change, self.friction)


class ModelOrFit(Changes):
    """Model from `fit` or from the parameter set `model`; `change` and `friction` change its fields.

    `fit` is the path of a results.json of an identification, or of a fit saved by `save_fit`.
    """

    fit: str | None = None
    model: str | None = None

    def load_model(self, folder: Path) -> Actuator:
        """Return the model with its changed fields; `folder` is the folder of the input file.

        Raises AnalysisError unless exactly one of `fit` and `model` is given, or if the file of the fit has
        no model. Further errors are ParameterSetError and QuantityError.
        """
        return self.load_model_and_chain(folder)[0]

    def load_model_and_chain(self, folder: Path) -> tuple[Actuator, Chain]:
        """Return the model and the signal chain of the position channel (its delay and scale).

        Without a fit, or if its file contains no chain, the chain is the default one without delay. Raises
        the errors of `load_model`.
        """
        if (self.fit is None) == (self.model is None):
            raise AnalysisError(
                "there must be either 'model', a parameter set, or 'fit', a results.json or a saved fit"
            )
        if self.fit is None:
            base, chain = named_model(folder, str(self.model)), Chain()
        else:
            base, chain = model_and_chain(folder / self.fit)
        return with_changes(base, self.change, self.friction), chain
