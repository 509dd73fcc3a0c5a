"""The API reference: one page for each room, with all of its public names, written before Sphinx reads."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import stickslip
from stickslip.records import quantities

_NO_ROOM = "stickslip"


def _room(value: Any) -> str:
    parts = str(getattr(value, "__module__", "") or _NO_ROOM).split(".")
    return parts[1] if len(parts) > 1 and parts[0] == "stickslip" else _NO_ROOM


def _entries(names: list[str]) -> list[str]:
    """Of a page; the equations of a friction law stand at the head of its file."""
    found, file = [], ""
    for name in names:
        value = getattr(stickslip, name)
        if inspect.isclass(value) and _room(value) == "friction" and value.__module__ != file:
            file = value.__module__
            title = file.rpartition(".")[2].replace("_", " ")
            found.append(f"{title}\n{'-' * len(title)}\n\n.. automodule:: {file}\n   :no-index:\n")
        found.append(_entry(name))
    return found


def _entry(name: str) -> str:
    value = getattr(stickslip, name)
    if inspect.isclass(value):
        return f".. autoclass:: stickslip.{name}\n   :members:\n"
    if callable(value):
        return f".. autofunction:: stickslip.{name}\n"
    return f".. autodata:: stickslip.{name}\n   :no-value:\n"


def write(app: Any) -> None:
    """Into docs/api, which git ignores."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    rooms: dict[str, list[str]] = {}
    for name in sorted(stickslip.__all__, key=str.lower):
        if not name.startswith("_"):
            rooms.setdefault(_room(getattr(stickslip, name)), []).append(name)
    pages = {}
    for room, names in rooms.items():
        if room == "friction":  # laws of one file one after the other, under its equations once
            names.sort(key=lambda name: (getattr(stickslip, name).__module__, name))
        module = getattr(__import__(f"stickslip.{room}"), room) if room != _NO_ROOM else stickslip
        first = (inspect.getdoc(module) or "").split("\n\n")[0]
        title = f"{room}\n{'=' * len(room)}\n"
        pages[room] = "\n".join([title, first, "", *_entries(names)])
    listed = "\n".join(f"   {room}" for room in sorted(pages))
    pages["index"] = (
        "API reference\n=============\n\nAll public names, ``import stickslip as ss``, by room.\n\n"
        f".. toctree::\n\n{listed}\n"
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
    if what == "module":  # |v| is an absolute value there, and no substitution; formulas stay as they are
        lines[:] = [line if line.startswith((" ", "..")) else line.replace("|", "\\|") for line in lines]
    known = quantities(value) if what == "class" and hasattr(value, "_fields") else {}
    if known:
        lines += ["", *(_field(field, quantity) for field, quantity in known.items()), ""]


def _field(name: str, quantity: Any) -> str:
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    symbol = f"{quantity.symbol}, " if quantity.symbol else ""
    return f":param {name}: {symbol}{quantity.meaning}{unit}"


def setup(app: Any) -> dict[str, bool]:
    """As Sphinx asks for."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", fields, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
