"""The API reference: one page for each room, with all of its public names, written before Sphinx reads."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path
from typing import Any

from public_names import ROOMS, TOP, everything

import stickslip
from stickslip.quantities.records import quantities

_TOP_LEVEL = "stickslip"


def _room(name: str, value: Any) -> str:
    """The page of a name: its sub-package, or that in which it is made."""
    room, dot, _ = name.partition(".")
    if dot:
        return room
    parts = str(getattr(value, "__module__", "")).split(".")
    return parts[1] if len(parts) > 1 and parts[0] == "stickslip" else _TOP_LEVEL


def _entries(names: dict[str, Any]) -> list[str]:
    """Return the entries of a page. The equations of a friction law are in the docstring of its file."""
    found, file = [], ""
    for name, value in names.items():
        if value in stickslip.LAWS and value.__module__ != file:
            file = value.__module__
            title = file.rpartition(".")[2].replace("_", " ")
            found.append(f"{title}\n{'-' * len(title)}\n\n.. automodule:: {file}\n   :no-index:\n")
        found.append(_entry(name, value))
    return found


def _entry(name: str, value: Any) -> str:
    if inspect.isclass(value):
        return f".. autoclass:: stickslip.{name}\n   :members:\n"
    if callable(value):
        return f".. autofunction:: stickslip.{name}\n"
    return f".. autodata:: stickslip.{name}\n   :no-value:\n"


def _daily() -> str:
    """A list of the names at the top, in the groups of the stub."""
    groups: dict[str, list[str]] = {}
    for line in Path(stickslip.__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines():
        if line.startswith("# ") and "isort" not in line:
            groups[line[2:]] = []
        elif line.startswith("from ") and (name := line.split()[-1]) in TOP:
            groups[list(groups)[-1]].append(f":any:`{name} <stickslip.{name}>`")
    return "".join(f"- {group}: {', '.join(names)}\n" for group, names in groups.items() if names)


def write(app: Any) -> None:
    """Into docs/api, which git ignores."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    rooms: dict[str, dict[str, Any]] = {}
    for name, value in sorted(everything().items(), key=lambda item: item[0].lower()):
        rooms.setdefault(_room(name, value), {})[name] = value
    laws = rooms["friction"]  # those of one file one after the other, under its equations once
    rooms["friction"] = dict(sorted(laws.items(), key=lambda item: (item[1].__module__, item[0])))
    pages = {}
    for room, names in rooms.items():
        module = ROOMS.get(room) or (stickslip if room == _TOP_LEVEL else import_module(f"stickslip.{room}"))
        first = (inspect.getdoc(module) or "").split("\n\n")[0]
        title = f"{room}\n{'=' * len(room)}\n"
        pages[room] = "\n".join([title, first, "", *_entries(names)])
    listed = "\n".join(f"   {room}" for room in sorted(pages))
    pages["index"] = (
        "API reference\n=============\n\n``import stickslip as ss``. What daily work needs is at the top:\n\n"
        f"{_daily()}\nThe rest is in sub-packages: ``ss.rig.VirtualRig``.\n\n"
        f".. toctree::\n   :maxdepth: 1\n\n{listed}\n"
    )
    for old in folder.glob("*.rst"):
        if old.stem not in pages:
            old.unlink()
    for room, text in pages.items():
        path = folder / f"{room}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def fields(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """A list of the fields of a record, each with symbol, unit and meaning, behind its docstring."""
    if what in (
        "module",
        "class",
    ):  # |v| is an absolute value there, and no substitution; formulas stay as they are
        lines[:] = [line if line.startswith((" ", "..")) else line.replace("|", "\\|") for line in lines]
    try:
        known = quantities(value) if what == "class" and hasattr(value, "_fields") else {}
    except NameError:  # fields of types that only a type checker imports: no quantities
        known = {}
    if known:
        lines += ["", *(_field(field, quantity) for field, quantity in known.items()), ""]


def no_field_numbers(app: Any, what: str, name: str, value: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what a named tuple says of its fields: "Alias for field number 0"."""
    return True if str(getattr(value, "__doc__", "")).startswith("Alias for field number") else None


def _field(name: str, quantity: Any) -> str:
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    symbol = f"{quantity.symbol}, " if quantity.symbol else ""
    return f":param {name}: {symbol}{quantity.meaning}{unit}"


def setup(app: Any) -> dict[str, bool]:
    """Register this extension with Sphinx."""
    app.connect("builder-inited", write)
    app.connect("autodoc-skip-member", no_field_numbers)
    app.connect("autodoc-process-docstring", fields, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
