"""A Dask cluster of processes as executor: the same numbers as here, from other processes."""

import importlib.util
import os
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hbm import load_rig, steady_state
from hbm.parallel import each

distributed = pytest.importorskip("distributed", reason="needs pip install 'casadi-hbm[cluster]'")

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster, distributed.Client(cluster) as client:
        yield client


def response(level: float, load: float) -> tuple[float, int]:
    rig = load_rig(EXAMPLES / "paper_beam.toml")
    rig = replace(rig, contact=replace(rig.contact, normal_load=load), channels=())
    return float(steady_state(rig, 50.0, level=level, harmonics=5, samples=128)["drive"].peak), os.getpid()


def test_levels_and_loads_are_the_same_from_a_cluster(client: Any) -> None:
    grid = [list(values) for values in zip(*product((1.0, 3.0, 6.5), (60.0, 83.0, 100.0)), strict=True)]
    expected = [height for height, _ in each(None, response, *grid)]
    found = each(client.get_executor(), response, *grid)
    assert [height for height, _ in found] == expected
    assert len(set(expected)) == len(expected)
    assert os.getpid() not in {process for _, process in found}


def test_the_example_runs_on_a_cluster(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["monte_carlo.py", "4", client.scheduler.address])
    spec = importlib.util.spec_from_file_location("__main__", EXAMPLES / "monte_carlo.py")  # as a script
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    assert example.hz.shape == (4,)
    assert np.all((example.hz > 46.0) & (example.hz < 60.0))
