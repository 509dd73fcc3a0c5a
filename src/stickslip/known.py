"""What is known by name: laws, parameter sets, waveforms, benches, calibrations, published data."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .calibration import load_calibration
from .calibration.storage import available_calibrations
from .datasets import DATASETS
from .friction import LAWS
from .parameters import available_sets, load_set
from .records import did_you_mean
from .rig.bench import available_benches, load_bench
from .units import QuantityError
from .waveform.knots import PeriodicKnots
from .waveform.multisine import Multisine
from .waveform.periodic import Cycloid, ReverseSawtooth, Sawtooth, Sine, Triangle
from .waveform.sampled import Sampled
from .waveform.sequence import Sequence
from .waveform.shapes import Chirp, Constant, Ramp, Rest, Step

WAVEFORMS = (Sawtooth, ReverseSawtooth, Triangle, Cycloid, Sine, PeriodicKnots, Multisine, Sampled)
WAVEFORMS = (*WAVEFORMS, Chirp, Step, Ramp, Constant, Rest, Sequence)

_KINDS: Mapping[str, Callable[[], dict[str, str]]] = {
    "laws": lambda: {law.__name__: _first_line(law) for law in LAWS},
    "actuators": lambda: {name: load_set(name).title for name in available_sets()},
    "waveforms": lambda: {one.__name__: _first_line(one) for one in WAVEFORMS},
    "benches": lambda: {name: load_bench(name).title for name in available_benches()},
    "calibrations": lambda: {name: load_calibration(name).source for name in available_calibrations()},
    "datasets": lambda: {name: f"{one.credit} ({one.licence})" for name, one in DATASETS.items()},
}


def catalogue(*kinds: str) -> dict[str, dict[str, str]]:
    """What is known by name, by kind, each with a line of what it is.

    Args:
        kinds: of "laws", "actuators" (parameter sets), "waveforms", "benches", "calibrations" and "datasets";
            all of them, if left out.

    Raises:
        QuantityError: there is no such kind.
    """
    for kind in kinds:
        if kind not in _KINDS:
            raise QuantityError(
                f"there is no kind {kind!r}{did_you_mean(kind, _KINDS)}; there are {', '.join(_KINDS)}"
            )
    return {kind: _KINDS[kind]() for kind in kinds or _KINDS}


def _first_line(described: type) -> str:
    return (described.__doc__ or "").strip().split("\n")[0]
