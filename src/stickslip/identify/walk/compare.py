"""Comparison of friction laws on walks: each law is fitted in the same way and judged on walks that no fit
used.

The candidates are all friction laws on the dynamic stage [kang2007, 3.2], including that of Chang and Li
(Coulomb friction [changli1999]), and Pohl's static model [pohl1987].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

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
from ...physics.actuator import Actuator
from ...quantities.progress import Progress, unheard
from ...quantities.units import to_si, unit_for
from ..candidates import Candidate, Comparison, compared
from ..free import Bounds
from ..recorded.channels import drives_of, recordings_of
from .friction import identify_friction
from .position_channel import CHANNEL, OBSERVED
from .static import identify_static_walk

if TYPE_CHECKING:
    import xarray as xr

POHL, CHANG_LI = "Pohl: static", "Coulomb (Chang & Li)"


def walk_candidates(
    coulomb_force: float | str,
    sigma_0: float | str,
    sigma_1: float | str,
    starts: int = 8,
    stribeck_velocity: float | str = 1e-3,
) -> list[Candidate]:
    """Return a candidate for each friction law, all with initial values from the same four numbers.

    The candidate whose `model` is None is Pohl's static model. Two laws have a sum of squares with several
    local minima and are searched from several initial guesses. They are the Stribeck curve as a static law (a
    slip determines little more than one mean force) and Maxwell slip (its vibration continues until an
    element slips once more or once less).

    Args:
        coulomb_force: Coulomb friction, N. For a rotary actuator this and the next two are plain numbers in
            N m, N m/rad and N m s/rad.
        sigma_0: stiffness of the contact, N/m.
        sigma_1: damping of the contact, N s/m.
        starts: number of initial guesses for the static Stribeck law; Maxwell slip gets a quarter of them.
        stribeck_velocity: initial Stribeck velocity, m/s (rad/s).
    """
    f, k = to_si(coulomb_force, "N", "coulomb_force"), to_si(sigma_0, "N/m", "sigma_0")
    sigma_1 = to_si(sigma_1, "N s/m", "sigma_1")
    v_s = to_si(stribeck_velocity, "m/s", "stribeck_velocity")
    viscous = 0.1 * sigma_1
    sigma_2: Bounds = {"sigma_2": (0.0, 20.0 * sigma_1)}
    damping: Bounds = {"sigma_1": (0.0, 20.0 * sigma_1)}
    two = MaxwellSlip((0.7 * k, 0.3 * k), (0.5 * f, 0.5 * f), viscous)
    return [
        Candidate(POHL, None, ("gain",), {}),
        Candidate(CHANG_LI, Coulomb(f), ("coulomb_force",), {}),
        Candidate("CoulombViscous", CoulombViscous(f, viscous), ("coulomb_force", "sigma_2"), sigma_2),
        Candidate(
            "StictionCoulombViscous",
            StictionCoulombViscous(f, 1.1 * f, viscous),
            ("coulomb_force", "sigma_2", "stiction_ratio"),
            sigma_2,
        ),
        Candidate(
            "Stribeck",
            Stribeck(f, 1.1 * f, v_s),
            # sigma_2 is fixed at 0, because viscous friction has the same effect as a larger Stribeck
            # velocity.
            ("coulomb_force", "stiction_ratio", "stribeck_velocity"),
            {"coulomb_force": (f / 3.0, 3.0 * f), "stribeck_velocity": (0.1 * v_s, 10.0 * v_s)},
            starts,
        ),
        Candidate("Dahl", Dahl(k, f), ("sigma_0", "coulomb_force"), {}),
        Candidate(
            "ResetIntegrator",
            ResetIntegrator(k, f / k, 0.0, sigma_1),
            ("sigma_0", "breakaway_deflection", "sigma_2"),  # only sigma_2 damps vibrations in presliding
            sigma_2,
        ),
        Candidate("LuGre", LuGre(k, sigma_1, 0.0, f, f), ("sigma_0", "sigma_1", "coulomb_force"), damping),
        Candidate(
            "LuGre with Stribeck curve",
            LuGre(k, sigma_1, 0.0, f, 1.05 * f, v_s),
            ("sigma_0", "sigma_1", "coulomb_force", "stiction_ratio", "stribeck_velocity"),
            damping,
        ),
        Candidate(
            "Elastoplastic",
            Elastoplastic(k, sigma_1, 0.0, f, f, 0.5 * f / k),
            ("sigma_0", "sigma_1", "coulomb_force", "breakaway_share"),
            damping,
        ),
        Candidate(
            "MaxwellSlip, 2 elements",
            two,
            ("stiffness_1", "stiffness_2", "strength_1", "strength_2", "sigma_2"),
            {
                **{f"stiffness_{i}": (0.2 * k, 2.0 * k) for i in (1, 2)},
                **{f"strength_{i}": (0.05 * f, f) for i in (1, 2)},
                "sigma_2": (0.0, 3.0 * sigma_1),
            },
            -(-starts // 4),  # fewer initial guesses: an evaluation of this law takes ten times as long
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
    progress: Progress = unheard,
    **options: Any,
) -> Comparison:
    """Fit each friction law to walks of an actuator and judge each fit on walks that no fit used.

    Args:
        recordings: walks to fit, as for `identify_friction`.
        verification: walks that are not fitted; each fit predicts them.
        model: the actuator; its law is replaced.
        laws: the candidates, from `walk_candidates` or your own. Their `priors` need a given `noise`; the
            static model has none.
        channel_free: free parameters of the position channel ("delay", "offset"), the same for all laws; the
            static model always has both.
        bounds: bounds by name, in SI or as strings; each fit uses those of its own free parameters.
        unseen_drive: waveform of each verification recording, or one for all; None: as recorded. It is needed
            if `drive` is given for the fitted recordings.
        progress: called before each law with a text and the fraction of laws that is done.
        options: further arguments of `identify_friction`, which replace settings of the candidates; the
            static model takes only `slew_rate` and `drive`.

    Returns:
        The fits and the goodness of their predictions, by the label of the law.

    Raises:
        RecordingError, QuantityError, FitError: as `identify_friction`.
    """

    def fit(law: Candidate) -> Fit:
        known = {k: v for k, v in (bounds or {}).items() if k in (*law.free, *channel_free, *CHANNEL)}
        if law.model is None:
            own = {k: v for k, v in options.items() if k in ("drive", "slew_rate")}
            return identify_static_walk(recordings, model, bounds=known, **own)
        return identify_friction(
            recordings,
            model.replace(friction=law.model),
            law.free,
            channel=channel_free,
            bounds={**law.bounds, **known},
            **{"starts": law.starts, "tied": law.tied, "priors": law.priors, "diagnose": False, **options},
        )

    drives = drives_of(unseen_drive, recordings_of(verification))
    return compared(laws, fit, verification, drives, (OBSERVED, unit_for(model, "m")), progress)
