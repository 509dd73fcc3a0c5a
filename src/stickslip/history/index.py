"""The index: one table in SQLite beside the files, brought up to date with them whenever it is asked."""

from __future__ import annotations

import json
import os
import sqlite3
import stat
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from ..readers.process import Reader, ReaderBusy
from ..recording import RecordingError
from ..recording.replacing import BIN, to_bin
from .acts import present_names, read_acts
from .describing import NOTES, RECORDINGS, described, described_fit, described_set

VERSION = 4
COLUMNS = (
    "name", "kind", "changed", "bytes", "begun", "title", "notes", "tags", "operator", "rig", "parameter_set",
    "outcome", "seconds", "samples", "channels", "settings", "links", "problem",
)  # fmt: skip
_NUMBERS = {"changed": "REAL", "bytes": "INTEGER", "seconds": "REAL", "samples": "INTEGER"}
TEXTS = tuple(column for column in COLUMNS if column not in _NUMBERS)  # what a search looks at
SETS = "parameters"  # the folder of parameter sets that fits were saved as
_FOLDER = ".stickslip"


class Index:
    """The recordings and fits of a folder and of those in it; hidden ones are left out.

    Args:
        folder: the lab's.
        read: reads a file, and gives what a function makes of it; by default a process that can be ended.

    Raises:
        OSError: the folder is missing. (Where it cannot be written, the index is kept in memory.)
    """

    def __init__(self, folder: str | os.PathLike[str], read: Callable[..., Any] | None = None) -> None:
        self.folder = Path(folder).resolve()
        if not self.folder.is_dir():
            raise NotADirectoryError(20, "there is no such folder", str(folder))
        self._own = Reader() if read is None else None
        self._read: Callable[..., Any] = read or self._own  # type: ignore[assignment]

    def __enter__(self) -> Index:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process that reads."""
        if self._own is not None:
            self._own.close()

    def rebuild(self) -> None:
        """Forget what is known; the next question reads every file anew."""
        (self.folder / _FOLDER / "runs.sqlite").unlink(missing_ok=True)

    def rows(self, search: str = "", **equal: str) -> list[dict[str, Any]]:
        """What is there, the newest first.

        Args:
            search: words that must all stand somewhere in the texts of a row, case does not matter.
            equal: columns and the text that they must begin with: ``outcome="stopped"``.

        Raises:
            ValueError: there is no such column.
        """
        for column in equal:
            if column not in COLUMNS:
                raise ValueError(f"there is no column {column!r}; there are {', '.join(COLUMNS)}")
        try:
            rows = self._found(search, equal)
        except sqlite3.DatabaseError:  # damaged somewhere inside
            self.rebuild()
            rows = self._found(search, equal)
        acts = read_acts(self.folder)
        of = {one["name"]: str(one["of"]) for one in acts if "of" in one}
        renamed = [one for one in acts if one["act"] == "renamed"]
        for row in rows:
            if not row["links"] and row["name"] not in of:
                continue
            links = json.loads(row["links"] or "{}")
            if row["name"] in of:
                links["prediction"] = [of[row["name"]]]
            for kind, names in links.items():
                links[kind] = present_names(names, renamed)
            row["links"] = json.dumps(links, ensure_ascii=False) if links else ""
        return rows

    def _found(self, search: str, equal: dict[str, str]) -> list[dict[str, Any]]:
        """The rows of `rows`, as the index has them."""
        with closing(self._opened()) as database:
            self._update(database)
            where, given = ["1"], list[str]()
            for column, text in equal.items():
                where.append(f"substr({column}, 1, ?) = ?")
                given += [str(len(text)), text]
            for word in search.split():
                where.append(
                    "instr(lower(" + " || ' ' || ".join(f"coalesce({c}, '')" for c in TEXTS) + "), ?)"
                )
                given.append(word.lower())
            # When a run began; of somebody's own file, when it was changed last.
            made = "coalesce(CAST(strftime('%s', nullif(begun, '')) AS REAL), changed)"
            chosen = (
                f"SELECT * FROM runs WHERE {' AND '.join(where)} ORDER BY {made} DESC, changed DESC, name"
            )
            return [dict(row) for row in database.execute(chosen, given)]

    def binned(self) -> list[str]:
        """Names of what is in the bin, the last one first."""
        root = self.folder / BIN
        moved = [path.parent for path in root.rglob("results.json")]
        moved += [p for p in root.rglob("*") if p.is_file() and not any(p.is_relative_to(m) for m in moved)]
        return [
            path.relative_to(root).as_posix()
            for path in sorted(moved, key=lambda one: one.stat().st_ctime_ns, reverse=True)
        ]

    def restore(self, name: str) -> str:
        """Take something out of the bin again; its name, which nothing else has.

        Raises:
            ValueError: there is no such thing in the bin, or another one has its place.
        """
        root = self.folder / BIN
        source = root / name
        if not source.resolve().is_relative_to(root.resolve()) or name not in self.binned():
            raise ValueError(f"{name!r} is not in the bin of {self.folder}")
        target = self.folder / name
        if target.exists():
            raise ValueError(f"{name!r} is there already: rename it, then restore the other")
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)
        return name

    def to_bin(self, name: str) -> Path:
        """Move a file, or a fit's folder, to the bin, `.bin` in the folder; where it is now.

        Raises:
            ValueError: there is no such run.
        """
        source = self.folder / name
        if not source.exists() or not source.resolve().is_relative_to(self.folder) or name.startswith("."):
            raise ValueError(f"{name!r} is no run of {self.folder}")
        return to_bin(self.folder, name)

    def _opened(self) -> sqlite3.Connection:
        path = self.folder / _FOLDER / "runs.sqlite"
        columns = ", ".join(f"{one} {_NUMBERS.get(one, 'TEXT')}" for one in COLUMNS)
        for place in (str(path), str(path), ":memory:"):
            try:
                if place != ":memory:":
                    path.parent.mkdir(exist_ok=True)
                database = sqlite3.connect(place, timeout=10.0)
                database.row_factory = sqlite3.Row
                if database.execute("PRAGMA user_version").fetchone()[0] != VERSION:
                    database.execute("DROP TABLE IF EXISTS runs")
                database.execute(f"CREATE TABLE IF NOT EXISTS runs ({columns}, PRIMARY KEY (name))")
                database.execute(f"PRAGMA user_version = {VERSION}")
                database.commit()
                return database
            except (sqlite3.DatabaseError, OSError):  # damaged, or a folder that cannot be written
                if path.is_file() and os.access(path, os.W_OK):
                    path.unlink()
        raise OSError(f"no index can be made of {self.folder}")

    def _update(self, database: sqlite3.Connection) -> None:
        """Read what is new or was changed, forget what is gone."""
        known = {
            row["name"]: (row["changed"], row["bytes"])
            for row in database.execute("SELECT name, changed, bytes FROM runs")
        }
        found = dict(self._files())
        gone = [(name,) for name in known.keys() - found.keys()]
        database.executemany("DELETE FROM runs WHERE name = ?", gone)
        for name, size in found.items():
            if known.get(name) == size:
                continue
            row = {"name": name, "changed": size[0], "bytes": size[1], **self._row(name)}
            values = [row.get(column, "") for column in COLUMNS]
            marks = ", ".join("?" * len(COLUMNS))
            database.execute(f"INSERT OR REPLACE INTO runs VALUES ({marks})", values)
            database.commit()
        database.commit()

    def _row(self, name: str) -> dict[str, Any]:
        path = self.folder / name
        kind = "fit" if path.is_dir() else "parameters" if path.suffix == ".toml" else "recording"
        try:
            if kind == "fit":
                return {"kind": kind, **described_fit(path)}
            if kind == "parameters":
                return {"kind": kind, **described_set(path)}
            return {"kind": kind, **self._read(path, described)}
        except (RecordingError, OSError, ValueError, LookupError, AttributeError, RecursionError) as error:
            said = str(error).removeprefix(f"{path}: ").replace(str(path), path.name)
            row: dict[str, Any] = {"kind": kind, "problem": " ".join(said.split())}
            return {**row, "bytes": 0} if isinstance(error, ReaderBusy) else row  # which is tried again

    def _files(self) -> Iterator[tuple[str, tuple[float, int]]]:
        """Names of recordings and of folders of fits, with time of change and size."""
        for folder, folders, names in os.walk(self.folder):
            store = "zarr.json" in names  # of a study, whose chunks are no recordings
            folders[:] = [] if store else sorted(one for one in folders if not one.startswith("."))
            if "results.json" in names and "report.html" in names and "experiment.log" not in names:
                files = [path for one in ("results.json", *NOTES) if (path := Path(folder, one)).is_file()]
                parts = [path.stat() for path in files]
                if Path(folder) != self.folder and Path(folder, "results.json") in files:
                    size = max(one.st_mtime for one in parts), sum(one.st_size for one in parts)
                    yield Path(folder).relative_to(self.folder).as_posix(), size
            for name in names:  # as texts: it is asked again and again, of thousands of them
                path, suffix = os.path.join(folder, name), os.path.splitext(name)[1]
                own = suffix == ".toml" and folder == os.path.join(self.folder, SETS)
                if (not own and suffix.lower() not in RECORDINGS) or name.startswith("."):
                    continue
                with suppress(OSError):
                    one = os.lstat(path)
                    if stat.S_ISLNK(one.st_mode):
                        if not Path(path).resolve().is_relative_to(self.folder):
                            continue
                        one = os.stat(path)
                    if stat.S_ISREG(one.st_mode):
                        inside = path[len(os.path.join(self.folder, "")) :].replace(os.sep, "/")
                        yield inside, (one.st_mtime, one.st_size)
