"""Searches for the friction parameters of walks from several initial guesses, and the choice of searches to
complete."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

from ...estimate.identifiability import loosest
from ...estimate.minima import still_fits
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError
from ...estimate.result import Fit
from ...estimate.several import ENOUGH, followed, from_several
from ...quantities.units import ANGLE
from .first_guess import beside
from .position_channel import CHANNEL
from .walks import Walks

# Exponents by unit: a search uses this power of a parameter as its coordinate, because the positions of walks
# are more nearly linear in forces, dampings and compliances (1 / stiffness) than in logarithms.
POWERS = {"N": 1, "N s/m": 1, "N/m": -1}
POWERS |= {ANGLE.unit(unit): power for unit, power in POWERS.items()}
# Assumed largest reduction of chi-squared that a stopped search would still reach if it were completed.
MAX_FALL = 20.0


def from_points(
    walks: Walks,
    parameters: Sequence[Parameter],
    guesses: Sequence[Values],
    given: Container[str],
    max_evaluations: int,
) -> Fit:
    """Return the best fit of searches from several initial guesses: short searches from all, completed for
    the user's and the best ones. Its intervals include other minima that fit as well.

    Args:
        walks: recordings to describe.
        parameters: parameters with bounds wide enough for all guesses.
        guesses: initial guesses (values by name, SI), the user's first.
        given: names whose bounds are the user's; the other bounds are set about the ends of the searches.
        max_evaluations: largest number of evaluations of a short search (at most `ENOUGH`), and again of its
            completion. Searches are not started or completed after the end of the budget of `walks`.

    Raises:
        FitError: no search can start.
    """
    looked: list[Fit] = []

    def look(initial: Values) -> Fit:
        if looked and walks.budget.over:
            raise FitError(walks.budget.said)
        there = [p.starting_at(initial[p.name]) for p in parameters]
        looked.append(walks.searched(there, max_evaluations=min(ENOUGH, max_evaluations)))
        return looked[-1]

    def ends(looks: Sequence[Fit]) -> list[Fit]:
        kept = [walks.completed(fit) for fit in looks]
        if walks.budget.over:
            return kept
        within = beside(parameters, kept[0].values, given)
        for fit in kept[1:]:
            within = _reaching(within, fit)

        def end(fit: Fit, enough: bool) -> Fit:
            there = straightened(within, fit.values)
            return followed(fit, lambda: walks.fit(there, max_evaluations=max_evaluations), enough)

        # If a value is undetermined, the search would follow a long flat minimum. It is stopped there, and
        # `integrated` averages over this minimum later.
        found = [end(fit, _lost(fit)) for fit in kept]
        best = min(found, key=lambda fit: fit.cost)
        # If the best fit has no undetermined value, the stopped searches that may end as low are completed:
        # intervals include another minimum only if the search for it has ended.
        if not _lost(best):
            found = [end(fit, not (_lost(fit) and likely(fit, best))) for fit in found]
        return [replace(fit, parameters=tuple(straightened(within, fit.values))) for fit in found]

    return from_several(guesses, look, ends)


def _lost(fit: Fit) -> bool:
    return loosest(fit, CHANNEL) is not None


def likely(look: Fit, fit: Fit) -> bool:
    """Return True if the stopped search `look`, once completed, may end in a minimum that fits as well as
    `fit` within the noise: if its chi-squared would then be lower by up to `MAX_FALL`."""
    variance = 1.0 if fit.noise_known else fit.cost / fit.degrees_of_freedom
    return variance > 0.0 and still_fits((look.cost - fit.cost) / variance - MAX_FALL, len(fit.parameters))


def _reaching(parameters: Sequence[Parameter], fit: Fit) -> list[Parameter]:
    """Return the parameters with bounds widened to include the values of `fit`, the end of another search."""
    return [
        p._replace(lower=min(p.lower, fit.values[p.name]), upper=max(p.upper, fit.values[p.name]))
        for p in parameters
    ]


def straightened(parameters: Sequence[Parameter], values: Values) -> list[Parameter]:
    """Return the parameters with these initial values (by name, SI) and with powers of the values as search
    coordinates (see `POWERS`), along which curved minima are straighter. Linear scales stay."""
    return [
        p.starting_at(values[p.name])._replace(power=POWERS.get(p.unit, 0) if p.log else 0)
        for p in parameters
    ]
