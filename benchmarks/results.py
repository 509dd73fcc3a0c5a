"""The file of results: for each part when, where and with what it ran, and its rows."""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def machine() -> str:
    """Processor, cores, memory, system, Python."""
    info, memory = Path("/proc/cpuinfo"), Path("/proc/meminfo")
    model = platform.processor() or platform.machine()
    if info.exists():
        names = [
            line.partition(":")[2].strip() for line in info.read_text().splitlines() if "model name" in line
        ]
        model = names[0] if names else model
    size = ""
    if memory.exists():
        size = f", {int(memory.read_text().split()[1]) / 2**20:.0f} GiB"
    system = f"{platform.system()} {platform.release().split('-')[0]}"
    return f"{model}, {os.cpu_count()} cores{size}, {system}, Python {platform.python_version()}"


def commit() -> str:
    """Return the short name of the commit, with "+" if files differ from it; "" outside a repository."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+", "--exclude=*"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def made() -> str:
    """Return the line of a page that states when, where and at which commit its numbers were made."""
    return provenance(f"{datetime.now(UTC):%Y-%m-%d}", machine(), commit())


def provenance(day: str, where: str, at: str, *more: str) -> str:
    """Return the small line below numbers: the day, the machine (processor and cores, the first two parts of
    `where`), the commit ("" if it is not known), and `more`."""
    parts = [day, *where.split(", ")[:2], *([f"commit {at}"] if at else []), *more]
    return f"<sub>{', '.join(parts)}.</sub>"


_PART = re.compile(r"^<!-- (?!end )(\w+) -->\n(.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)


def filled(page: str, parts: Mapping[str, str], file: Path) -> str:
    """Return a page with its measured parts replaced, see `write_page`; `file` is named in an error."""
    there = {name for name, _ in _PART.findall(page)}
    if there != set(parts):
        raise ValueError(f"{file}: the page has the parts {sorted(there)}, measured are {sorted(parts)}")
    return _PART.sub(lambda m: f"<!-- {m[1]} -->\n\n{parts[m[1]].strip()}\n\n<!-- end -->", page)


def write_page(file: Path, parts: Mapping[str, str], source: Path | None = None) -> str:
    """Put the measured parts of a page in the place of the former ones; return the page.

    The words of a page stand only in the page. A measured part stands there between the lines
    ``<!-- NAME -->`` and ``<!-- end -->``. The last line states date, machine and commit.

    Args:
        file: file to write.
        parts: Markdown of each measured part, by name.
        source: page with the words; by default `file` itself.

    Raises:
        ValueError: the page has other parts.
    """
    text = filled((source or file).read_text(encoding="utf-8"), parts, file)
    text = re.sub(r"\n<sub>[^\n]*</sub>\s*\Z", "", text).rstrip() + f"\n\n{made()}\n"
    file.write_text(text, encoding="utf-8")
    return text


def load(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text()) if file.exists() else {}


def record(file: Path, part: str, rows: list[Row], versions: dict[str, str], seconds: float) -> None:
    """Put a part's rows in the place of those of its last run."""
    results = load(file)
    results[part] = {
        "made": datetime.now(UTC).isoformat(timespec="minutes"),
        "machine": machine(),
        "commit": commit(),
        "load_average": os.getloadavg()[0],
        "took_s": round(seconds, 1),
        "versions": versions,
        "rows": [_rounded(row) for row in rows],
    }
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n")


def _rounded(row: Row) -> Row:
    return {name: float(f"{v:.5g}") if isinstance(v, float) else v for name, v in row.items()}


if __name__ == "__main__":  # pages whose figures were all made again: python -m benchmarks.results PAGE ...
    for page in map(Path, sys.argv[1:]):
        write_page(page, {})
