"""What the package needs beside other tools, for the same problems, in one session: `python -m benchmarks`."""
