"""Which friction law describes a walk best: each fitted alike, and judged on walks it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from ..actuator import Actuator
from ..friction import Coulomb, CoulombViscous, Dahl, Elastoplastic, LuGre, ResetIntegrator
from .channels import channel, names_of, recordings_of
from .compare import Candidate, Comparison
from .friction import CHANNEL, OBSERVED, identify_friction
from .result import goodness


def walk_candidates(coulomb_force: float, sigma_0: float, sigma_1: float) -> list[Candidate]:
    """Rigid and presliding laws, from the same Coulomb force [N], stiffness [N/m] and damping [N s/m]."""
    f, k, damping = coulomb_force, sigma_0, {"sigma_1": (0.0, 20.0 * sigma_1)}
    return [
        Candidate("Coulomb", Coulomb(f), ("coulomb_force",), {}),
        Candidate(
            "CoulombViscous",
            CoulombViscous(f, 0.1 * sigma_1),
            ("coulomb_force", "sigma_2"),
            {"sigma_2": (0.0, 20.0 * sigma_1)},
        ),
        Candidate("Dahl", Dahl(k, f), ("sigma_0", "coulomb_force"), {}),
        Candidate("ResetIntegrator", ResetIntegrator(k, f / k), ("sigma_0", "breakaway_deflection"), {}),
        Candidate("LuGre", LuGre(k, sigma_1, 0.0, f, f), ("sigma_0", "sigma_1", "coulomb_force"), damping),
        Candidate(
            "Elastoplastic",
            Elastoplastic(k, sigma_1, 0.0, f, f, 0.5 * f / k),
            ("sigma_0", "sigma_1", "coulomb_force", "breakaway_share"),
            damping,
        ),
    ]


def compare_walks(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    verification: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator,
    laws: Sequence[Candidate],
    *,
    channel_free: Sequence[str] = ("delay", "offset"),
    bounds: Any = None,
    unseen_drive: Any = None,
    **options: Any,
) -> Comparison:
    """Fit each law to walks of an actuator and judge it on walks that it has not seen.

    Args:
        recordings: to fit, as for `identify_friction`.
        verification: to judge by, predicted with nothing fitted again.
        model: the actuator; its law is replaced.
        laws: the candidates: `walk_candidates`, or one's own.
        channel_free: what is free of the position channel, for all laws alike.
        bounds: of what is free in all laws.
        unseen_drive: waveform of the recordings for verification, if drive= gives that of the others.
        options: of `identify_friction`.

    Raises:
        RecordingError, QuantityError, FitError: as `identify_friction`.
    """
    unseen = recordings_of(verification)
    measured = [channel(r, OBSERVED, n) for r, n in zip(unseen, names_of(unseen), strict=True)]
    fits, seen = {}, {}
    for law in laws:
        known = {k: v for k, v in (bounds or {}).items() if k in (*law.free, *channel_free, *CHANNEL)}
        fit = identify_friction(
            recordings,
            model.replace(friction=law.model),
            (*law.free, *channel_free),
            bounds={**law.bounds, **known},
            **options,
        )
        assert fit.predict is not None  # identify_friction always gives it
        residuals = [fit.predict(r, unseen_drive) - m for r, m in zip(unseen, measured, strict=True)]
        parts = [goodness(r, m) for r, m in zip(residuals, measured, strict=True)]
        whole = goodness(np.concatenate(residuals), np.concatenate(measured), "verification", "m")
        fits[law.label] = fit
        seen[law.label] = whole._replace(sst=sum(g.sst for g in parts))
    return Comparison(fits, seen)
