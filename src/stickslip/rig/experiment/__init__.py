"""Experiment files: a YAML file says what to record, on which rig; running it gives the recordings."""

from .cells import Cell as Cell
from .running import Recorded as Recorded
from .running import run_experiment as run_experiment
