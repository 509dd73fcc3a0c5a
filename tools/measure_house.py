"""Measures of the package's structure: rooms, arrows, lines, names, numbers, arguments.

    python tools/measure_house.py

A room is a module or package at the top of `stickslip`; an arrow, that one room imports from another. Numbers
are signs: code that is squeezed to reach one is worse than code that misses it.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "stickslip"
MANY_ARGUMENTS = 10
_BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension, ast.match_case)
_Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources() -> dict[Path, ast.Module]:
    """Return the syntax tree of each file by its path inside the package."""
    return {
        file.relative_to(PACKAGE): ast.parse(file.read_text("utf-8"))
        for file in sorted(PACKAGE.rglob("*.py"))
    }


def room(file: Path) -> str:
    """Return the name of the room that a file stands in."""
    return file.parts[0].removesuffix(".py")


def imported(file: Path, tree: ast.Module) -> Iterator[str]:
    """Yield the rooms that a file imports from."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            above = [*file.parts[: len(file.parts) - node.level]]
            module = [*above, *(node.module or "").split(".")] if node.module else above
            yield from [module[0]] if module else [alias.name for alias in node.names]


def arrows(trees: dict[Path, ast.Module]) -> Counter[tuple[str, str]]:
    """Return how often each room imports from each other one."""
    found = Counter[tuple[str, str]]()
    for file, tree in trees.items():
        found.update((room(file), other) for other in imported(file, tree) if other != room(file))
    return found


def functions(trees: dict[Path, ast.Module]) -> Iterator[_Function]:
    """Yield all functions and methods."""
    for tree in trees.values():
        yield from (node for node in ast.walk(tree) if isinstance(node, _Function))


def arguments(function: _Function) -> int:
    """Return the number of arguments that a caller can give."""
    given = function.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len(names) - (bool(names) and names[0] in ("self", "cls"))


def complexity(function: _Function) -> int:
    """Return the number of independent paths: branches and parts of conditions, and one."""
    nodes = list(ast.walk(function))
    parts = sum(len(node.values) - 1 for node in nodes if isinstance(node, ast.BoolOp))
    return 1 + parts + sum(isinstance(node, _BRANCHES) for node in nodes)


def constants(trees: dict[Path, ast.Module]) -> int:
    """Return how many numbers stand as constants of modules, each of a tuple for itself."""
    return sum(
        isinstance(inner, ast.Constant) and type(inner.value) in (int, float)
        for tree in trees.values()
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for inner in ast.walk(node.value)
    )


def measures() -> list[tuple[str, str]]:
    """Return what is measured, and the figure."""
    trees = sources()
    lines = sum(len((PACKAGE / file).read_text("utf-8").splitlines()) for file in trees)
    found, every = arrows(trees), list(functions(trees))
    rooms = {room(file) for file in trees if not file.name.startswith("__") or len(file.parts) > 1}
    classes = Counter(
        node.name for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    )
    unsaid = sum(
        isinstance(node, ast.Name) and node.id == "Any" for tree in trees.values() for node in ast.walk(tree)
    )
    many = [count for one in every if (count := arguments(one)) >= MANY_ARGUMENTS]
    return [
        ("top-level rooms", f"{len(rooms)}"),
        ("arrows between rooms", f"{len(found)}"),
        ("lines of Python", f"{lines:,}"),
        ("class names with two meanings", f"{sum(n > 1 for n in classes.values())} of {len(classes)}"),
        ("numbers as constants of modules", f"{constants(trees):,}"),
        (f"functions of {MANY_ARGUMENTS} or more arguments; most", f"{len(many)}; {max(many, default=0)}"),
        ("largest complexity", f"{max(map(complexity, every))}"),
        ("Any per 1,000 lines", f"{1e3 * unsaid / lines:.1f}"),
    ]


if __name__ == "__main__":
    for what, figure in measures():
        print(f"{what:48s} {figure}")
