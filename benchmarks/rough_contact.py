"""Stiffness of random rough surfaces by a half-space solution, beside what `contact.persson` says.

    python -m benchmarks.rough_contact

Two Hurst exponents, with and without a plateau, two surfaces of each, four loads: for each γ = P/(k_n h_rms)
and the ratio of tangential to normal stiffness over 2(1 - ν)/(2 - ν). Half a minute.
"""

from __future__ import annotations

import numpy as np
from tests.physics.contact.half_space import held, periodic, pressed, rough

SIZE, NU = 256, 0.3
LOADS = (0.02, 0.06, 0.15, 0.3)  # mean pressure over E* and the root mean square slope


def main() -> None:
    """Compute and print."""
    spacing = 1.0 / SIZE
    normal, along = periodic(SIZE, spacing), periodic(SIZE, spacing, nu=NU, modulus=0.5 * (1.0 - NU))
    print("Hurst  longest  seed  in contact      γ   k_t/k_n over theory")
    for hurst in (0.3, 0.8):
        for longest in (1.0, 0.25):
            for seed in (0, 1):
                z = 0.002 * rough(SIZE, spacing, hurst, longest, 8 * spacing, seed)
                steps = [(np.roll(z, -1, axis) - z) / spacing for axis in (0, 1)]
                slope = np.sqrt(np.mean(steps[0] ** 2 + steps[1] ** 2))
                for load in LOADS:
                    p = pressed(normal, -z, load * slope, 1e-5)
                    k_n, k_t = (held(one, p > 0.0, np.ones(p.shape), 1e-5).mean() for one in (normal, along))
                    gamma, ratio = load * slope / (k_n * z.std()), k_t / k_n / (2.0 * (1.0 - NU) / (2.0 - NU))
                    share = np.count_nonzero(p) / p.size
                    print(f"{hurst:5}{longest:9}{seed:6}{share:12.3f}{gamma:7.3f}{ratio:15.4f}", flush=True)


if __name__ == "__main__":
    main()
