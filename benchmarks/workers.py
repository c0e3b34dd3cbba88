"""A process for each tool: silent, with one BLAS thread, with JAX in double precision."""

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

ENVIRONMENT = {
    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "JAX_ENABLE_X64": "1",
}


def process() -> ProcessPoolExecutor:
    """One process; it starts with its first task."""
    os.environ.update(ENVIRONMENT)
    return ProcessPoolExecutor(1, get_context("spawn"), _silent)


def _silent() -> None:
    """Tools print; their process does not."""
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
