"""Function generators and oscilloscopes of several makers that use SCPI, as a rig; `twin` simulates them."""

from .pair import PairRig as PairRig
