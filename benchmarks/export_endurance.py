"""What exported C is tried with once, not in every test run: a thousand million steps of random input,
instruction counts of the laws on a Cortex-M4F, static analysis.

``python -m benchmarks.export_endurance [STEPS]`` prints it.

Needs gcc; arm-none-eabi-gcc with newlib, qemu-system-arm and cppcheck for the parts that say so.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from stickslip import (
    Coulomb,
    Dahl,
    Elastoplastic,
    MaxwellSlip,
    ResetIntegrator,
    Stribeck,
    load_actuator,
)
from stickslip.export import export_c

ENDURE = Path(__file__).parents[1] / "tests" / "export" / "endure.c"
KANG = load_actuator("kang2007")
LAWS = (
    KANG.friction,
    KANG.friction._replace(stiction_force=0.7, sigma_2=5.0),
    Dahl(1.399e6, 0.54),
    Dahl(1.399e6, 0.54, exponent=1.5),
    ResetIntegrator(1.399e6, 3.9e-7, 0.1, 20.0),
    Elastoplastic(1.399e6, 34.9, 0.0, 0.54, 0.6, 2e-7),
    MaxwellSlip((1e6, 4e5, 2e5), (0.2, 0.2, 0.14)),
    Coulomb(0.54),
    Stribeck(0.54, 0.7, 1e-3, 3.0),
)


def main() -> None:
    steps = sys.argv[1] if len(sys.argv) > 1 else "1000000000"
    with tempfile.TemporaryDirectory() as place:
        for i, law in enumerate(LAWS):
            folder = export_c(KANG.replace(friction=law), Path(place) / f"{i}")
            print(f"{type(law).__name__}: {counted(folder)}", flush=True)
        folder = Path(place) / "0"
        print("cppcheck:", *analysed(folder), sep="\n  ", flush=True)
        for real in ("STICKSLIP_DOUBLE", "STICKSLIP_FLOAT"):
            files = [ENDURE, folder / "stickslip.c", folder / "stickslip_parameters.c"]
            command = [
                "gcc",
                "-std=c99",
                "-O2",
                f"-D{real}",
                f"-I{folder}",
                *files,
                "-o",
                folder / "endure",
                "-lm",
            ]
            subprocess.run(command, check=True)
            begun = time.perf_counter()
            done = subprocess.run([folder / "endure", steps], capture_output=True, text=True, check=False)
            took = time.perf_counter() - begun
            print(f"{real}: {steps} steps, {took:.0f} s, exit {done.returncode}; {done.stdout}{done.stderr}")


def counted(folder: Path) -> str:
    """Size, and instructions per step, on the Cortex-M4F that QEMU has."""
    size = subprocess.run(["make", "bare"], cwd=folder, capture_output=True, text=True, check=True).stdout
    text, data, bss = size.splitlines()[-1].split()[:3]
    counts = subprocess.run(["make", "count"], cwd=folder, capture_output=True, text=True, check=True)
    mean, most = re.findall(r"instructions per step, \w+ (\d+)", counts.stdout + counts.stderr)
    state = f"{text} bytes of code and tables, {int(data) + int(bss)} of memory"
    return f"{state}, {mean} instructions per step on average, {most} at most"


def analysed(folder: Path) -> list[str]:
    """What cppcheck finds, and how often each rule of MISRA C:2012 is broken."""
    base = [
        "cppcheck",
        "--std=c99",
        "--enable=warning,style,performance,portability",
        "--inline-suppr",
        "-I.",
    ]
    files = ["stickslip.c", "stickslip_parameters.c"]
    plain = subprocess.run([*base, "--error-exitcode=3", *files], cwd=folder, capture_output=True, text=True)
    misra = subprocess.run([*base, "--addon=misra", *files], cwd=folder, capture_output=True, text=True)
    rules = Counter(re.findall(r"misra-c2012-([\d.]+)", misra.stderr))
    return [
        f"exit {plain.returncode}",
        *plain.stderr.splitlines(),
        f"MISRA C:2012: {dict(sorted(rules.items()))}",
    ]


if __name__ == "__main__":
    main()
