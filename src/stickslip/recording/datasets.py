"""Download of published data sets, measured by other groups, for examples and tests.

The data are not part of this package. They are taken unchecked from a local folder if there is one, otherwise
from their authors' repositories, at a fixed commit and checked by SHA-256.
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from . import RecordingError

ENVIRONMENT = "STICKSLIP_DATASETS"
_FILE = Path(__file__).with_name("datasets.toml")
_BESIDE_CHECKOUT = Path(__file__).resolve().parents[3].parent / "shared" / "datasets"


class Dataset(NamedTuple):
    """One published data set.

    Fields: `url`, address of the folder with its files at a fixed commit; `licence`; `credit`, its authors;
    `files`, the SHA-256 checksum of each file by its path below `url`.
    """

    url: str
    licence: str
    credit: str
    files: Mapping[str, str]


DATASETS = {name: Dataset(**entry) for name, entry in tomllib.loads(_FILE.read_text("utf-8")).items()}


def dataset_path(name: str, file: str) -> Path:
    """Return the path of a file of a published data set, after downloading it if necessary.

    The function first searches the folder in the environment variable STICKSLIP_DATASETS, then
    ``../shared/datasets`` beside a checkout of this project, then the user's cache. Missing files are
    downloaded to the cache from the authors' repository (by pooch, extra "data").

    Args:
        name: name of the data set, a key of `DATASETS`.
        file: name of one of its files, without folder.

    Raises:
        RecordingError: there is no such data set or file, or it is not on this computer and cannot be
            downloaded.
    """
    if name not in DATASETS:
        raise RecordingError(f"there is no data set {name!r}; there are {', '.join(DATASETS)}")
    dataset = DATASETS[name]
    paths = {path.rsplit("/", 1)[-1]: path for path in dataset.files}
    if file not in paths:
        raise RecordingError(f"the data set {name} has no file {file!r}; it has {', '.join(paths)}")
    own = os.environ.get(ENVIRONMENT)
    folders = [Path(own)] if own else []
    folders += [_BESIDE_CHECKOUT] if _BESIDE_CHECKOUT.is_dir() else []
    for folder in folders:
        if (folder / name / file).is_file():
            return folder / name / file
    try:
        return fetch(f"{dataset.url}/{paths[file]}", dataset.files[paths[file]], name)
    except RecordingError as error:
        looked = " or ".join(str(folder / name) for folder in folders) or "this installation"
        raise RecordingError(
            f"{file} is not in {looked}, and {error}; {ENVIRONMENT} can name a folder"
        ) from error


def fetch(url: str, sha256: str, name: str) -> Path:
    """Return the path, in the user's cache, of the file at `url`, which is downloaded the first time; `name`
    is the data set's folder in the cache, `sha256` the file's checksum.

    Raises:
        RecordingError: pooch is not installed, the address cannot be reached, or the checksum differs.
    """
    try:
        # pooch is an optional dependency, because only examples and tests download data.
        import pooch
    except ImportError as error:
        raise RecordingError("fetching it needs pooch: pip install 'stickslip[data]'") from error
    cache, outer = Path(pooch.os_cache("stickslip")) / name, sys.exception()
    try:
        return Path(pooch.retrieve(url, f"sha256:{sha256}", fname=url.rsplit("/", 1)[1], path=cache))
    # Errors of requests, which pooch uses, are OSErrors; a wrong checksum is a ValueError.
    except (OSError, ValueError) as error:
        raise RecordingError(f"it cannot be fetched from {url}: {_first(error, outer)}") from error


def _first(error: BaseException, outer: BaseException | None) -> str:
    """Return the message of the first exception in the chain that led to `error`, such as "Name or service
    not known". The exception `outer`, which was active before, and earlier ones are not considered."""
    while error.__context__ is not None and error.__context__ is not outer:
        error = error.__context__
    return str(error)
