"""Readers of the files that measurements come in."""

from .inspection import Inspection as Inspection
from .inspection import inspect_file as inspect_file
from .reading import read_recording as read_recording
