"""Schemas (pydantic) of parts of input files whose fields are the arguments of a Python function.

Names, types, defaults and descriptions of these fields are thus declared only in the function.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field, create_model

from .input_file import NullIsDefault


class ArgumentFields(NullIsDefault):
    """Base of the schemas that `arguments_of` makes: a part of a file with arguments of a function."""

    of_function: ClassVar[tuple[str, ...]] = ()

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    @property
    def arguments(self) -> dict[str, Any]:
        """Return the arguments that the file gives, by name, without defaults."""
        names = {name for kind in type(self).__mro__ for name in vars(kind).get("of_function", ())}
        return {name: getattr(self, name) for name in sorted(names & self.model_fields_set)}


def arguments_of(function: Callable[..., Any], *names: str, **types: Any) -> type[ArgumentFields]:
    """Return the schema of a part of a file that gives some arguments of a function.

    Args:
        function: the function; its arguments have annotations, and its docstring has a section "Args".
        names: names of arguments with the same type in the file as in the function.
        types: types in the file of further arguments, by name, where they differ from the function's.

    Raises:
        TypeError: the function has no such argument.
    """
    function = inspect.unwrap(function)
    signature, meanings = inspect.signature(function).parameters, _meanings(function)
    fields: dict[str, Any] = {}
    for name in (*names, *types):
        if name not in signature:
            raise TypeError(f"{function.__name__} has no argument {name!r}")
        kind = types.get(name, signature[name].annotation)
        kind = eval(kind, function.__globals__) if isinstance(kind, str) else kind
        default = signature[name].default
        default = ... if default is inspect.Parameter.empty else default
        kind = kind | None if default is None else kind
        fields[name] = (kind, Field(default, description=meanings.get(name)))
    made = create_model(
        f"ArgumentsOf_{function.__name__}", __base__=ArgumentFields, __module__=function.__module__, **fields
    )
    made.of_function = tuple(fields)
    return made


@functools.cache
def _meanings(function: Callable[..., Any]) -> dict[str, str]:
    """Return the meaning of each argument by name, from the section "Args" of the function's docstring."""
    _, _, rest = (inspect.getdoc(function) or "").partition("\nArgs:\n")
    part = re.split(r"\n(?=\S)", rest, maxsplit=1)[0]
    found = {}
    for names, text in re.findall(r"^    ((?:\w+, )*\w+): (.*(?:\n {8}.*)*)", part, flags=re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found
