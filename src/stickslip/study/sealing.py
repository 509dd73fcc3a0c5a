"""Seals of a store: a checksum of what belongs together, so that a whole part in a wrong place is noticed.

A chunk's own checksum says that the chunk is as it was written, not that it belongs where it is. The seal of
a task lists the checksums of its chunks by the names of their variables, under a hash with the number of the
task and the key of the study. The seal of the store is the hash of its `zarr.json`, which has the hashes of
all other metadata. Seals find damage and mistakes; they are no signature: who wants to can make new ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .chunks import MOST_COORDINATE_BYTES, MOST_METADATA_BYTES, ChunkError, plain_file

SEAL = "checksum"  # attribute of the group that holds the seal of the store


def key_of(identity: str, layout: str) -> str:
    """Return the key of a study: the hash of its identity and its layout."""
    return _hash(f"{identity}\n{layout}".encode())


def task_seal(key: str, number: int, checks: Mapping[str, int]) -> bytes:
    """Return the seal of a task from the checksums of its chunks."""
    listed = " ".join(f"{name}={check:08x}" for name, check in checks.items())
    return f"{_hash(f'{key} {number} {listed}'.encode())} {listed}".encode()


def checks_of(seal: bytes, key: str, number: int) -> dict[str, int]:
    """Return the checksums that the seal of a task lists; raises ChunkError for that of another task."""
    try:
        _, *listed = seal.decode().split(" ")
        pairs = (one.split("=") for one in listed)
        found = {name: int(check, 16) for name, check in pairs}
    except ValueError:
        raise ChunkError("has no seal") from None
    if task_seal(key, number, found) != seal:
        raise ChunkError("is of another task or study")
    return found


def file_hash(store: Path, name: str) -> str:
    """Return the hash of a file of metadata or coordinates of a store; raises ChunkError."""
    most = MOST_METADATA_BYTES if name.endswith("zarr.json") else MOST_COORDINATE_BYTES
    with plain_file(store, name, most) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def store_seal(group: Mapping[str, Any]) -> str:
    """Return the seal of a store from the content of its zarr.json, which may have one already."""
    attributes = {name: one for name, one in group["attributes"].items() if name != SEAL}
    text = json.dumps({**group, "attributes": attributes}, sort_keys=True)
    return _hash(text.encode())


def sealed(group: Mapping[str, Any]) -> str:
    """Return the text of a zarr.json with its seal."""
    attributes = {**group["attributes"], SEAL: store_seal(group)}
    return json.dumps({**group, "attributes": attributes}, indent=2)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
