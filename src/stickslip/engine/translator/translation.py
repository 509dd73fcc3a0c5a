"""Functions of the subset, from Python's syntax tree to C: structs, functions and what they call.

A function becomes one C function for each combination of types it is called with. What is known beforehand
(the length of a tuple, the class of a record) is decided while translating, so no dead branch reaches C.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .assignments import Retyped
from .expressions import LocalFunction
from .statements import CHECK, FunctionBody
from .subset import Array, Pair, Record, real, source_of


class Translation:
    """Translation of some Python functions, and of all functions that they call, to one C source.

    Call `function` for each function, then `text()` for the C source.

    Args:
        dispatched: function that gets a Python function and the record class of its first argument. It
            returns the implementation for this class, or None if one implementation serves all classes. By
            default, no function depends on the class.
    """

    def __init__(
        self, dispatched: Callable[[Callable[..., Any], type], Callable[..., Any] | None] | None = None
    ) -> None:
        self._dispatched = dispatched
        self._records: dict[str, Record] = {}
        self._pairs: dict[str, Pair] = {}
        self._functions: dict[tuple[Any, ...], tuple[str, Any]] = {}
        self._names: dict[str, Any] = {}
        self._bodies: list[str] = []
        self._tables: dict[tuple[float, ...], str] = {}
        self._kept: dict[Any, Any] = {}
        self._open: list[Any] = []

    def record(self, record: Record) -> str:
        """Add the C struct of a record type, and of the records in it; return its name. Raise ValueError if
        another struct has this name."""
        for _, kind in record.fields:
            if isinstance(kind, Record):
                self.record(kind)
        known = self._records.setdefault(record.c_name, record)
        if known != record:
            raise ValueError(f"{record.c_name} would be two different structs in C")
        return record.c_name

    def function(
        self, function: Any, kinds: tuple[Any, ...], members: tuple[str, ...] = ()
    ) -> tuple[str, Any]:
        """Translate a function for arguments of given types; return its C name and the type of its result.

        Args:
            function: the Python function.
            kinds: types of its arguments.
            members: names of the parts of a result that is a tuple; all parts are then real numbers.

        Raises:
            TranslationError: the function, or one that it calls, is outside the subset.
        """
        if self._dispatched and kinds and isinstance(kinds[0], Record):
            function = self._dispatched(function, kinds[0].record_class) or function
        local = isinstance(function, LocalFunction)
        plain: Any = function.source.tree if local else getattr(function, "py_func", function)
        key = (plain, kinds)
        if key not in self._functions:
            source = function.source if local else source_of(plain)
            if plain in self._open:
                raise source.error(None, "it calls itself; the work per step would have no bound")
            name = f"ss_{source.name.lstrip('_')}"
            while self._names.setdefault(name, key) != key:
                name += "_"
            self._open.append(plain)
            try:
                result, body = self._translated(source, kinds, members, name)
            finally:
                self._open.pop()
            self._functions[key] = (name, result)
            self._bodies.append(body)
        return self._functions[key]

    def _translated(
        self, source: Any, kinds: tuple[Any, ...], members: tuple[str, ...], name: str
    ) -> tuple[Any, str]:
        """Return the type of the result and the C source of a function (a `FunctionSource`) with the C name
        `name`.

        If a variable needs a wider type than its first value has, the function is translated again with that
        type."""
        types: dict[str, Any] = {}
        while True:
            try:
                return FunctionBody(self, source, kinds, members, types).translated(name)
            except Retyped as wider:
                types[wider.name] = wider.kind

    def check(self, function: Callable[..., Any], kind: Record) -> str:
        """Translate the method `_check` of a record of the type `kind`, and return its C name. The C function
        does not raise an error, but returns its text, or NULL."""
        name, _ = self.function(function, (kind,), CHECK)
        return name

    def pair(self, name: str, kinds: tuple[Any, ...], members: tuple[str, ...]) -> Pair:
        """Add the C struct for a tuple that the C function `name` returns, and return its type. Without as
        many `members` as `kinds`, the members are part_0, part_1 and so on."""
        members = members if len(members) == len(kinds) else tuple(f"part_{i}" for i in range(len(kinds)))
        self._pairs[name] = Pair(f"{name}_result", members, kinds)
        return self._pairs[name]

    def table(self, name: str, numbers: tuple[float, ...]) -> str:
        """Add a constant C array of numbers, once for equal numbers; return its C name, which contains
        `name`."""
        word = "".join(c if c.isalnum() and c.isascii() else "_" for c in name)
        return self._tables.setdefault(numbers, f"ss_table_{len(self._tables)}_{word}")

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the object for a key; only the first time, `make` is called to create it. So each local
        function has one syntax tree, and is translated once."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def c_type(self, kind: Any) -> str:
        """Return the C name of a type: that of a struct, or "real_t", "int64_t" or "bool"."""
        return kind.c_name if isinstance(kind, Record | Pair) else str(kind)

    def text(self) -> str:
        """Return the C source: all structs and tables, then all functions, callees first."""
        structs = [self._struct(record.c_name, record.fields) for record in self._records.values()]
        structs += [
            self._struct(p.c_name, tuple(zip(p.members, p.types, strict=True))) for p in self._pairs.values()
        ]
        structs += [
            f"static const real_t {name}[{len(numbers)}] = {{{', '.join(map(real, numbers))}}};\n"
            for numbers, name in self._tables.items()
        ]
        return "\n".join([*structs, *self._bodies])

    def _struct(self, name: str, fields: tuple[tuple[str, Any], ...]) -> str:
        lines = [
            f"    real_t {field}[{kind.length}];"
            if isinstance(kind, Array)
            else f"    {self.c_type(kind)} {field};"
            for field, kind in fields
        ]
        return "\n".join(["typedef struct {", *lines, f"}} {name};", ""])
