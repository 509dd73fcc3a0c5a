"""Cards of National Instruments."""

from .daqmx import DaqmxRig as DaqmxRig
