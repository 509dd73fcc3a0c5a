"""Identification files: a YAML file says what to read, fit and verify; running it gives a report's
document."""

from .running import run_file as run_file
