"""Index of the runs in a folder: one SQLite table beside the files, which every query updates first. Runs are
moved to the bin, listed there and restored."""

from __future__ import annotations

import json
import math
import os
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from ..recording.readers.process import Reader, ReaderBusy
from ..recording.replacing import BIN, to_bin
from .acts import Renamed, read_acts
from .describing import described, described_fit, described_run, described_set
from .storable import real_name, shown_name, storable_row, storable_text
from .walking import LOGS, FoundRun, entries, is_run

VERSION = 5
COLUMNS = (
    "name", "kind", "changed", "bytes", "begun", "title", "notes", "tags", "operator", "rig", "parameter_set",
    "outcome", "seconds", "samples", "channels", "settings", "links", "problem",
)  # fmt: skip
_NUMBERS = {"changed": "REAL", "bytes": "INTEGER", "seconds": "REAL", "samples": "INTEGER"}
# Columns of the table that contain text; a search examines these.
TEXTS = tuple(column for column in COLUMNS if column not in _NUMBERS)
_FOLDER = ".stickslip"
# Longest time in which a request of the panel's page starts to read new files, s. The last file may then take
# `gate.process.STUCK` times the processor time allowed for its size.
READING = 20.0


class Index:
    """Index of the runs (recordings, fits, experiments, parameter sets) of a folder and its subfolders,
    except hidden files and folders.

    Args:
        folder: folder of the laboratory.
        read: process that reads files; by default a new one, which `close` ends.

    Raises:
        OSError: the folder is missing, or is a file. (If the folder cannot be written, the index is kept in
            memory.)
    """

    def __init__(self, folder: str | os.PathLike[str], read: Reader | None = None) -> None:
        self.folder = Path(folder).resolve()
        if not self.folder.is_dir():
            said = "is a file, not a folder" if self.folder.exists() else "there is no such folder"
            raise NotADirectoryError(20, f"{said}; name the folder of your recordings", str(folder))
        # Longest time in which a query starts to read new files, s. Files that remain are listed with the
        # problem that they are not read yet.
        self.patience = math.inf
        self._own = Reader() if read is None else None
        self._read: Reader = read or self._own  # type: ignore[assignment]

    def __enter__(self) -> Index:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process that reads files, unless the caller gave it."""
        if self._own is not None:
            self._own.close()

    def rebuild(self) -> None:
        """Delete the file of the table; the next query reads all runs again. The runs themselves stay."""
        (self.folder / _FOLDER / "runs.sqlite").unlink(missing_ok=True)

    def rows(self, search: str = "", **equal: str) -> list[dict[str, Any]]:
        """Return the rows of the index that match a search, the newest first, each as a dictionary of values
        by column (see `runs`), with `settings` and `links` as JSON texts or "". A run that was renamed after
        a link was made has its present name in the link. The link "prediction" comes from the log of actions.
        A damaged table is made again. Samples that killed programs left in the folder are first saved as
        recordings.

        Args:
            search: words that must all occur in the texts of a row; upper and lower case are the same.
            equal: for some columns, the text with which the column must start: ``outcome="stopped"``.

        Raises:
            ValueError: a column is unknown.
        """
        for column in equal:
            if column not in COLUMNS:
                raise ValueError(f"there is no column {column!r}; there are {', '.join(COLUMNS)}")
        try:
            rows, names = self._found(search, equal)
        except (sqlite3.DatabaseError, ValueError, RecursionError):
            # The file of the table is damaged.
            self.rebuild()
            rows, names = self._found(search, equal)
        acts = read_acts(self.folder)
        of = {one["name"]: str(one["of"]) for one in acts if "of" in one}
        renamed = Renamed(acts, names)
        for row in rows:
            made = row.pop("made")
            now = {kind: [renamed.present(one, made) for one in ones] for kind, ones in row["links"].items()}
            if row["name"] in of:
                now["prediction"] = [of[row["name"]]]
            row["links"] = json.dumps(now, ensure_ascii=False) if now else ""
        return rows

    def _found(self, search: str, equal: dict[str, str]) -> tuple[list[dict[str, Any]], set[str]]:
        """Update the table; return its rows that match, for `rows` with the same arguments, and the names of
        all runs. In a row `links` is a dictionary from kinds of links to lists of names, and `made` the start
        of the run or, for a user's own file, its last change, s since 1970."""
        with closing(self._opened()) as database:
            self._update(database)
            where, given = ["1"], list[str]()
            for column, text in equal.items():
                where.append(f"substr({column}, 1, ?) = ?")
                given += [str(len(text)), storable_text(text)]
            for word in search.split():
                where.append(
                    "instr(lower(" + " || ' ' || ".join(f"coalesce({c}, '')" for c in TEXTS) + "), ?)"
                )
                given.append(storable_text(word.lower()))
            made = "coalesce(CAST(strftime('%s', nullif(begun, '')) AS REAL), CAST(changed AS REAL))"
            chosen = (
                f"SELECT *, {made} AS made FROM runs WHERE {' AND '.join(where)} "
                "ORDER BY made DESC, changed DESC, name"
            )
            rows = [dict(row) for row in database.execute(chosen, given)]
            names = {name for (name,) in database.execute("SELECT name FROM runs")}
        return [{**row, "links": json.loads(row["links"] or "{}")} for row in rows], names

    def binned(self) -> list[str]:
        """Return the names (paths in the folder before the deletion) of the files and folders of fits in the
        bin, the last deleted first."""
        root = self.folder / BIN
        moved = [path.parent for path in root.rglob("results.json")]
        moved += [p for p in root.rglob("*") if p.is_file() and not any(p.is_relative_to(m) for m in moved)]
        return [
            shown_name(path.relative_to(root).as_posix())
            for path in sorted(moved, key=lambda one: one.lstat().st_ctime_ns, reverse=True)
        ]

    def restore(self, name: str) -> str:
        """Move a run from the bin back to its place in the folder, and return its name.

        Raises:
            ValueError: there is no such run in the bin, or another file has its place.
            OSError: the run cannot be moved.
        """
        root = self.folder / BIN
        if name not in self.binned():
            raise ValueError(f"{name!r} is not in the bin of {self.folder}")
        source, target = root / real_name(name), self.folder / real_name(name)
        if target.exists():
            raise ValueError(f"{name!r} is there already: rename it, then restore the other")
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)
        return name

    def to_bin(self, name: str) -> Path:
        """Move a run (a file, or a fit's folder) to the bin, the folder `.bin`, and return its new path.

        Raises:
            ValueError: the name is no run of the folder.
            OSError: the run cannot be moved.
        """
        source = self.folder / real_name(name)
        inside = source.parent.resolve().is_relative_to(self.folder) and source != self.folder
        if not inside or name.startswith(".") or not is_run(str(self.folder), str(source)):
            raise ValueError(f"{name!r} is no run of {self.folder}: only recordings, fits and sets are moved")
        return to_bin(self.folder, real_name(name))

    def _opened(self) -> sqlite3.Connection:
        path = self.folder / _FOLDER / "runs.sqlite"
        columns = ", ".join(f"{one} {_NUMBERS.get(one, 'TEXT')}" for one in COLUMNS)
        # A link could lead to another program's database, so the table is then kept in memory.
        own = not path.is_symlink() and not path.parent.is_symlink()
        for place in ((str(path), str(path)) if own else ()) + (":memory:",):
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
            except (sqlite3.DatabaseError, OSError):
                # A damaged file is deleted. In a read-only folder the table is kept in memory.
                if path.is_file() and os.access(path, os.W_OK):
                    path.unlink()
        raise OSError(f"no index can be made of {self.folder}")

    def _update(self, database: sqlite3.Connection) -> None:
        """Read new and changed files into the table, and remove the rows of missing ones.

        Files that were not read for lack of time or memory get a row with a problem. This row is not
        committed: it belongs only to the present query, and the next query tries the file again.
        """
        known = {
            row["name"]: (row["changed"], row["bytes"])
            for row in database.execute("SELECT name, changed, bytes FROM runs")
        }
        found = {self._name(entry): entry for entry in entries(str(self.folder))}
        gone = [(name,) for name in known.keys() - found.keys()]
        database.executemany("DELETE FROM runs WHERE name = ?", gone)
        database.commit()
        busy, until = [], time.monotonic() + self.patience
        for name, entry in found.items():
            if known.get(name) == (entry.changed, entry.bytes):
                continue
            try:
                if time.monotonic() > until:
                    raise ReaderBusy("not read yet, for there is much that is new: ask again")
                self._store(database, self._row(name, entry))
                database.commit()
            except ReaderBusy as error:
                busy.append(self._with_problem(name, entry, error))
        for row in busy:
            self._store(database, row)

    def _store(self, database: sqlite3.Connection, row: dict[str, Any]) -> None:
        values = [row.get(column, "") for column in COLUMNS]
        marks = ", ".join("?" * len(COLUMNS))
        database.execute(f"INSERT OR REPLACE INTO runs VALUES ({marks})", values)

    def _row(self, name: str, entry: FoundRun) -> dict[str, Any]:
        """Read a found run and return its row (values by column) in the form that the table stores.

        Any failure to read the run becomes the text in the row's column `problem`.

        Raises:
            ReaderBusy: the file was not read for lack of time or memory, and can be tried again.
        """
        path = Path(entry.path)
        try:
            if entry.problem:
                raise ValueError(entry.problem)
            if entry.kind == "fit":
                found = self._read.apply(described_fit, path / "results.json")
            elif entry.kind == "run":
                log = next(path / one for one in LOGS if (path / one).exists())
                found = self._read.apply(described_run, log)
            elif entry.kind == "parameters":
                found = self._read.apply(described_set, path)
            else:
                found = self._read(path, described)
            row = {"kind": entry.kind, **found, "name": name, "changed": entry.changed, "bytes": entry.bytes}
            if "\\" in name:
                row["problem"] = "its name has letters that cannot be shown: give it another name"
            return storable_row(row)
        except ReaderBusy:
            raise
        except Exception as error:
            return self._with_problem(name, entry, error)

    def _with_problem(self, name: str, entry: FoundRun, error: Exception) -> dict[str, Any]:
        """Return the row of a run that cannot be read, with only kind, time of change, size and name; its
        column `problem` is the message of the error, without the folder's path."""
        said = str(error) or type(error).__name__
        for path, shown in ((entry.path, name.rpartition("/")[2]), (f"{self.folder}{os.sep}", "")):
            said = said.removeprefix(f"{path}: ").replace(path, shown)
        row = entry._asdict() | {"name": name, "problem": " ".join(said.split())}
        del row["path"]
        return storable_row(row)

    def _name(self, entry: FoundRun) -> str:
        """Return the name of a run: its path relative to the folder, with unprintable characters escaped."""
        return shown_name(entry.path[len(os.path.join(self.folder, "")) :].replace(os.sep, "/"))
