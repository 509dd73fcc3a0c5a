"""Seals of a store: checksums that detect files which are undamaged but in a wrong place.

A chunk's own checksum shows that the chunk is undamaged, not that it belongs to this task, variable and
study. The seal of a task lists the checksums of its chunks by the names of their variables; it starts with a
hash of this list, the number of the task and the key of the study. The seal of the store is the hash of its
`zarr.json`, which contains the hashes of all other metadata. Seals detect damage and mistakes, not
manipulation: they are no signature, and anyone can compute them.
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
    """Return the key of a study: the hash of its identity (see `identity`) and its layout as JSON text."""
    return _hash(f"{identity}\n{layout}".encode())


def task_seal(key: str, number: int, checks: Mapping[str, int]) -> bytes:
    """Return the seal of a task.

    Args:
        key: key of the study, see `key_of`.
        number: number of the task.
        checks: CRC-32C of the content of the task's chunks, by name of the variable.
    """
    listed = " ".join(f"{name}={check:08x}" for name, check in checks.items())
    return f"{_hash(f'{key} {number} {listed}'.encode())} {listed}".encode()


def checks_of(seal: bytes, key: str, number: int) -> dict[str, int]:
    """Return the CRC-32C of each chunk that a task's seal lists, by name of the variable.

    Raises ChunkError if the seal is damaged, or belongs to another task or study.
    """
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
    """Return the SHA-256 hash of a metadata or coordinate file of a store.

    `name` is the path of the file, relative to the store. Raises ChunkError if it cannot be read.
    """
    most = MOST_METADATA_BYTES if name.endswith("zarr.json") else MOST_COORDINATE_BYTES
    with plain_file(store, name, most) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def store_seal(group: Mapping[str, Any]) -> str:
    """Return the seal of a store, computed from the content of its zarr.json without a seal in it."""
    attributes = {name: one for name, one in group["attributes"].items() if name != SEAL}
    text = json.dumps({**group, "attributes": attributes}, sort_keys=True)
    return _hash(text.encode())


def sealed(group: Mapping[str, Any]) -> str:
    """Return the text of a zarr.json, given its content, with the seal of the store added."""
    attributes = {**group["attributes"], SEAL: store_seal(group)}
    return json.dumps({**group, "attributes": attributes}, indent=2)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
