"""Commented templates of input files and of a user's own laws and waveforms, filled in from recordings."""

from .writing import KINDS as KINDS
from .writing import new_file as new_file
