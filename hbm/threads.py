"""Matrices here have some hundred rows: a second BLAS thread costs time, most of all on a busy machine."""

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

Inputs = ParamSpec("Inputs")
Result = TypeVar("Result")


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread(function: Callable[Inputs, Result]) -> Callable[Inputs, Result]:
    """Run a function with one BLAS thread."""

    @wraps(function)
    def limited(*args: Inputs.args, **kwargs: Inputs.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
