"""Binary messages for the page: arrays as float32 behind a header in JSON."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def packed(header: dict[str, Any], *arrays: ArrayLike) -> bytes:
    """Return a binary message: header length (uint32), header in JSON, and the arrays as float32.

    All numbers are little-endian. Spaces extend the header to a multiple of 4 bytes. The key "lengths" is
    added to it: the number of values of each array. An array with several dimensions is flattened.
    """
    numbers = [np.asarray(array, dtype="<f4").ravel() for array in arrays]
    text = json.dumps({**header, "lengths": [one.size for one in numbers]}).encode()
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<I", len(text)), text, *(one.tobytes() for one in numbers)])
