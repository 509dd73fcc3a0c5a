"""Jobs: one file whose steps record, identify, verify, compare and export."""

from .running import run_job as run_job
