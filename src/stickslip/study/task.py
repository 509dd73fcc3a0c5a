"""Computation of one task of a study (some of its members), and the data that a worker needs for it."""

from __future__ import annotations

import pickle
import time
from collections.abc import Sequence
from typing import NamedTuple

from .._version import __version__
from .description import described, identity
from .design import Study
from .errors import StudyError
from .own import OwnFunction, files_of, law_files, put_in_use
from .store import Store


class Done(NamedTuple):
    """Report of a finished task: its number, computing time [s], numbers of members and of failed members.

    A failed member has a status other than 0 (complete). From a cluster, the time counts from the sending of
    the task, and the number of failed members is always 0.
    """

    number: int
    seconds: float
    members: int
    failed: int


class Load(NamedTuple):
    """Data given to a worker once, before its first task.

    Fields: `study`, a pickled `Study`; `files`, path and content of the user's files that the study needs;
    `store`, the path of the store; `version` of the package and `identity` (hash) of the study, which must be
    the same on the worker; `folders`, the worker's search path for Python modules, empty to keep its own.
    """

    study: bytes
    files: list[tuple[str, bytes]]
    store: str
    version: str
    identity: str
    folders: Sequence[str]


def load_of(study: Study, store: Store, folders: Sequence[str] = ()) -> Load:
    """Return the data for a worker, which `received` reads there.

    Args:
        study: the study.
        store: store of the study.
        folders: search path of Python modules for workers on this machine; empty for other machines.

    Raises:
        StudyError: the study cannot be pickled, or contains something that is defined in the main script.
    """
    functions = [study.summary, getattr(study.measure, "function", None)]
    own = [one.path for one in functions if isinstance(one, OwnFunction)]
    files = files_of([*own, *law_files(getattr(study.measure, "model", None))])
    try:
        pickled = pickle.dumps(study)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise StudyError(f"the study cannot be sent to a worker: {error}") from None
    if b"__main__" in pickled:
        raise StudyError(
            "the study has something of the script itself, which a worker cannot import: put it into a file "
            "of its own, and use_file"
        )
    return Load(pickled, files, str(store.path.absolute()), __version__, store.identity, folders)


def received(load: Load) -> tuple[Study, Store]:
    """Return the study and its store on a worker, after the user's files are imported (run) there.

    Raises:
        StudyError: the worker has another version of the package, or does not see the study's store, or sees
            another or a damaged store.
        StudyDiffers: the worker has another friction law, function or compiled engine than the study.
        RegistryError: a user's file cannot be imported.
    """
    if load.version != __version__:
        raise StudyError(f"the worker has stickslip {__version__}, the study {load.version}")
    put_in_use(load.files)
    study, store = pickle.loads(load.study), Store(load.store)
    here = identity(described(study))
    if store.identity != load.identity:
        raise StudyError(f"the worker sees another study in {store.path}")
    if here != load.identity:
        store.check(described(study))
    return study, store


def run_task(study: Study, store: Store, number: int) -> Done:
    """Compute the members of a task, and write their results into the store.

    Args:
        study: the study.
        store: store of the study.
        number: number of the task, from 0; each task is a block of members.

    Returns:
        A report of the finished task.

    Raises:
        StudyError: the disk is full, or the texts of the task are too large for the store.
        QuantityError: the results do not have the names that the study states, see `Study.computed`.
        OSError: a file cannot be written.
    """
    begun, place = time.perf_counter(), store.layout.place(number)
    found = study.computed(study.columns(place))
    varied = {
        name: values
        for axis in study.axes
        if axis.drawn is not None
        for name, values in zip(axis.names, axis.at(place[axis.dim].start, place[axis.dim].stop), strict=True)
    }
    store.write(number, found, varied)
    failed = int((found["status"].values != 0).sum())
    return Done(number, time.perf_counter() - begun, found.sizes["member"], failed)
