"""File of raw samples that is written during a run, so that nothing is lost if a program dies.

The file lies beside the future recording. Before the output starts, it is given its full size, including room
for the recording itself. A full disk thus prevents the run instead of losing its samples.

A run has a random identity. It is part of the file's name and, as the attribute `run_id`, of the recording
made from the file. Programs that write the file share its lock until they end in any way. The samples of an
active run are therefore never taken for those of a killed one. After a killed run the file is removed only if
a recording with its identity exists, or if its finite readings give fewer than two recorded samples.

    bytes 0-7     number of samples in the file, unsigned, little-endian
    bytes 8-15    length of the description, bytes
    then          the description, JSON (see `recorded.Making`)
    then          float64, little-endian, sample by sample: all inputs of the first sample, of the second, ...
"""

from __future__ import annotations

import os
import re
import secrets
import struct
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from ..gate.files import opened
from ..recording import open_recording, save_recording
from .lock import POLL, taken
from .protocols import Array
from .recorded import Making

if TYPE_CHECKING:
    import xarray as xr

SAMPLES = ".samples"  # ending of the names of these files
_HEAD = struct.Struct("<QQ")
_OVERHEAD = 200_000  # bytes reserved for a recording's file in addition to its values
KILLED = "the program was killed"


class Samples:
    """File of raw samples of one run, as a context manager.

    The file is removed at the end of the context, unless saving its recording failed. `path` is its path, and
    `run_id` the random identity of the run.

    Args:
        target: path of the future recording, NAME.nc.
        making: settings with which the samples become the recording; stored in the file.
        samples: number of samples of the run, for which disk space is reserved.

    Raises:
        OSError: the folder cannot be written, or the disk has no room for samples and recording; names the
            target.
    """

    def __init__(self, target: Path, making: Making, samples: int) -> None:
        self.run_id = secrets.token_hex(8)
        self.path = target.with_name(f".{target.stem}.{self.run_id}{SAMPLES}")
        # True from the start of saving the recording until it has succeeded: the file must not be removed.
        self._left = False
        self._width = len(making.inputs)
        text = making.to_text().encode()
        self._begin = _HEAD.size + len(text)
        self._raw = self._begin + 8 * samples * self._width
        recorded = 8 * making.capture.samples * (len(making.channels) + 1) + _OVERHEAD
        self._count = 0
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644)
            try:
                taken(self._file, shared=True)
                _reserve(self._file, self._raw + recorded)
                os.pwrite(self._file, _HEAD.pack(0, len(text)) + text, 0)
            except OSError:
                self.close()
                raise
        except OSError as error:
            raise OSError(
                error.errno,
                f"no room for {(self._raw + recorded) / 1e6:.3g} MB: {error.strerror}",
                str(target),
            ) from error

    def __enter__(self) -> Samples:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def restart(self) -> None:
        """Discard the samples so far, because another run of the same recording (an average of runs)
        follows."""
        self._count = 0
        os.pwrite(self._file, struct.pack("<Q", 0), 0)

    def add(self, block: Array) -> None:
        """Append the next raw samples [inputs, n] to the file, and count them in its head."""
        at = self._begin + 8 * self._count * self._width
        os.pwrite(self._file, np.ascontiguousarray(block.T, dtype="<f8").tobytes(), at)
        self._count += block.shape[1]
        os.pwrite(self._file, struct.pack("<Q", self._count), 0)

    def become(self, recording: xr.Dataset, target: Path, unfinished: bool = False) -> Path:
        """Save the recording made from the samples, in the space reserved for it; return the path.

        If saving fails, the file of samples stays, as after a killed program.

        Args:
            recording: the recording, which also gets the attribute `run_id`.
            target: path of the recording, NAME.nc.
            unfinished: True to save it as unfinished/NAME.nc beside the target.

        Raises:
            RecordingError, OSError: as `save_recording`.
        """
        recording.attrs["run_id"] = self.run_id
        self._left = True
        os.ftruncate(self._file, self._begin + 8 * self._count * self._width)
        saved = save_recording(recording, unfinished_path(target) if unfinished else target)
        self._left = False
        return saved

    def close(self) -> None:
        """Remove the file, unless saving its recording failed."""
        if not self._left:
            self.path.unlink(missing_ok=True)
        os.close(self._file)


def _reserve(file: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.truncate(file, size)


def shared(path: Path) -> BinaryIO | None:
    """Open the file of samples of an active run and share its lock; None if the file cannot be opened.

    While the returned file is open, no program treats the run as killed.
    """
    with suppress(OSError):
        file = path.open("rb")
        taken(file.fileno(), shared=True)
        return file
    return None


def complete(path: Path, before: int, values: Array) -> None:
    """Append samples that a killed program has not stored to its file of samples.

    Args:
        path: file of samples.
        before: index of the first sample in `values`; samples that the file has already are left out.
        values: raw samples [inputs, n].

    Raises:
        OSError: the file is gone, because its program saved the recording; or its description was never
            written.
    """
    with path.open("r+b") as file:
        count, length = _head(file)
        if length == 0:
            raise OSError(f"{path} was begun, and no more")
        new = values[:, max(count - before, 0) :]
        file.seek(_HEAD.size + length + 8 * count * values.shape[0])
        file.write(np.ascontiguousarray(new.T, dtype="<f8").tobytes())
        file.seek(0)
        file.write(struct.pack("<Q", count + new.shape[1]))


def recover(folder: Path, most: float = 2.0) -> list[Path]:
    """Make recordings of the samples that killed programs left in a folder; return the recordings' paths.

    The recordings are saved in unfinished/ of the folder, and the files of samples are removed. A file whose
    finite readings give fewer than two recorded samples, or whose recording exists already, is only removed.
    Unreadable files stay, and so do files that are still in use after `most` seconds. The wait is for the
    rig's process, which still ramps to 0 V after the death of the program that it records for. Errors are not
    raised.
    """
    end = time.monotonic() + most
    made = []
    for path in sorted(folder.glob(f".*{SAMPLES}")):
        name, run_id = path.name[1:].removesuffix(SAMPLES).rpartition(".")[::2]
        if not name or path.is_symlink() or not path.is_file():
            continue
        # An error with one file must not keep the other files from being recovered.
        with suppress(Exception), path.open("rb") as file:
            while not (alone := taken(file.fileno())) and time.monotonic() < end:
                time.sleep(POLL)
            if not alone or not path.exists():
                continue  # a program still uses the file, or another program has just recovered it
            target = folder / f"{name}.nc"
            recording = None if _is_saved(target, run_id) else _read(path)
            if recording is not None:
                recording.attrs["run_id"] = run_id
                made.append(save_recording(recording, unfinished_path(target)))
            path.unlink()
    return made


def _is_saved(target: Path, run_id: str) -> bool:
    """Return True if `target`, or one of its files in unfinished/ beside it, is the recording of this run.

    `run_id` is the identity of the run, which recordings have as an attribute.
    """
    own = re.compile(re.escape(target.stem) + r"(-\d+)?\.nc")
    others = [one for one in target.parent.glob("unfinished/*.nc") if own.fullmatch(one.name)]
    for one in (target, *others):
        with suppress(Exception), open_recording(one) as recording:
            if recording.attrs.get("run_id") == run_id:
                return True
    return False


def unfinished_path(target: Path) -> Path:
    """Return a path for an unfinished NAME.nc at which no file exists: unfinished/NAME.nc or NAME-2.nc, ...

    The folder unfinished/ is created beside NAME.nc if it is missing.
    """
    folder = target.parent / "unfinished"
    folder.mkdir(exist_ok=True)
    number, path = 1, folder / target.name
    while path.exists():
        number += 1
        path = folder / f"{target.stem}-{number}.nc"
    return path


def _head(file: BinaryIO) -> tuple[int, int]:
    """Return the head of a file of samples: number of samples, and length of the description in bytes.

    A length of 0 means that the description was never written, also if the file is shorter than a head.
    """
    head = file.read(_HEAD.size)
    return _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)


def _read(path: Path) -> xr.Dataset | None:
    with opened(path) as file:
        count, length = _head(file)
        if length == 0:
            return None
        if length + 8 * count > os.fstat(file.fileno()).st_size:
            raise ValueError("damaged")
        making = Making.from_text(file.read(length).decode())
        width = len(making.inputs)
        raw = np.frombuffer(file.read(8 * count * width), dtype="<f8").reshape(-1, width).T
    return making.unfinished(np.array(raw), KILLED)
