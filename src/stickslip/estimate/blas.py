"""Linear algebra on one thread.

The matrices of a fit are small, hundreds of rows by tens of columns, and are solved thousands of times. BLAS
libraries distribute even those over all cores and then wait: on two busy cores, the fits of a mirror's piezos
took 37 s with all cores and 1 s with one thread.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


@functools.cache
def _controller() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  # loads SciPy's BLAS, which the controller must know

    return ThreadpoolController()


def single_threaded(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that BLAS (NumPy's and SciPy's linear algebra) uses one thread in the whole
    process while the function runs."""

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return run
