"""Random damage to JSON: values of other types, keys gone, parts nested, repeated or cut."""

from __future__ import annotations

import copy
import random
from typing import Any

STRANGE = (
    None, True, 0, -1, 5, 1e308, 1e-320, "", "x", "nan", "../../etc/passwd", "é" * 50, [], {}, [[]], [1, "a"],
    {"type": "array"}, {"type": "float", "text": "nan"}, {"type": "float", "text": "x"}, {"type": "Fit"},
    {"type": "mapping", "items": [[[], 1]]}, {"type": "dataset", "coords": [], "data": []},
    {"type": "array", "dtype": "U1000000000", "rows": ["a"]}, {"type": "array", "dtype": "O", "rows": [1]},
    {"type": "array", "dtype": "float64", "rows": [[1], [1, 2]]},
    {"type": "method", "owner": "a", "name": "__class__"}, {"type": "method", "owner": [1], "name": "index"},
)  # fmt: skip


def mutated(content: Any, draw: random.Random) -> Any:
    """Return a copy of JSON content with one to three random changes."""
    made = copy.deepcopy(content)
    for _ in range(draw.randint(1, 3)):
        places = list(_places(made))
        if not places:
            return copy.deepcopy(draw.choice(STRANGE))
        # The deep ones are many: a place high up is as likely.
        deepest = max(depth for depth, *_ in places)
        depth = draw.randint(0, deepest)
        _, owner, key = draw.choice([one for one in places if one[0] == depth] or places)
        _change(owner, key, draw)
    return made


def _change(owner: Any, key: Any, draw: random.Random) -> None:
    act = draw.randrange(6)
    if act == 0:
        del owner[key]
    elif act == 1:
        owner[key] = [owner[key]]
    elif act == 2:
        owner[key] = {"type": owner[key]} if draw.random() < 0.5 else {"value": owner[key]}
    elif act == 3 and isinstance(owner, dict):
        owner[draw.choice(["type", "value", "x", str(key).upper()])] = owner.pop(key)
    elif act == 4 and isinstance(owner[key], list) and owner[key]:
        owner[key] = owner[key][: draw.randint(0, len(owner[key]) - 1)]
    else:
        owner[key] = copy.deepcopy(draw.choice(STRANGE))


def _places(content: Any, depth: int = 0) -> Any:
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in list(pairs)[:40]:
        yield depth, content, key
        if isinstance(value, dict | list):
            yield from _places(value, depth + 1)
