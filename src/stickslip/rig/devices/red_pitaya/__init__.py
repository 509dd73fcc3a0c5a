"""The board Red Pitaya."""

from .stemlab import RedPitayaRig as RedPitayaRig
