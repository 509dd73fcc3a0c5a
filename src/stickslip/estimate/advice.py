"""Advice after a fit that does not explain its recordings: the term that the model lacks, and how to add
it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..quantities.units import with_prefix


class Advice(NamedTuple):
    """Missing term of a model, and how to add it.

    Attributes:
        cause: missing term, such as "viscous friction"; "" if no tried term helps.
        explains: True if the recordings show no lack of fit with the term.
        before, after: residual without and with the term: the rms residual in `unit` or, if `unit` is "", the
            greatest ratio of a recording's residual to its noise. Both are equal if no term helps.
        free: names of all free parameters of the model with the term, without those of the position channel
            (delay, offset); `added`: names of the parameters that become free with the term.
        bounds: lower and upper bound in SI of each added parameter that needs bounds, by name.
        change: new value of each field of the actuator that must change, by the field's name.
        untied: names of the parameters whose tie must be removed.
        values: estimates of all searched parameters in the fit with the term, in SI, by name.
        shown: estimates of the parameters in `free` and `added`, as one text with units.
        tried: terms that were fitted; `seconds`: CPU time spent; `stopped`: True if a time limit ended the
            search.
        equal: advice on other terms that describe the recordings equally well within the noise.
    """

    cause: str
    explains: bool
    before: float
    after: float
    unit: str
    free: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    bounds: Mapping[str, tuple[float, float]] = {}
    change: Mapping[str, Any] = {}
    untied: tuple[str, ...] = ()
    values: Mapping[str, float] = {}
    shown: str = ""
    tried: tuple[str, ...] = ()
    seconds: float = 0.0
    stopped: bool = False
    equal: tuple[Advice, ...] = ()

    @property
    def sentence(self) -> str:
        """Return a sentence with the missing term (or several equally good ones), the effect on the residual
        and the setting that adds it, or with the terms that were tried in vain."""
        if not self.cause:
            return f"nothing that was tried explains the recordings: {', '.join(self.tried)}{self._limit}"
        left = [with_prefix(x, self.unit, 3) if self.unit else f"{x:.3g}" for x in (self.after, self.before)]
        left[1] += "" if self.unit else " x the noise"
        residual = f"residual {left[0]} instead of {left[1]}"
        if self.equal:
            every = (self, *self.equal)
            verdict = f"{' or '.join(one.cause for one in every)}: the recordings do not tell which"
            verdict += " explains them" if self.explains else " helps most, and neither explains them"
            written = "; ".join(f"for {one.cause}{one._found} write {one._written}" for one in every)
            other = "a walk with another frequency or amplitude may tell"
            choose = f"Choose by what is known of the actuator, or {other}"
            return f"{verdict}; {residual}. {choose}: {written}{self._limit}"
        if self.explains:
            verdict = f"{self.cause} explains the recordings"
        else:
            verdict = f"{self.cause} helps most, but does not explain the recordings"
        found = f"; then {self.shown}" if self.shown else ""
        return f"{verdict}: {residual}{found}. Write {self._written}{self._limit}"

    @property
    def _found(self) -> str:
        return f" (then {self.shown})" if self.shown else ""

    @property
    def _written(self) -> str:
        return f"{self.line} in the file, or {self.argument} in Python"

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON: every field by its name (`equal` as a list of such dictionaries), and
        the texts `sentence`, `line` and `argument`."""
        found = {k: dict(v) if isinstance(v, Mapping) else v for k, v in self._asdict().items()}
        found["equal"] = [one.to_dict() for one in self.equal]
        return {**found, "sentence": self.sentence, "line": self.line, "argument": self.argument}

    @property
    def _limit(self) -> str:
        return f" (stopped after {self.seconds:.0f} s of CPU time)" if self.stopped else ""

    @property
    def line(self) -> str:
        """Return the settings that add the term to a campaign or identification file, as YAML in backquotes:
        "`free: [...]` and `bounds: {...}`", and `change` if needed; ties to remove are named in words."""
        said = [f"`free: [{', '.join(self.free)}]`"] if self.added else []
        if self.bounds:
            limits = ", ".join(f"{name}: [{low!r}, {high!r}]" for name, (low, high) in self.bounds.items())
            said.append(f"`bounds: {{{limits}}}`")
        if self.change:
            said.append(f"`change: {json.dumps(dict(self.change)).replace(chr(34), '')}`")
        return " and ".join([*said, *(f"no tie of {name}" for name in self.untied)])

    @property
    def argument(self) -> str:
        """Return the arguments of `identify_friction` that add the term, as Python text such as "free=[...],
        bounds={...}", and the ties to remove, in words."""
        said = [f"model.replace({', '.join(f'{k}={v!r}' for k, v in self.change.items())})"] * bool(
            self.change
        )
        said += [f"free={json.dumps(self.free)}"] * bool(self.added)
        said += [f"bounds={dict(self.bounds)!r}"] * bool(self.bounds)
        return ", ".join([*said, *(f"no {name} in tied" for name in self.untied)])
