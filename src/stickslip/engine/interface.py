"""C structs of function pointers for types of Python records: friction laws, and hysteresis of Duhem's form.

For each type of record there is one struct. It has a C function for each Python function of the type. A
role is the name of such a function in the struct, such as "rate". The fields of a record are passed to
these functions as a row of parameters: an array of real numbers p, the fields one after the other. Booleans
are 0 or 1; tuples and nested records contribute their numbers. Text and None are constants in the C source,
and not in the row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from .translator import BOOL, INT, KEYWORDS, REAL, Array, Record, Translation, TranslationError, record_type


class CallSignature(NamedTuple):
    """C signature of a role, without the row of parameters.

    Fields: `values`, pairs of C type and name of the arguments; `results`, names of the results that the
    function writes through pointers to real numbers; `returns`, C type that it returns ("void" if there are
    results).
    """

    values: tuple[tuple[str, str], ...]
    results: tuple[str, ...]
    returns: str


class Interface(NamedTuple):
    """Declaration of a kind of C struct of function pointers, for Python records of one kind: `law` for
    friction laws, `duhem` for hysteresis.

    Attributes:
        name: name of the C struct.
        noun: word for such a record in messages.
        header: name of the C header that declares the struct.
        arguments: C declaration of the arguments of each role, by role, after the row of parameters.
        whole: roles whose C function returns an integer.
        functions: function that gets a record class, and returns its Python functions by role.
        numbers: function that gets the translator's type of a record, and returns the values of further
            integer members of the struct, by name.
        inputs: function that gets a role, and returns a list of argument tuples, for which the results of the
            compiled and of the Python function are compared.
    """

    name: str
    noun: str
    header: str
    arguments: dict[str, str]
    whole: frozenset[str]
    functions: Callable[[type], dict[str, Any]]
    numbers: Callable[[Record], dict[str, int]]
    inputs: Callable[[str], list[tuple[Any, ...]]]

    def signature(self, role: str) -> CallSignature:
        """Return the C signature of a role, without the row of parameters."""
        words = [tuple(word.rsplit(" ", 1)) for word in self.arguments[role].split(", ") if word]
        values = tuple((kind, name) for kind, name in words if not name.startswith("*"))
        results = tuple(name[1:] for _, name in words if name.startswith("*"))
        return CallSignature(
            values, results, "void" if results else "int" if role in self.whole else "real_t"
        )

    def packaged(self, classes: list[type]) -> str:
        """Return the C source of some of the package's record classes, all of whose fields are real numbers:
        the translated functions, a struct for each class, and an array of pointers to these structs, through
        which the library lists them."""
        made = Translation()
        parts = [self.c_of(made, of_numbers(one)) for one in classes]
        names = "\n".join(f"    &{self.name}_{one.__name__}," for one in classes)
        table = f"static const struct {self.name} *const packaged_{self.name}[] = {{\n{names}\n}};\n"
        return "\n".join([made.text(), *parts, table])

    def c_of(self, made: Translation, kind: Record) -> str:
        """Return the C source of the struct of a record type, and of a C function for each of its roles.

        Args:
            made: translation to which the translated Python functions are added; its text must precede the
                result.
            kind: the translator's type of the record.

        Raises:
            TranslationError: a function is outside the subset that can be translated, or has other results
                than the role asks for; or the name of the class is not ASCII.
        """
        name = kind.record_class.__name__
        if not name.isascii():
            raise TranslationError(f"{name} cannot be translated to C: C takes names in ASCII only")
        given = self.functions(kind.record_class)
        parts = [self._role_c(made, kind, role, function) for role, function in given.items()]
        members = {"name": f'"{name}"', "parameters": numbers(kind), **self.numbers(kind)}
        members |= {
            role: f"{self.name}_{role}_{name}" if role in given else "NULL" for role in self.arguments
        }
        lines = "\n".join(f"    .{member} = {text}," for member, text in members.items())
        parts.append(f"static const struct {self.name} {self.name}_{name} = {{\n{lines}\n}};\n")
        return "\n".join(parts)

    def _role_c(self, made: Translation, kind: Record, role: str, function: Any) -> str:
        """Return the source of the C function of a role. It builds the record's C struct from the row of
        parameters p, and calls the translated Python function `function`, which is added to `made`. Raises
        TranslationError if the function cannot be translated, or returns other results than its role
        needs."""
        name, struct, fill = (
            kind.record_class.__name__,
            made.record(kind),
            _filled(kind, iter(range(numbers(kind)))),
        )
        values, results, returns = self.signature(role)
        kinds = (kind, *(INT if one == "int" else REAL for one, _ in values))
        called, result = made.function(function, kinds, results)
        call = f"{called}({', '.join(['&of', *(word for _, word in values)])})"
        if results:
            if len(getattr(result, "members", ())) != len(results):
                raise TranslationError(
                    f"{name} cannot be translated to C: {role} must give ({', '.join(results)})"
                )
            body = [f"const {result.c_name} found = {call};"]
            body += [f"*{word} = found.{word};" for word in results]
        else:
            body = [f"return {call};" if result == returns else f"return ({returns}){call};"]
        head = ", ".join(["const real_t *p", *([self.arguments[role]] if values else [])])
        lines = [f"const {struct} of = {fill};", *(["(void)p;"] if not numbers(kind) else []), *body]
        text = "\n    ".join(lines)
        return f"static {returns} {self.name}_{role}_{name}({head})\n{{\n    {text}\n}}\n"


def of_package(record_class: type) -> bool:
    """Return True for a record class of this package, whose functions are compiled into the library; False
    for a user's own."""
    return record_class.__module__.split(".")[0] == __name__.split(".")[0]


def numbers(kind: Any) -> int:
    """Return the number of parameters in a row for a value of this type: a record, an array or a number."""
    if isinstance(kind, Record):
        return sum(numbers(inner) for _, inner in kind.fields)
    return kind.length if isinstance(kind, Array) else 1


def _filled(kind: Any, places: Iterator[int]) -> str:
    """Return the C initialiser of a value from the row of parameters p, such as "{p[0], p[1] != R(0.0)}".

    Args:
        kind: the translator's type of the value.
        places: iterator over the indices of the row, of which the value takes the next ones.
    """
    if isinstance(kind, Record):
        return f"{{{', '.join(_filled(inner, places) for _, inner in kind.fields) or '0'}}}"
    if isinstance(kind, Array):
        return f"{{{', '.join(f'p[{next(places)}]' for _ in range(kind.length))}}}"
    text = f"p[{next(places)}]"
    return {BOOL: f"{text} != R(0.0)", INT: f"r_whole({text})"}.get(kind, text)


def row_of(kind: Any, place: str) -> list[str]:
    """Return the C expressions of all numbers of a value, in the order of a row of parameters.

    Args:
        kind: the translator's type of the value.
        place: C expression of the value, such as "of.friction".
    """
    if isinstance(kind, Record):
        named = [(f"{name}_" if name in KEYWORDS else name, inner) for name, inner in kind.fields]
        return [text for name, inner in named for text in row_of(inner, f"{place}.{name}")]
    if isinstance(kind, Array):
        return [f"{place}[{i}]" for i in range(kind.length)]
    return [place if kind == REAL else f"(real_t){place}"]


def row(record: Any) -> list[float]:
    """Return the row of parameters of a record, as real numbers (see the module)."""
    found: list[float] = []
    for name, inner in record_type(record).fields:
        value = getattr(record, name)
        if isinstance(inner, Record):
            found += row(value)
        else:
            found += map(float, value) if isinstance(inner, Array) else [float(value)]
    return found


def of_numbers(record_class: type) -> Record:
    """Return the translator's type of a record class, if all its fields are real numbers."""
    return Record(record_class, tuple((name, REAL) for name in record_class._fields))  # type: ignore[attr-defined]
