"""Credit: the bibliography is whole, and everything that has sources names them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import xarray as xr

import stickslip.parameters
from stickslip.friction import LAWS, Dahl, LuGre
from stickslip.parameters import (
    ParameterSetError,
    bibtex,
    citation_keys,
    cite,
    keys_in,
    print_citations,
    references,
)
from stickslip.physics.actuator import load_actuator

PACKAGE = Path(stickslip.parameters.__file__).parents[1]
NEEDED = {
    "book": {"author", "title", "publisher", "year"},
    "article": {"author", "title", "journal", "year"},
    "inproceedings": {"author", "title", "booktitle", "year"},
    "mastersthesis": {"author", "title", "school", "year"},
    "phdthesis": {"author", "title", "school", "year"},
    "techreport": {"author", "title", "institution", "year"},
    "manual": {"title", "organization", "year"},
    "misc": {"author", "title", "howpublished", "year"},
}


def test_every_entry_of_the_file_is_found() -> None:
    text = (PACKAGE / "parameters" / "references.bib").read_text(encoding="utf-8")
    keys = re.findall(r"^@\w+\{(\w+),$", text, re.MULTILINE)
    assert len(keys) == text.count("@")
    assert list(references()) == keys
    assert len(set(keys)) == len(keys)


def test_every_entry_is_whole() -> None:
    for key, entry in references().items():
        kind = re.match(r"@(\w+)\{", entry)
        fields = dict(re.findall(r"^  (\w+)\s+= (.*),$", entry, re.MULTILINE))
        assert kind is not None, key
        assert NEEDED[kind[1]] <= fields.keys(), key
        assert len(entry.splitlines()) == len(fields) + 2, f"{key}: something that is no field"
        assert entry.count("{") == entry.count("}"), key
        assert entry.isascii(), key
        assert fields["year"] == f"{{{re.sub('[a-z]', '', key)}}}", key


def test_every_key_in_the_source_has_an_entry() -> None:
    found = set()
    for file in PACKAGE.rglob("*.py"):
        for text in re.findall(r"\[([^][\n]*)\]", file.read_text(encoding="utf-8")):
            found |= {(key, file.name) for key in re.findall(r"\b[a-z]+(?:18|19|20|17)\d\d\b", text)}
    assert len(found) > 100
    assert not [one for one in found if one[0] not in references()]


SOURCES = {
    "Coulomb": "coulomb1785",
    "CoulombViscous": "coulomb1785",
    "StictionCoulombViscous": "kang2007",
    "Stribeck": "olsson1998",
    "Dahl": "dahl1976",
    "ResetIntegrator": "haessig1991",
    "LuGre": "canudas1995",
    "Elastoplastic": "dupont2002",
    "MaxwellSlip": "albender2005",
}


def test_every_law_names_its_source() -> None:
    assert {law.__name__ for law in LAWS} == SOURCES.keys()
    for law in LAWS:
        assert SOURCES[law.__name__] in citation_keys(law)


def test_keys_in() -> None:
    text = "A law [canudas1995, eq. 2; olsson1998] that [somebody2020] uses in [0, 1), after [canudas1995]."
    assert keys_in(text) == ("canudas1995", "olsson1998")
    assert keys_in("canudas1995 outside of brackets") == ()


def test_cite(capsys: pytest.CaptureFixture[str]) -> None:
    lugre, thesis, dahl = (references()[key] for key in ("canudas1995", "kang2007", "dahl1976"))
    assert cite("canudas1995") == lugre
    assert cite(LuGre) == cite(LuGre(1.0, 1.0, 0.0, 1.0, 1.0)) == lugre
    actuator = load_actuator("kang2007")
    assert cite(actuator) == f"{thesis}\n\n{lugre}"
    assert cite(actuator, "kang2007", LuGre, actuator) == cite(actuator)
    assert dahl in cite(actuator, Dahl)
    recording = xr.Dataset(attrs={"citation": "floren2024, floren2026"})
    assert cite(recording) == bibtex("floren2024", "floren2026")
    assert cite(xr.Dataset()) == ""
    assert cite() == "\n\n".join(references().values())
    print_citations(recording)
    assert capsys.readouterr().out == cite(recording) + "\n"


def test_cite_what_is_unknown() -> None:
    with pytest.raises(ParameterSetError, match=r"no parameter set 'kang2070' \(did you mean 'kang2007'\?\)"):
        cite("kang2070")
    with pytest.raises(TypeError, match="a float has no sources to cite"):
        cite(1.0)
    assert bibtex("mine2026") == "% [mine2026] has no entry in the bibliography of stickslip."
