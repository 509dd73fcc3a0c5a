"""Experiment files: a YAML file says what to record, on which rig; running it gives the recordings."""

from .running import Recorded as Recorded
from .running import run_experiment as run_experiment
