"""This package beside other tools, on the same problems, in one session: `python -m benchmarks`."""
