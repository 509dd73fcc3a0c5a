"""Experiment files: a YAML file describes the recordings and their rig; running the file makes the
recordings."""

from .cells import Cell as Cell
from .running import Recorded as Recorded
from .running import run_experiment as run_experiment
