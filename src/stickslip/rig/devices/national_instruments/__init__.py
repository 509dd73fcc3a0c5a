"""Data acquisition cards of National Instruments: a rig that uses NI-DAQmx."""

from .daqmx import DaqmxRig as DaqmxRig
