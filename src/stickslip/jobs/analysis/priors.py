"""Report section and numbers on the effect of priors on a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...estimate.influence import PriorInfluence
from ...report import Column, Document, Number, Section, Table


def with_priors(document: Document, found: Sequence[PriorInfluence]) -> Document:
    """Return a report with the effect of each prior added; unchanged if `found` is empty.

    A sentence on each prior is added to the summary; it says if the recordings contradict the prior. A
    section with a table is added to the sections, and "priors" to the numbers.
    """
    if not found:
        return document
    return replace(
        document,
        summary=f"{document.summary} {priors_summary(found)}",
        sections=[*document.sections, priors_section(found)],
        numbers={**document.numbers, "priors": prior_numbers(found)},
    )


def priors_summary(found: Sequence[PriorInfluence]) -> str:
    """Return a sentence on the effect of each prior, all in one text."""
    return " ".join(f"{one.sentence}." for one in found)


def priors_section(found: Sequence[PriorInfluence]) -> Section:
    """Return a report section with a table: prior, estimates without and with it, and their difference."""
    rows = [
        (
            one.parameter.name,
            Number(one.prior[0], one.parameter.unit, standard_error=one.prior[1]),
            Number(one.alone, one.parameter.unit),
            Number(one.together, one.parameter.unit),
            one.off,
            "NO" if one.disagrees else "open" if one.open else "yes",
        )
        for one in found
    ]
    columns = (
        Column("parameter"),
        Column("prior"),
        Column("without it"),
        Column("with it"),
        Column("prior off by deviations", "", 2),
        Column("held"),
    )
    caption = (
        "Fits without and with the priors. Beyond ±1.96 standard deviations recordings and prior disagree; "
        "open: the recordings say less than the prior, and would not show that it is wrong."
    )
    return Section("Priors", tables=(Table(caption, columns, rows),))


def prior_numbers(found: Sequence[PriorInfluence]) -> dict[str, Any]:
    """Return the effects of the priors for results.json, by name of the parameter, as in `PriorInfluence`.

    "prior" is the prior with its standard deviation; "without" and "with" are the estimates without and with
    it.
    """
    return {
        one.parameter.name: {
            "prior": Number(one.prior[0], one.parameter.unit, standard_error=one.prior[1]),
            "without": Number(one.alone, one.parameter.unit),
            "with": Number(one.together, one.parameter.unit),
            "moved": Number(one.moved, ""),
            "off": Number(one.off, ""),
            "narrowed": Number(one.narrowed, ""),
            "open": one.open,
            "disagrees": one.disagrees,
        }
        for one in found
    }
