"""Stored answers to the cases: trajectories, neighbours and orbits.

They were computed once by the package's former engine, which did the same method in other code (Python), and
are compared with those of the engine in C number by number: steps that were accepted and rejected, positions
to rounding. After an intended change of the
method, ``PYTHONPATH=src:tests python -m engine.stored`` stores the answers of the engine in C.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

FILE = Path(__file__).with_name("stored.json")
EVERY = 7  # of so many samples one is stored
DIGITS = 13  # significant ones: positions of 1e-4 m to 1e-17 m

Answers = dict[str, dict[str, np.ndarray]]


def stored(kind: str) -> Answers:
    """Return the stored answers of one kind by the names of their cases."""
    return {
        name: {key: np.array(value, float) for key, value in answer.items()}
        for name, answer in json.loads(FILE.read_text("utf-8"))[kind].items()
    }


def _plain(value: Any) -> Any:
    value = np.asarray(value, float).tolist()
    return json.loads(json.dumps(value), parse_float=lambda text: float(f"{float(text):.{DIGITS}g}"))


def store(answers: dict[str, Answers]) -> None:
    """Write the answers of all kinds."""
    kinds = []
    for kind, of_kind in answers.items():
        rows = [
            f"{json.dumps(name)}: " + json.dumps({key: _plain(value) for key, value in answer.items()})
            for name, answer in of_kind.items()
        ]
        kinds.append(f"{json.dumps(kind)}: {{\n" + ",\n".join(rows) + "\n}")
    FILE.write_text("{\n" + ",\n".join(kinds) + "\n}\n", "utf-8")


def main() -> None:
    """Store the answers of the engine in C."""
    from engine import test_near, test_orbits, test_trajectories

    store(
        {
            "trajectories": {name: test_trajectories.answered(name) for name in test_trajectories.CASES},
            "neighbours": {test_near.title(*key): test_near.answered(*key) for key in test_near.ALL},
            "orbits": {test_orbits.title(*key): test_orbits.answered(*key) for key in test_orbits.ALL},
        }
    )


if __name__ == "__main__":
    main()
