"""Citations: BibTeX entries of the sources of parameter sets, friction laws and recordings.

The docstring of a law contains the keys of its sources in square brackets, for example ``[canudas1995]``,
where they are found without registration. The first paragraph of the docstring of the law's module is
searched too.
"""

from __future__ import annotations

import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

from ..quantities.records import did_you_mean
from .load import ParameterSetError, available_sets, load_set

_FILE = Path(__file__).parent / "references.bib"


@cache
def references() -> dict[str, str]:
    """Return the BibTeX entries of the package's bibliography (references.bib) by citation key."""
    text = _FILE.read_text(encoding="utf-8")
    return {
        entry[1]: entry[0] for entry in re.finditer(r"^@\w+\{(\w+),.*?^\}", text, re.MULTILINE | re.DOTALL)
    }


def keys_in(text: str) -> tuple[str, ...]:
    """Return the known citation keys in square brackets in a text, each once, in order of appearance."""
    bracketed = " ".join(re.findall(r"\[([^][]*)\]", text))
    return tuple(dict.fromkeys(word for word in re.findall(r"\w+", bracketed) if word in references()))


def bibtex(*keys: str) -> str:
    """Return the BibTeX entries of citation keys as one text, each once; an unknown key gives a comment
    line."""
    missing = "% [{}] has no entry in the bibliography of stickslip."
    return "\n\n".join(references().get(key, missing.format(key)) for key in dict.fromkeys(keys))


def citation_keys(thing: Any) -> tuple[str, ...]:
    """Return the citation keys of an object.

    Args:
        thing: an actuator, slider, friction law (record or class) or recording; or a text: a citation key
            itself, or the name or ``.toml`` file of a parameter set.

    Raises:
        ParameterSetError: the text is neither a citation key nor the name of a parameter set, or the file is
            wrong.
        TypeError: an object of this type has no sources.
    """
    if isinstance(thing, str) and thing in references():
        return (thing,)
    if isinstance(thing, str):
        if not thing.endswith(".toml") and thing not in available_sets():
            hint = did_you_mean(thing, (*references(), *available_sets()))
            raise ParameterSetError(
                f"there is no reference and no parameter set {thing!r}{hint}; `stickslip list` shows names"
            )
        return load_set(thing).citations
    if not isinstance(thing, type) and hasattr(thing, "citation_keys"):
        return tuple(thing.citation_keys)
    record_type = thing if isinstance(thing, type) else type(thing)
    if hasattr(record_type, "_fields"):
        headline = (sys.modules[record_type.__module__].__doc__ or "").partition("\n\n")[0]
        return keys_in(f"{headline} {record_type.__doc__}")
    # A recording has its citation keys in the attribute "citation".
    if hasattr(thing, "attrs"):
        return tuple(re.findall(r"\w+", thing.attrs.get("citation", "")))
    raise TypeError(f"a {type(thing).__name__} has no sources to cite")


def cite(*things: Any) -> str:
    """Return the BibTeX entries of objects as one text, each once; without arguments, the whole bibliography.

    Args:
        things: actuators, laws, recordings, names of parameter sets, citation keys.

    Raises:
        ParameterSetError, TypeError: as `citation_keys`.
    """
    keys = [key for thing in things for key in citation_keys(thing)] if things else list(references())
    return bibtex(*keys)


def print_citations(*things: Any) -> None:
    """Print the BibTeX entries that `cite` returns for the same arguments."""
    print(cite(*things))
