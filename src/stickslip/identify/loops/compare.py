"""Comparison of friction laws on the same loops: each law is fitted in the same way, and judged on loops that
no fit used.

Akaike's and Schwarz's criteria count the samples as independent. Residuals of loops are model errors,
correlated over many samples, so the criteria favour more parameters than the data support. The r^2 on the
verification part decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...estimate.result import Fit
from ...friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
)
from ...quantities.progress import Progress, unheard
from ..candidates import Candidate, Comparison, compared
from ..free import Bounds
from ..recorded.channels import channel, names_of, recordings_of
from .fit import OBSERVED, identify_loops

if TYPE_CHECKING:
    import xarray as xr

# Initial guess of the displacement over which the contact yields, relative to the stroke (the peak-to-peak
# position).
YIELD_SHARE = 0.2


def candidates(recordings: xr.Dataset | Sequence[xr.Dataset], max_elements: int = 4) -> list[Candidate]:
    """Return a candidate for every friction law of the package, with initial values from the size of the
    loops.

    Coulomb friction starts at half the range of the force. The displacement over which a contact yields
    starts at a fifth of the stroke, the Stribeck velocity at a tenth of the largest speed (99th percentile).
    Maxwell slip comes with 1, 2, ... `max_elements` elements that yield one after the other. Stiction of
    `StictionCoulombViscous`, stiction and bristle damping of the reset integrator, and sigma_2 of LuGre,
    Elastoplastic and Maxwell slip are not fitted.

    Args:
        recordings: with position [m] (rad) and friction_force [N] (N m).
        max_elements: largest number of elements of Maxwell slip.

    Raises:
        RecordingError: a channel is missing, too short or constant.
    """
    found = recordings_of(recordings)
    names = names_of(found)
    force = [channel(r, OBSERVED, name, varies=True) for r, name in zip(found, names, strict=True)]
    position = [channel(r, "position", name, varies=True) for r, name in zip(found, names, strict=True)]
    f_c = 0.5 * max(float(np.ptp(f)) for f in force)
    d = YIELD_SHARE * max(float(np.ptp(x)) for x in position)
    speed = max(
        float(np.percentile(np.abs(np.gradient(x, r["time"].values)), 99))
        for x, r in zip(position, found, strict=True)
    )
    k, v_s, viscous = f_c / d, 0.1 * speed, 0.01 * f_c / speed
    sigma_2: Bounds = {"sigma_2": (0.0, f_c / speed)}
    sigma_1: Bounds = {"sigma_1": (0.0, 10 * f_c / speed)}
    fall = ("stiction_ratio", "stribeck_velocity")
    listed = [
        Candidate("Coulomb", Coulomb(f_c), ("coulomb_force",), {}),
        Candidate("CoulombViscous", CoulombViscous(f_c, viscous), ("coulomb_force", "sigma_2"), sigma_2),
        Candidate(
            "StictionCoulombViscous",
            StictionCoulombViscous(f_c, f_c, viscous),
            ("coulomb_force", "sigma_2"),
            sigma_2,
        ),
        Candidate(
            "Stribeck",
            Stribeck(f_c, 1.05 * f_c, v_s, viscous),
            ("coulomb_force", "sigma_2", *fall),
            sigma_2,
        ),
        Candidate("Dahl", Dahl(k, f_c), ("sigma_0", "coulomb_force"), {}),
        Candidate(
            "Dahl, exponent free",
            Dahl(k, f_c, 0.9),
            ("sigma_0", "coulomb_force", "exponent"),
            {"exponent": (0.5, 4.0)},
        ),
        Candidate("ResetIntegrator", ResetIntegrator(k, d), ("sigma_0", "breakaway_deflection"), {}),
        Candidate(
            "LuGre",
            LuGre(k, viscous, 0.0, f_c, 1.05 * f_c, v_s),
            ("sigma_0", "coulomb_force", "sigma_1", *fall),
            sigma_1,
        ),
        Candidate(
            "Elastoplastic",
            Elastoplastic(k, viscous, 0.0, f_c, 1.05 * f_c, 0.6 * d, v_s),
            ("sigma_0", "coulomb_force", "sigma_1", "breakaway_share", *fall),
            sigma_1,
        ),
    ]
    for n in range(1, max_elements + 1):
        strength = np.full(n, f_c / n)
        yields = d * np.linspace(1.0, 2.0, n)
        law = MaxwellSlip(tuple(strength / yields), tuple(strength))
        free = [f"{field}_{i + 1}" for field in ("stiffness", "strength") for i in range(n)]
        listed.append(Candidate(f"MaxwellSlip, {n} element{'s' * (n > 1)}", law, tuple(free), {}))
    return listed


def compare_laws(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    verification: xr.Dataset | Sequence[xr.Dataset],
    laws: Sequence[Candidate] | None = None,
    *,
    channel_free: Sequence[str] = ("bias",),
    progress: Progress = unheard,
    **options: Any,
) -> Comparison:
    """Fit each law to friction loops and judge it on loops that the fit did not use.

    Args:
        recordings: friction loops to fit, as for `identify_loops`.
        verification: friction loops to judge by, each simulated from its first sample.
        laws: the candidates; by default all laws of the package, from `candidates`.
        channel_free: free parameters of the force channel, the same for all laws, such as "bias",
            "curvature" or "drift".
        progress: called before each law with a text and the fraction of laws that is done.
        options: further arguments of `identify_loops`; they replace settings of the candidates of the same
            name.

    Returns:
        The fits and the goodness of their predictions, by the label of the law.

    Raises:
        RecordingError, QuantityError, FitError: as `identify_loops`.
    """

    def fit(law: Candidate) -> Fit:
        own = {"bounds": law.bounds, "starts": law.starts, "tied": law.tied, "priors": law.priors, **options}
        return identify_loops(recordings, law.model, (*law.free, *channel_free), **own)

    laws = candidates(recordings) if laws is None else laws
    return compared(laws, fit, verification, None, (OBSERVED, "N"), progress)
