"""Report sections on the optional analyses of a campaign: profiles, posterior, comparison of models."""

from __future__ import annotations

from typing import Any

from ...identify.walk.position_channel import CHANNEL
from ...report import Column, Number, Picture, Section, Table
from ...report.figures.posterior import posterior_corner
from ...report.figures.style import svg
from ...report.views.comparison import choice_numbers, choice_section
from ...report.views.posterior import posterior_numbers, posterior_table
from .evaluation import CampaignResult
from .stage import unit_of


def additional_numbers(found: CampaignResult) -> dict[str, Any]:
    """Return the results of the optional analyses for results.json; {} without any.

    Keys: "profiles" (intervals by parameter), "posterior" and "model_choice", if these analyses were made.
    """
    more, numbers = found.additional, {}
    if more.profiles is not None:
        numbers["profiles"] = {
            name: Number(found.friction.values[name], unit_of(found.friction, name), *ends)
            for name, ends in more.profiles.items()
        }
    if more.posterior is not None:
        numbers["posterior"] = {
            **posterior_numbers(more.posterior),
            "converged": more.posterior.converged,
            "message": more.posterior.message,
        }
    if more.choice is not None:
        numbers["model_choice"] = choice_numbers(more.choice)
    return numbers


def additional_sections(found: CampaignResult, *, figures: bool) -> list[Section]:
    """Return the report sections on the optional analyses that were made; [] without any."""
    more, sections = found.additional, []
    if more.profiles is not None or more.posterior is not None:
        sections.append(_without_linearisation(found, figures))
    if more.choice is not None:
        sections.append(choice_section(more.choice))
    return sections


def _without_linearisation(found: CampaignResult, figures: bool) -> Section:
    fit, more = found.friction, found.additional
    names = [p.name for p in fit.shown if not p.fixed and p.name not in CHANNEL]
    columns, said, tables, pictures = [Column("parameter"), Column("linearised")], [], [], []
    of: list[dict[str, Number]] = [
        {n: Number(fit.values[n], unit_of(fit, n), *ends) for n, ends in fit.confidence_intervals().items()}
    ]
    if more.profiles is not None:
        columns.append(Column("profile likelihood"))
        of.append(
            {n: Number(fit.values[n], unit_of(fit, n), *ends) for n, ends in more.profiles.items()},
        )
        said.append("Profile likelihood: each value is fixed, and all others fitted again.")
    if more.posterior is not None:
        columns.append(Column("posterior"))
        of.append(posterior_numbers(more.posterior))
        prior = "those of the stage have the estimate and covariance of the steps as prior"
        said.append(
            "Posterior: by importance sampling and chains, the prior flat within the bounds of the fit (in "
            "the logarithm of what is fitted by it); "
            f"{prior if found.stage else 'the stage is taken as known'}. "
            f"{more.posterior.message[0].upper()}{more.posterior.message[1:]}."
        )
        tables.append(posterior_table(more.posterior))
        if figures:
            pictures.append(
                Picture(
                    "campaign-posterior",
                    "Posterior of the friction parameters: each alone, and by pairs (half and nine tenths of "
                    "the samples within the lines); dashed, the estimate of the fit.",
                    svg(
                        posterior_corner(
                            {n: more.posterior.samples[n].values.ravel() for n in names},
                            {n: unit_of(fit, n) for n in names},
                            {n: fit.values[n] for n in names},
                        )
                    ),
                    "Histograms of each friction parameter and contours of each pair of them",
                )
            )
    rows = [(n, *(by.get(n) for by in of)) for n in names]
    first = Table(
        "95 % intervals of the same fit by different means.",
        columns,
        rows,
        notes="The errors of the stage are in the posterior only.",
    )
    return Section(
        "Intervals without linearisation", paragraphs=said, tables=(first, *tables), figures=pictures
    )
