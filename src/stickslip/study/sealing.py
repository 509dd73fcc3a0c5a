"""Seals of a store: checksums that detect files which are undamaged but in a wrong place.

A chunk's own checksum shows that the chunk is undamaged, not that it belongs to this task, variable and
study. The seal of a task is a text: first a hash of the study's key, the task's number and the list that
follows; then this list, the checksum (CRC-32C) of each chunk of the task by the name of its variable. The
seal of the store is the hash of its `zarr.json` without the seal; that file contains the hashes of all other
metadata and of the coordinates. Seals detect damage and mistakes, not manipulation: they are no signature,
and anyone can compute them. All hashes are SHA-256 in hexadecimal digits.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .chunks import MOST_COORDINATE_BYTES, MOST_METADATA_BYTES, ChunkError, plain_file

SEAL = "checksum"  # name of the Zarr group's attribute that contains the seal of the store


def key_of(identity: str, layout: str) -> str:
    """Return the key of a study, from which the seals of its tasks are computed: a SHA-256 hash.

    Args:
        identity: hash of the study's description, from `description.identity`.
        layout: layout of the results as JSON text, from `layout_text`.
    """
    return _hash(f"{identity}\n{layout}".encode())


def task_seal(key: str, number: int, checks: Mapping[str, int]) -> bytes:
    """Return the seal of a task, a text in bytes: "HASH NAME=CRC NAME=CRC ...".

    HASH is the SHA-256 of key, number and list; each CRC has 8 hexadecimal digits.

    Args:
        key: key of the study, see `key_of`.
        number: number of the task.
        checks: CRC-32C of the content of each chunk of the task, by name of the variable.
    """
    listed = " ".join(f"{name}={check:08x}" for name, check in checks.items())
    return f"{_hash(f'{key} {number} {listed}'.encode())} {listed}".encode()


def checks_of(seal: bytes, key: str, number: int) -> dict[str, int]:
    """Check a task's seal; return the CRC-32C of each chunk that the seal lists, by name of the variable.

    Args:
        seal: seal that was read, see `task_seal`.
        key: key of the study to which the seal must belong.
        number: number of the task to which the seal must belong.

    Raises:
        ChunkError: the seal is damaged, or belongs to another task or study.
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
    """Return the SHA-256 hash of a metadata or coordinate file of a store, in hexadecimal digits.

    Args:
        store: folder of the store.
        name: path of the file, relative to the store; the largest allowed size depends on the ending
            "zarr.json".

    Raises:
        ChunkError: the file is missing, too large or not readable, or lies outside the store.
    """
    most = MOST_METADATA_BYTES if name.endswith("zarr.json") else MOST_COORDINATE_BYTES
    with plain_file(store, name, most) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def store_seal(group: Mapping[str, Any]) -> str:
    """Return the seal of a store: the SHA-256 hash of its zarr.json without the attribute `SEAL`.

    `group` is the decoded content of zarr.json, with or without a seal.
    """
    attributes = {name: one for name, one in group["attributes"].items() if name != SEAL}
    text = json.dumps({**group, "attributes": attributes}, sort_keys=True)
    return _hash(text.encode())


def sealed(group: Mapping[str, Any]) -> str:
    """Return the text of a zarr.json with the seal of the store; `group` is its decoded content."""
    attributes = {**group["attributes"], SEAL: store_seal(group)}
    return json.dumps({**group, "attributes": attributes}, indent=2)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
