"""How many threads BLAS may use."""

from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> Any:
    return ThreadpoolController()


def one_blas_thread() -> Any:
    """Context in which BLAS runs in one thread.

    For work in many small blocks: sharing each block among threads costs more than it gains, and on a
    busy machine the threads wait for each other (thirty times slower was measured).
    """
    return _controller().limit(limits=1, user_api="blas")
