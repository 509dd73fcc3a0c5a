"""Whether one set of values explains walks that were fitted and walks that were not, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import xarray as xr

from ...estimate.result import Fit
from ...waveform.signal import Waveform
from ..step.fit import STAGE
from .friction import identify_friction


def explained(
    fit: Fit,
    walks: Sequence[xr.Dataset],
    drives: Sequence[Waveform | None],
    free: Sequence[str],
    **options: Any,
) -> Fit:
    """A fit to all walks, begun at that to some of them: its `lack` is that of the model.

    What one walk leaves open, another may need otherwise: a wrong law that fits one walk within its noise
    seldom fits them all. Errors of the stage are no lack of the friction law, so its values are free too.

    Args:
        fit: of `identify_friction`.
        walks, drives: as for it.
        free: what was fitted.
        options: of `identify_friction`.
    """
    more = [name for name in STAGE if name not in free and name in fit.model._fields]
    begin = {name: fit.values[name] for name in ("delay", "offset") if name in fit.values}
    return identify_friction(
        walks,
        fit.model,
        [*free, *more],
        drive=drives,
        channel=(),
        begin=begin,
        hops=0,
        correlated=False,
        **options,
    )
