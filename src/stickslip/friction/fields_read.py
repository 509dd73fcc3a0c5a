"""Check that the function of a friction law reads only fields that its record has, so that a typing error is
found when the law is registered and not during a simulation."""

from __future__ import annotations

import dis
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from ..quantities.records import did_you_mean


def refuse_unknown_fields(law_type: Any, function: Callable[..., Any]) -> None:
    """Raise TypeError if a function reads a field of its first argument that the record lacks."""
    code = function.__code__
    for taken, asked in pairwise(dis.get_instructions(code)):
        names = taken.argval if isinstance(taken.argval, tuple) else (taken.argval,)
        of_law = taken.opname.startswith("LOAD_FAST") and names[-1] == code.co_varnames[0]
        if of_law and asked.opname in ("LOAD_ATTR", "LOAD_METHOD") and not hasattr(law_type, asked.argval):
            fields = law_type._fields
            raise TypeError(
                f"{code.co_filename}: {function.__name__} reads {names[-1]}.{asked.argval}, and "
                f"{law_type.__name__} has no such field{did_you_mean(asked.argval, fields)}; it has "
                f"{', '.join(fields)}"
            )
