"""Make what tests share importable by all of them; one thread each, they run side by side; no figure stays open."""

import gc
import os
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more of them only wait for each other on matrices this small
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    # workers, and commands that tests start, find compiled what those before them compiled; nothing is left in the tree
    os.environ.setdefault("PYTHONPYCACHEPREFIX", str(Path(tempfile.gettempdir()) / "hbm-compiled"))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let the collector of garbage never look at the millions of objects of modules and tests, which stay anyway."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True)
def figures_closed() -> Iterator[None]:
    """Close what a test drew, for matplotlib warns of twenty open figures."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
