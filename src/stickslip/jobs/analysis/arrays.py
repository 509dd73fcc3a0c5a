"""Files of a drive and of the response to it, as NumPy arrays, for an analysis of frequency responses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...gate.archives import read_npy
from ...gate.errors import GateError
from ...quantities.input_file import Strict
from ...recording.conversion import to_si_unit
from .file import AnalysisError, SourceFile


class Arrays(Strict):
    """Files of a periodic drive and of the response to it.

    Both are NumPy arrays of the shape (samples of a period, channels, realisations, periods).
    """

    drive: SourceFile
    response: SourceFile

    def in_si(self, folder: Path, units: tuple[str, str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return drive and response in SI; `units` are those of the files.

        Raises:
            AnalysisError: a file cannot be read, or contains an array of another shape.
        """
        drive, response = map(to_si_unit, units)
        return _array(self.drive, folder) * drive.factor, _array(self.response, folder) * response.factor


def _array(source: SourceFile, folder: Path) -> NDArray[np.float64]:
    path = source.path(folder)
    try:
        array = read_npy(path)
    except GateError as error:
        raise AnalysisError(f"{error}") from error
    if array.ndim != 4:
        raise AnalysisError(
            f"{path} has the shape {array.shape}, not (samples, channels, realisations, periods)"
        )
    return array


def check_test(name: str, test: tuple[NDArray[np.float64], ...], channels: tuple[int, int]) -> None:
    """Raise AnalysisError if `test`, the arrays of drive and response of the level `name`, have wrong shapes.

    Axis 1 must have the numbers of inputs and outputs, `channels`; all other axes must be alike.
    """
    drive, response = (array.shape for array in test)
    if (drive[0], *drive[2:]) != (response[0], *response[2:]) or (drive[1], response[1]) != channels:
        raise AnalysisError(
            f"test of {name}: drive {drive} and response {response} do not fit each other, or the level's "
            f"{channels[0]} inputs and {channels[1]} outputs"
        )
