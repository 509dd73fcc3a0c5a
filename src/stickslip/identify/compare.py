"""Which friction law describes the same loops best: each fitted alike, and judged on what it has not seen.

Akaike's and Schwarz's criteria count the samples as independent. Residuals of loops are not (they are model
error, correlated over many samples), so the criteria are too sure in favour of more parameters; r^2 on the
unseen part decides.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ..estimate.goodness import Goodness, goodness
from ..estimate.result import Fit
from ..friction import (
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
from .channels import channel, names_of, recordings_of
from .free import Bounds
from .loops import OBSERVED, identify_loops

# Share of the stroke that the contact is first taken to yield over.
YIELD_SHARE = 0.2


class Candidate(NamedTuple):
    """A law with its start values, what is free in it, bounds where the usual ones do not do, and how many
    searches to begin within them."""

    label: str
    model: Any
    free: tuple[str, ...]
    bounds: Bounds
    starts: int = 1  # more for a law whose sum of squares has several valleys


def candidates(recordings: xr.Dataset | Sequence[xr.Dataset], max_elements: int = 4) -> list[Candidate]:
    """Every law of the package, starting from the size of the loops.

    Coulomb friction starts at half the range of the force, presliding at a fifth of the stroke, the Stribeck
    velocity at a tenth of the largest speed (99th percentile). Maxwell slip comes with 1, 2, ...
    `max_elements` elements that yield one after the other. What a prescribed motion does not show stays out:
    stiction of the laws without presliding, and damping of the reset integrator's bristle.
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


@dataclass(frozen=True, eq=False)
class Comparison:
    """Laws fitted to the same recordings; `fits` and `verifications` by label, in their order."""

    fits: Mapping[str, Fit]
    verifications: Mapping[str, Goodness]

    @property
    def best(self) -> str:
        """The label of the law with the highest r^2 on the verification part."""
        return max(self.verifications, key=lambda label: self.verifications[label].r_squared)

    @property
    def table(self) -> xr.Dataset:
        """Figures of merit over "law"."""
        fits, seen = list(self.fits.values()), list(self.verifications.values())
        columns = {
            "r_squared": ([f.r_squared for f in fits], ""),
            "verification_r_squared": ([g.r_squared for g in seen], ""),
            "rmse": ([f.rmse for f in fits], seen[0].unit),
            "verification_rmse": ([g.rmse for g in seen], seen[0].unit),
            "aic": ([f.aic for f in fits], ""),
            "bic": ([f.bic for f in fits], ""),
            "n_parameters": ([len(f.parameters) for f in fits], ""),
            "converged": ([f.converged for f in fits], ""),
        }
        return xr.Dataset(
            {name: ("law", values, {"units": unit}) for name, (values, unit) in columns.items()},
            coords={"law": list(self.fits)},
        )

    def report(self) -> str:
        """The table as text, AIC and BIC as differences from the lowest."""
        lowest_aic = min(f.aic for f in self.fits.values())
        lowest_bic = min(f.bic for f in self.fits.values())
        width = max(map(len, self.fits))
        lines = [
            f"{'law':{width}}  {'r^2 fit':9}  {'r^2 unseen':10}  {'rmse unseen':11}  "
            f"{'dAIC':>9}  {'dBIC':>9}  parameters"
        ]
        for label, fit in self.fits.items():
            g = self.verifications[label]
            state = f"  {fit.doubt}" if fit.doubt else ""
            lines.append(
                f"{label:{width}}  {fit.r_squared:9.6f}  {g.r_squared:10.6f}  {g.rmse:9.4g} {g.unit}  "
                f"{fit.aic - lowest_aic:9.1f}  {fit.bic - lowest_bic:9.1f}  {len(fit.parameters)}{state}"
            )
        return "\n".join(lines)


def compare_laws(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    verification: xr.Dataset | Sequence[xr.Dataset],
    laws: Sequence[Candidate] | None = None,
    *,
    channel_free: Sequence[str] = ("bias",),
    progress: Callable[[str, int, int], None] | None = None,
    **options: Any,
) -> Comparison:
    """Fit each law to friction loops and judge it on loops that it has not seen.

    Args:
        recordings: to fit, as for `identify_loops`.
        verification: to judge by, each predicted freely from its first sample.
        laws: the candidates; all laws of the package if left out.
        channel_free: what is free of the force channel, for all laws alike: "bias", "curvature", "drift".
        progress: called before each law with its label, number and how many there are.
        options: of `identify_loops`.

    Raises:
        RecordingError, QuantityError, FitError: as `identify_loops`.
    """
    laws = candidates(recordings) if laws is None else laws
    unseen = recordings_of(verification)
    measured = [channel(r, OBSERVED, n) for r, n in zip(unseen, names_of(unseen), strict=True)]
    fits, seen = {}, {}
    for i, law in enumerate(laws, start=1):
        if progress is not None:
            progress(law.label, i, len(laws))
        own = {"bounds": law.bounds, "starts": law.starts, **options}
        fit = identify_loops(recordings, law.model, (*law.free, *channel_free), **own)
        assert fit.predict is not None  # identify_loops always gives it
        residuals = [fit.predict(r) - m for r, m in zip(unseen, measured, strict=True)]
        parts = [goodness(r, m) for r, m in zip(residuals, measured, strict=True)]
        whole = goodness(np.concatenate(residuals), np.concatenate(measured), "verification", "N")
        fits[law.label] = fit
        seen[law.label] = whole._replace(sst=sum(g.sst for g in parts))
    return Comparison(fits, seen)
