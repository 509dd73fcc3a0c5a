"""Readers of measurement files (text, MAT, HDF5, MDF, TDMS, oscilloscopes and others), of logs, frequency
responses and friction points; their checks, and inspection of files."""

from .blocks import read_log as read_log
from .frequency_table import read_frequency_response as read_frequency_response
from .inspection import Inspection as Inspection
from .inspection import inspect_file as inspect_file
from .points import read_points as read_points
from .reading import read_recording as read_recording
