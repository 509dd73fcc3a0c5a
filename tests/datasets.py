"""Where the measured data of others are; they are read from there, never committed."""

from pathlib import Path

DATASETS = (Path(__file__).parents[1] / ".." / "shared" / "datasets").resolve()
