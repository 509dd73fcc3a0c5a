"""How long `import stickslip` takes: the median over fresh processes, printed as JSON.

python benchmarks/startup.py
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys

PROGRAM = """
import time
start = time.perf_counter()
import stickslip
print(time.perf_counter() - start)
"""
REPEATS = 11
LIMIT = 0.3


def main() -> None:
    """Measure, print, and fail above the limit."""
    command = [sys.executable, "-c", PROGRAM]
    runs = [subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(REPEATS)]
    seconds = [float(run.stdout) for run in runs]
    median = statistics.median(seconds)
    print(json.dumps({"import_median_s": median, "import_max_s": max(seconds), "limit_s": LIMIT}))
    sys.exit(median > LIMIT)


if __name__ == "__main__":
    main()
