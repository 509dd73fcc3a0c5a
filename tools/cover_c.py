"""Lines of the engine's C that its tests run, counted by gcov.

    python tools/cover_c.py [--least PERCENT]

The engine is built with counters in a copy of the package, and its tests run with that. Printed are the share
of each file and the lines that never ran; the exit status is 1 below the least share of all.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import mutate_c

ROOT = Path(__file__).resolve().parents[1]
MOVES = ("control/test_moves_stored.py", "control/test_arrival.py")
TESTS = ("engine", "simulation", "physics/piezo", "physics/electronics/test_charging.py", *MOVES)
COUNTED = ("--coverage", "-fprofile-update=atomic")


def counts(objects: Path) -> dict[str, dict[int, int]]:
    """How often each line of each file ran, in all places that it is compiled into."""
    found: dict[str, dict[int, int]] = defaultdict(lambda: defaultdict(int))
    data = sorted(map(str, objects.glob("*.gcda")))
    subprocess.run(["gcov", "--json-format", *data], cwd=objects, check=True, stdout=subprocess.DEVNULL)
    for archive in objects.glob("*.gcov.json.gz"):
        for file in json.loads(gzip.decompress(archive.read_bytes()))["files"]:
            name = Path(file["file"])
            if name.parent.name == "c" and name.parent.parent.name == "engine":
                for line in file["lines"]:
                    found[name.name][line["line_number"]] += line["count"]
    return found


def main() -> None:
    """Build, run, count, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--least", type=float, default=95.0, help="share of all lines, %%")
    least = parser.parse_args().least
    with tempfile.TemporaryDirectory() as name:
        source, objects = Path(name) / "src", Path(name) / "objects"
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("__pycache__"))
        engine = source / "stickslip" / "engine"
        mutate_c.objects(engine / "c", objects, *COUNTED)
        mutate_c.link(engine, sorted(objects.glob("*.o")), *COUNTED)
        tests = [str(ROOT / "tests" / one) for one in TESTS]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        ended = subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(source)}, check=False)
        found = counts(objects)
    ran = {file: sum(map(bool, lines.values())) for file, lines in found.items()}
    for file in sorted(found, key=lambda one: ran[one] / len(found[one])):
        never = " ".join(str(line) for line, count in sorted(found[file].items()) if not count)
        print(f"{100 * ran[file] / len(found[file]):6.1f} %  {file}  {never}")
    whole = 100 * sum(ran.values()) / sum(map(len, found.values()))
    print(f"{whole:6.1f} %  all {sum(map(len, found.values()))} lines")
    sys.exit(ended.returncode or whole < least)


if __name__ == "__main__":
    main()
