"""Function generators and oscilloscopes that use SCPI, of several makers."""

from .pair import PairRig as PairRig
