"""The board Red Pitaya (generator and fast inputs) as a rig."""

from .stemlab import RedPitayaRig as RedPitayaRig
