"""Translate the statements of one function of the subset from Python's syntax tree to C; `loops` translates
loops."""

from __future__ import annotations

import ast
import inspect
import re
from typing import TYPE_CHECKING, Any

from . import calls as calls  # this import adds the translation of calls to `expressions.NODES`
from .assignments import Retyped, assign, parts_of, set_variable
from .expressions import (
    NUMBERS,
    LocalFunction,
    as_bool,
    as_type,
    expression,
    identifier,
    outside,
    variable,
)
from .loops import loop
from .subset import (
    BOOL,
    INT,
    REAL,
    Array,
    FunctionSource,
    Pair,
    Record,
    Tuple,
    Value,
    joined,
    kind_of,
    with_arguments,
)

if TYPE_CHECKING:
    from .translation import Translation

CHECK = ("check",)
RESULT = "return"  # key of the type of the function's result in `types`, because no variable has this name
_TEXT = "const char *"
# C initial value, by type, of a variable that is declared at the top of a function and set in branches.
_UNSET = {REAL: "R(NAN)", INT: "0", BOOL: "false"}


class FunctionBody:
    """Translation of one function for given types of its arguments. It writes the C lines of the statements,
    and is the `expressions.Context` of their expressions.

    Args:
        translation: translation to which called functions, structs and tables are added.
        source: the function.
        kinds: types of its arguments.
        members: names of the parts of a result that is a tuple, which are then real numbers; `CHECK` for a
            method that raises errors, whose C function returns their text.
        types: types of variables, by name, that are wider than those of their first values.
    """

    def __init__(
        self,
        translation: Translation,
        source: FunctionSource,
        kinds: tuple[Any, ...],
        members: tuple[str, ...],
        types: dict[str, Any],
    ) -> None:
        self.translation, self.source, self.kinds, self.members = translation, source, kinds, members
        self.variables: dict[str, Any] = {}
        self.pointers: set[str] = set()
        self.stores = _stores(source.tree)
        self.locals = {*self.stores, *(n.name for n in source.tree.body if isinstance(n, ast.FunctionDef))}
        self.types, self.depth = types, 1
        self._checks = members == CHECK
        self._result: Any = None
        self._name = ""
        self._lines: list[str] = []
        self.declared: dict[str, Any] = {}  # types of variables that are first set inside a branch
        self._temporaries = 0

    def translated(self, name: str) -> tuple[Any, str]:
        """Translate the function; return the type of its result, and the source of a C function with this
        name.

        Raises:
            TranslationError: the function is outside the subset.
            Retyped: a variable or the result needs a wider type than in `types`.
        """
        tree, self._name = self.source.tree, name
        arguments = tree.args
        if (
            arguments.vararg
            or arguments.kwarg
            or arguments.kwonlyargs
            or len(arguments.args) != len(self.kinds)
        ):
            raise self.source.error(tree, "it must have plain arguments only, and be called with all of them")
        parameters: list[tuple[str, str]] = []
        for argument, kind in zip(arguments.args, self.kinds, strict=True):
            parameters += self._parameter(argument, kind)
        returned = self._block(tree.body)
        if self._checks:
            self._result = _TEXT
            self.line("return NULL;")
        elif not returned:
            raise self.source.error(tree, "it must end in a return on every path")
        text = "\n".join(self._lines)
        unused = [f"    (void){name};" for name, _ in parameters if not _has(text, name)]
        early = [
            f"    {self.translation.c_type(kind)} {name} = {_UNSET.get(kind, '{0}')};"
            for name, kind in self.declared.items()
            if _has(text, name)
        ]
        head = f"static inline {self.translation.c_type(self._result)} {name}"
        head += f"({', '.join(declared for _, declared in parameters)})"
        body = [self._comment(), head, "{", *early, *unused, *self._lines, "}", ""]
        return self._result, "\n".join(body)

    def _parameter(self, argument: ast.arg, kind: Any) -> list[tuple[str, str]]:
        """Return a list of pairs of C name and C declaration for a parameter of this type: one pair, or one
        per part of a tuple."""
        name = argument.arg
        if kind in NUMBERS:
            kind = joined(kind, self.types.get(name)) if name in self.types else kind
        self.variables[name] = kind
        c_name = identifier(self, argument, name)
        if isinstance(kind, Record):
            self.pointers.add(name)
            return [(c_name, f"const {self.translation.record(kind)} *{c_name}")]
        if isinstance(kind, Array):
            return [(c_name, f"const real_t {c_name}[{kind.length}]")]
        if isinstance(kind, Tuple):
            inner = (self._parameter(ast.arg(f"{name}__{i}"), one) for i, one in enumerate(kind.types))
            return [one for several in inner for one in several]
        return [(c_name, f"{kind} {c_name}")]

    def _comment(self) -> str:
        local = self.source.name != self.source.function.__name__
        text = "" if local else inspect.getdoc(self.source.function) or ""
        text = " ".join(text.partition("\n\n")[0].split())
        ascii_text = text.encode("ascii", "replace").decode().replace("*/", "* /")
        where = f"{self.source.where}.{self.source.name}"
        return f"/* {where}{': ' + ascii_text if text else ''} */"

    # Methods of `expressions.Context`, which the translation of expressions calls.

    def line(self, text: str) -> None:
        """Write a line of C at the present indentation."""
        self._lines.append("    " * self.depth + text)

    def lines(self, texts: list[str]) -> None:
        """Write several lines of C at the present indentation."""
        for text in texts:
            self.line(text)

    def captured(self, node: ast.expr) -> tuple[Value, list[str]]:
        """Translate an expression; return its value, and the C lines that must precede it, which are not
        written."""
        value, before = self.capturing(lambda: expression(self, node))
        return value, before

    def capturing(self, what: Any) -> tuple[Any, list[str]]:
        """Call the function `what` without arguments; return its result, and the C lines that it would have
        written, without indentation."""
        lines, depth = self._lines, self.depth
        self._lines, self.depth = [], 0
        try:
            return what(), self._lines
        finally:
            self._lines, self.depth = lines, depth

    def use(self, record: Record) -> None:
        """Add the C struct of a record type to the translation, unless it contains the struct already."""
        self.translation.record(record)

    def table(self, name: str, numbers: tuple[float, ...]) -> str:
        """Return the name of a constant C array of numbers, which is added to the translation if it is new;
        `name` is part of the C name."""
        return self.translation.table(name, numbers)

    def _new(self) -> str:
        self._temporaries += 1
        return f"made_{self._temporaries}"

    def temporary(self, c_type: Any, text: str) -> str:
        """Write the declaration of a new C variable with the value `text`, and return its name; the variable
        is only valid in the present block."""
        name = self._new()
        if isinstance(c_type, Array):
            self.line(f"const real_t {name}[{c_type.length}] = {text};")
        else:
            self.line(f"{self.translation.c_type(c_type)} {name} = {text};")
        return name

    def hoisted(self, c_type: Any) -> str:
        """Declare a new C variable at the top of the function, and return its name, so that branches can set
        it."""
        name = self._new()
        self.declared[name] = c_type
        return name

    def call(self, node: ast.AST, function: Any, arguments: list[Value]) -> Value:
        """Translate another function for the types of these arguments, and return the value of its call. A
        struct that the call returns is stored in a new C variable."""
        if isinstance(function, LocalFunction):
            function, arguments = self._closed(node, function, arguments)
        kinds = tuple(kind_of(value) for value in arguments)
        name, result = self.translation.function(function, kinds)
        text = f"{name}({', '.join(part for value in arguments for part in _handed(value))})"
        if isinstance(result, Pair):
            made = self.temporary(result, text)
            members = zip(result.members, result.types, strict=True)
            return Value("", None, parts=tuple(Value(f"{made}.{member}", kind) for member, kind in members))
        if isinstance(result, Record):
            return Value(self.temporary(result, text), result)
        return Value(text, result)

    def _closed(
        self, node: ast.AST, function: LocalFunction, arguments: list[Value]
    ) -> tuple[LocalFunction, list[Value]]:
        """Return a local function whose further arguments are the variables of this function that it uses,
        because C has no nested functions; and the values of all arguments at the call."""
        tree = function.source.tree
        if len(tree.args.args) != len(arguments):
            raise self.source.error(node, f"{ast.unparse(node)!r} does not fit the function's arguments")
        inside = {n.id for one in tree.body for n in ast.walk(one) if isinstance(n, ast.Name)}
        inside -= {*_stores(tree), *(one.arg for one in tree.args.args)}
        known = ((n, kind) for n, kind in self.variables.items() if not isinstance(kind, LocalFunction))
        taken = {n: kind for n, kind in known if n in inside}
        made = self.translation.kept((tree, *taken), lambda: with_arguments(tree, list(taken)))
        values = [variable(self, node, name, kind) for name, kind in taken.items()]
        return LocalFunction(function.source._replace(tree=made)), [*arguments, *values]

    # Translation of statements. Each method returns True if the statement leaves the block on every path.

    def _block(self, statements: list[ast.stmt]) -> bool:
        # `any` stops at the first statement that leaves the block, because the code after it is unreachable.
        return any(self._statement(statement) for statement in statements)

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
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Lambda() as tree):
                local = self.translation.kept(tree, lambda: self.source.local(tree, name))
                self.variables[name] = LocalFunction(local)
                return False
            case ast.Assign(targets=targets, value=value):
                assign(self, node, targets, expression(self, value))
                return False
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                self.set(node, name, expression(self, value))
                return False
            case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                whole = ast.copy_location(ast.BinOp(ast.Name(target.id, ast.Load()), op, value), node)
                self.set(node, target.id, expression(self, ast.fix_missing_locations(whole)))
                return False
            case ast.If():
                return self._if(node)
            case ast.FunctionDef(name=name) if not node.decorator_list:
                self.variables[name] = LocalFunction(self.source.local(node, name))
                return False
        found = loop(self, node)
        if found is None:
            raise self.source.error(node, f"{type(node).__name__} statements are outside the subset")
        return found

    def _message(self, node: ast.expr) -> str:
        """Return an error message (a text or f-string) as a C string literal. A class name in it becomes that
        of the record; other values that Python would insert become "..."."""
        owner = next((kind.record_class.__name__ for kind in self.kinds if isinstance(kind, Record)), "")
        words = []
        for part in node.values if isinstance(node, ast.JoinedStr) else [node]:
            if isinstance(part, ast.Constant):
                words.append(str(part.value))
            else:
                words.append(owner if "__name__" in ast.unparse(part) else "...")
        text = "".join(words).encode("ascii", "replace").decode().replace("%", "percent")
        return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'

    def set(self, node: ast.AST, name: str, value: Value) -> None:
        """Write the C statements that assign a value to the variable `name`; a new variable is declared."""
        set_variable(self, node, name, value)

    def _if(self, node: ast.If) -> bool:
        test = as_bool(self, node.test, expression(self, node.test))
        if test.constant is not None:
            return self._block(node.body if test.constant else node.orelse)
        self.line(f"if ({test.text}) {{")
        yes = self.indented(node.body)
        if not node.orelse:
            self.line("}")
            return False
        before = len(self._lines)
        self.line("} else {")
        no = self.indented(node.orelse)
        self.line("}")
        # If the else branch contains only an `if`, write it as "else if", without its own block.
        chained = self._lines[before + 1 :]
        if len(node.orelse) == 1 and chained and chained[0].lstrip().startswith("if ("):
            inner = [line.removeprefix("    ") for line in chained[:-1]]
            self._lines[before:] = [f"{'    ' * self.depth}}} else {inner[0].lstrip()}", *inner[1:]]
        return yes and no

    def indented(self, statements: list[ast.stmt]) -> bool:
        """Translate a block one level deeper; return True if it leaves the block on every path."""
        self.depth += 1
        try:
            return self._block(statements)
        finally:
            self.depth -= 1

    def _return(self, node: ast.expr) -> None:
        value = parts_of(expression(self, node))
        kind = kind_of(value)
        if isinstance(kind, Tuple):
            if self.members:
                kind = Tuple(tuple(REAL if one in (INT, BOOL) else one for one in kind.types))
            kind = self._expect(node, kind)
            if any(isinstance(one, Tuple | Array) for one in kind.types):
                raise self.source.error(node, f"{ast.unparse(node)} cannot be a result")
            result = self.translation.pair(self._name, kind.types, self.members)
            text = ", ".join(part.text for part in as_type(self, node, value, kind).parts)
            self.line(f"return ({result.c_name}){{{text}}};")
            self._result = result
            return
        if kind not in (REAL, BOOL, INT) and not isinstance(kind, Record):
            raise self.source.error(node, f"{ast.unparse(node)} cannot be a result")
        value = as_type(self, node, value, self._expect(node, kind))
        self.line(f"return {'*' if value.pointer else ''}{value.text};")
        self._result = value.type

    def _expect(self, node: ast.AST, kind: Any) -> Any:
        """Return the type of the function's result that is wide enough for a return of the type `kind` and
        all previous returns.

        Raises:
            TranslationError: there is no such type.
            Retyped: previous returns used a narrower type.
        """
        known = self.types.get(RESULT)
        before = self._result
        if isinstance(before, Pair):
            before = Tuple(before.types)
        wanted = joined(joined(known, kind), before) if before is not None else joined(known, kind)
        if wanted is None:
            raise self.source.error(node, "all returns must give the same types")
        if before is not None and wanted != before:
            raise Retyped(RESULT, wanted)
        return wanted


def _stores(tree: ast.FunctionDef) -> list[str]:
    """Return the names to which a function assigns, each as often as it is assigned, without those of inner
    functions."""
    found: list[str] = []
    pending: list[ast.AST] = list(tree.body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.append(node.id)
        if not isinstance(node, ast.FunctionDef | ast.Lambda):
            pending += ast.iter_child_nodes(node)
    return found


def _handed(value: Value) -> list[str]:
    """Return the C texts with which a value is passed to a function: the address of a record, one text per
    part of a tuple, or else the value's text."""
    if value.type is None:
        return [text for part in value.parts for text in _handed(part)]
    return [f"&{value.text}" if isinstance(value.type, Record) and not value.pointer else value.text]


def _has(text: str, name: str) -> bool:
    return re.search(rf"(?<![\w.>]){re.escape(name)}\b", text) is not None
