"""Functions of the subset, from Python's syntax tree to C: statements, calls, types of results.

A function becomes one C function for each combination of types it is called with. What is known beforehand
(the length of a tuple, the class of a record) is decided while translating, so no dead branch reaches C.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable
from typing import Any

from .expressions import as_bool, as_real, expression, identifier, outside
from .subset import BOOL, INT, REAL, Array, FunctionSource, Pair, Record, Value, source_of

_CHECK = ("check",)
_TEXT = "const char *"
_MOST_ROUNDS = 4096  # of a loop: work per step is bounded


class Translation:
    """The C of some functions and of all that they call: `text()` after calling `function` for each."""

    def __init__(self) -> None:
        self._records: dict[str, Record] = {}
        self._pairs: dict[str, Pair] = {}
        self._functions: dict[tuple[Any, ...], tuple[str, Any]] = {}
        self._names: dict[str, Any] = {}
        self._bodies: list[str] = []
        self._open: list[Any] = []

    def record(self, record: Record) -> str:
        """The C name of a record's struct, which is declared."""
        for _, kind in record.fields:
            if isinstance(kind, Record):
                self.record(kind)
        known = self._records.setdefault(record.c_name, record)
        if known != record:
            raise ValueError(f"{record.c_name} would be two different structs in C")
        return record.c_name

    def function(
        self, function: Callable[..., Any], kinds: tuple[Any, ...], members: tuple[str, ...] = ()
    ) -> tuple[str, Any]:
        """The C name and the type of the result of a function called with these types.

        `members` names the parts of the result, if it is a tuple.

        Raises:
            TranslationError: the function, or one that it calls, is outside the subset.
        """
        plain = getattr(function, "py_func", function)
        key = (plain, kinds)
        if key not in self._functions:
            source = source_of(plain)
            if plain in self._open:
                raise source.error(None, "it calls itself; the work per step would have no bound")
            self._open.append(plain)
            name = f"ss_{source.name.lstrip('_')}"
            while self._names.setdefault(name, key) != key:
                name += "_"
            result, body = _Function(self, source, kinds, members).translated(name)
            self._open.pop()
            self._functions[key] = (name, result)
            self._bodies.append(body)
        return self._functions[key]

    def check(self, function: Callable[..., Any], kind: Record) -> str:
        """The C name of a record's ``_check``, in which raising is to return the text of the error."""
        name, _ = self.function(function, (kind,), _CHECK)
        return name

    def pair(self, name: str, kinds: tuple[Any, ...], members: tuple[str, ...]) -> Pair:
        """The struct for a tuple that a function returns."""
        members = members if len(members) == len(kinds) else tuple(f"part_{i}" for i in range(len(kinds)))
        return self._pairs.setdefault(name, Pair(f"{name}_result", members, kinds))

    def c_type(self, kind: Any) -> str:
        """How C declares a type."""
        return kind.c_name if isinstance(kind, Record | Pair) else str(kind)

    def text(self) -> str:
        """All structs, then all functions, callees first."""
        structs = [self._struct(record.c_name, record.fields) for record in self._records.values()]
        structs += [
            self._struct(p.c_name, tuple(zip(p.members, p.types, strict=True))) for p in self._pairs.values()
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


class _Function:
    """One function on its way to C: what `expressions.Context` asks for, and the statements."""

    def __init__(
        self,
        translation: Translation,
        source: FunctionSource,
        kinds: tuple[Any, ...],
        members: tuple[str, ...],
    ) -> None:
        self.translation, self.source, self.kinds, self.members = translation, source, kinds, members
        self.variables: dict[str, Any] = {}
        self.pointers: set[str] = set()
        self._checks = members == _CHECK
        self._result: Any = None
        self._name = ""
        self._lines: list[str] = []
        self._declared: dict[str, Any] = {}  # of variables that are first set inside a branch
        self._depth = 1
        self._temporaries = 0

    def translated(self, name: str) -> tuple[Any, str]:
        tree, self._name = self.source.tree, name
        arguments = tree.args
        if (
            arguments.vararg
            or arguments.kwarg
            or arguments.kwonlyargs
            or len(arguments.args) != len(self.kinds)
        ):
            raise self.source.error(tree, "it must have plain arguments only, and be called with all of them")
        parameters = []
        for argument, kind in zip(arguments.args, self.kinds, strict=True):
            self.variables[argument.arg] = kind
            c_name = identifier(self, tree, argument.arg)
            if isinstance(kind, Record):
                self.pointers.add(argument.arg)
                parameters.append(f"const {self.translation.record(kind)} *{c_name}")
            elif isinstance(kind, Array):
                parameters.append(f"const real_t {c_name}[{kind.length}]")
            else:
                parameters.append(f"{kind} {c_name}")
        returned = self._block(tree.body)
        if self._checks:
            self._result = _TEXT
            self.line("return NULL;")
        elif not returned:
            raise self.source.error(tree, "it must end in a return on every path")
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        unused = [f"    (void){identifier(self, tree, a.arg)};" for a in arguments.args if a.arg not in used]
        unused += [
            f"    (void){identifier(self, tree, a.arg)};"
            for a in arguments.args
            if a.arg in used and not any(a.arg in line for line in self._lines)
        ]
        early = [
            f"    {self.translation.c_type(kind)} {variable};" for variable, kind in self._declared.items()
        ]
        c_type = self.translation.c_type(self._result)
        head = f"static inline {c_type} {name}({', '.join(parameters)})"
        body = [self._comment(), head, "{", *early, *unused, *self._lines, "}", ""]
        return self._result, "\n".join(body)

    def _comment(self) -> str:
        text = " ".join((inspect.getdoc(self.source.function) or "").partition("\n\n")[0].split())
        ascii_text = text.encode("ascii", "replace").decode().replace("*/", "* /")
        where = f"{self.source.where}.{self.source.name}"
        return f"/* {where}{': ' + ascii_text if text else ''} */"

    # What expressions ask for.

    def line(self, text: str) -> None:
        self._lines.append("    " * self._depth + text)

    def use(self, record: Record) -> None:
        self.translation.record(record)

    def temporary(self, c_type: Any, text: str) -> str:
        self._temporaries += 1
        name = f"made_{self._temporaries}"
        self.line(f"{self.translation.c_type(c_type)} {name} = {text};")
        return name

    def call(self, node: ast.AST, function: Callable[..., Any], arguments: list[Value]) -> Value:
        kinds = tuple(REAL if v.type == INT and v.constant is not None else v.type for v in arguments)
        if any(kind is None for kind in kinds):
            raise self.source.error(node, "a tuple cannot be handed to another function")
        values = [
            as_real(self, node, value) if kind == REAL else value
            for value, kind in zip(arguments, kinds, strict=True)
        ]
        name, result = self.translation.function(function, kinds)
        texts = [f"&{v.text}" if isinstance(v.type, Record) and not v.pointer else v.text for v in values]
        text = f"{name}({', '.join(texts)})"
        if isinstance(result, Pair):
            made = self.temporary(result, text)
            members = zip(result.members, result.types, strict=True)
            return Value(made, None, parts=tuple(Value(f"{made}.{member}", kind) for member, kind in members))
        if isinstance(result, Record):
            return Value(self.temporary(result, text), result)
        return Value(text, result)

    # Statements. Each says whether it returns on every path.

    def _block(self, statements: list[ast.stmt]) -> bool:
        return any(self._statement(statement) for statement in statements)  # what follows a return is dead

    def _statement(self, node: ast.stmt) -> bool:
        match node:
            case ast.Expr(value=ast.Constant(value=str())) | ast.Pass():
                return False
            case ast.Raise(exc=ast.Call(args=[message])) if self._checks:
                self.line(f"return {self._message(message)};")
                return True
            case ast.Expr(value=ast.Call(func=func, args=[ast.Name() as argument])) if self._checks:
                owner = expression(self, argument)
                if not isinstance(owner.type, Record):
                    raise self.source.error(node, f"{ast.unparse(argument)} is no record")
                name = self.translation.check(outside(self, func), owner.type)
                wrong = self.temporary(_TEXT, f"{name}({owner.text})")
                self.line(f"if ({wrong} != NULL) {{ return {wrong}; }}")
                return False
            case ast.Return(value=ast.expr() as value):
                self._return(value)
                return True
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._set(node, name, expression(self, value))
                return False
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                self._unpack(node, targets, expression(self, value))
                return False
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                self._set(node, name, expression(self, value))
                return False
            case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                whole = ast.copy_location(ast.BinOp(ast.Name(target.id, ast.Load()), op, value), node)
                self._set(node, target.id, expression(self, ast.fix_missing_locations(whole)))
                return False
            case ast.If():
                return self._if(node)
            case ast.For(target=ast.Name(id=name), iter=ast.Call() as call, orelse=[]):
                self._for(node, name, call)
                return False
        raise self.source.error(node, f"{type(node).__name__} statements are outside the subset")

    def _message(self, node: ast.expr) -> str:
        """The text of an error, without the values that it would show."""
        owner = next((kind.record_class.__name__ for kind in self.kinds if isinstance(kind, Record)), "")
        words = []
        for part in node.values if isinstance(node, ast.JoinedStr) else [node]:
            if isinstance(part, ast.Constant):
                words.append(str(part.value))
            else:
                words.append(owner if "__name__" in ast.unparse(part) else "...")
        text = "".join(words).encode("ascii", "replace").decode().replace("%", "percent")
        return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

    def _set(self, node: ast.AST, name: str, value: Value) -> None:
        if value.parts:
            if not value.text:
                raise self.source.error(node, "a tuple needs one name for each of its parts")
            self.variables[name] = value.parts
            return
        known = self.variables.get(name)
        if value.type == INT and (known == REAL or (known is None and value.constant is not None)):
            value = as_real(self, node, value)
        if known is not None and known != value.type:
            raise self.source.error(node, f"{name} changes its type from {known} to {value.type}")
        if isinstance(value.type, Array) or (isinstance(value.type, Record) and known is not None):
            raise self.source.error(node, f"{name} cannot be set to {value.text}")
        c_name = identifier(self, node, name)
        text = f"{'*' if value.pointer else ''}{value.text}"
        if known is None and self._depth == 1:
            self.line(f"{self.translation.c_type(value.type)} {c_name} = {text};")
        else:
            if known is None:
                self._declared[c_name] = value.type
            self.line(f"{c_name} = {text};")
        self.variables[name] = value.type

    def _unpack(self, node: ast.AST, targets: list[ast.expr], value: Value) -> None:
        names = [target.id for target in targets if isinstance(target, ast.Name)]
        if not len(names) == len(targets) == len(value.parts):
            raise self.source.error(node, "a tuple needs one name for each of its parts")
        parts = list(value.parts)
        if not value.text:  # all parts are computed before the first name changes
            parts = [
                Value(self.temporary(part.type, part.text), part.type)
                for part in (as_real(self, node, part) if part.type == INT else part for part in parts)
            ]
        for name, part in zip(names, parts, strict=True):
            self._set(node, name, part)

    def _if(self, node: ast.If) -> bool:
        test = as_bool(self, node.test, expression(self, node.test))
        if test.constant is not None:
            return self._block(node.body if test.constant else node.orelse)
        self.line(f"if ({test.text}) {{")
        yes = self._indented(node.body)
        if not node.orelse:
            self.line("}")
            return False
        before = len(self._lines)
        self.line("} else {")
        no = self._indented(node.orelse)
        self.line("}")
        chained = self._lines[before + 1 :]
        if len(node.orelse) == 1 and chained and chained[0].lstrip().startswith("if ("):  # else if
            inner = [line.removeprefix("    ") for line in chained[:-1]]
            self._lines[before:] = [f"{'    ' * self._depth}}} else {inner[0].lstrip()}", *inner[1:]]
        return yes and no

    def _indented(self, statements: list[ast.stmt]) -> bool:
        self._depth += 1
        try:
            return self._block(statements)
        finally:
            self._depth -= 1

    def _for(self, node: ast.For, name: str, call: ast.Call) -> None:
        bounds = [expression(self, one) for one in call.args]
        limits = [bound.constant for bound in bounds]
        if not (isinstance(call.func, ast.Name) and call.func.id == "range") or len(bounds) not in (1, 2):
            raise self.source.error(node, "a loop must run over range(n) or range(m, n)")
        if any(not isinstance(limit, int) for limit in limits):
            raise self.source.error(node, "the bounds of a loop must be known beforehand")
        first, end = (0, *limits)[-2:]
        if end - first > _MOST_ROUNDS:
            raise self.source.error(node, f"a loop of more than {_MOST_ROUNDS} rounds")
        c_name = identifier(self, node, name)
        self.variables[name] = INT
        self.line(f"for (int {c_name} = {first}; {c_name} < {end}; ++{c_name}) {{")
        self._indented(node.body)
        self.line("}")
        del self.variables[name]

    def _return(self, node: ast.expr) -> None:
        value = expression(self, node)
        if value.parts:
            parts = [as_real(self, node, v) if v.type == INT else v for v in value.parts]
            kinds = tuple(part.type for part in parts)
            result = self.translation.pair(self._name, kinds, self.members)
            self._expect(node, result)
            text = ", ".join(part.text for part in parts)
            self.line(f"return ({result.c_name}){{{text}}};")
            return
        if value.type == INT:
            value = as_real(self, node, value)
        if value.type not in (REAL, BOOL) and not isinstance(value.type, Record):
            raise self.source.error(node, f"{ast.unparse(node)} cannot be a result")
        self._expect(node, value.type)
        self.line(f"return {'*' if value.pointer else ''}{value.text};")

    def _expect(self, node: ast.AST, kind: Any) -> None:
        if self._result is not None and self._result != kind:
            raise self.source.error(node, "all returns must give the same types")
        self._result = kind
