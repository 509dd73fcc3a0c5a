"""Experiment files: a YAML file describes a rig and the recordings to make with it; running the file makes
them."""

from .cells import Cell as Cell
from .running import Recorded as Recorded
from .running import run_experiment as run_experiment
