"""The example of the package `continuation`: its isola beside time integration, and its figure."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuation import AtMu, FoldCurve, Kind, Settings, continue_branch, isolas

FILE = Path(__file__).parents[1] / "examples" / "continuation_duffing.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location(FILE.stem, FILE)
    assert spec is not None and spec.loader is not None
    module = sys.modules[FILE.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def system(example: ModuleType) -> Any:
    return example.HarmonicBalance(example.ABSORBED)


@pytest.fixture(scope="module")
def folds(system: Any) -> FoldCurve:
    merged = system.response(0.24, Settings(lam_end=3.5, lam_min=0.4, step=0.02))
    curve: FoldCurve = system.folds(merged, 0.24, Settings(lam_end=0.05, lam_max=0.24, step=0.02))
    return curve


def peak_after(lam: float, force: float, x: Any, periods: int) -> float:
    """Largest displacement of the first mass over the last period of a march from the motion x."""
    coefficients = np.asarray(x).reshape(2, 4)
    k = np.array([1.0, 3.0])
    start = np.append(coefficients[:, :2].sum(axis=1), coefficients[:, 2:] @ k * lam)

    def slopes(t: float, y: Any) -> list[float]:
        a, b, a_t, b_t = y
        coupling = 0.0128 * (a_t - b_t) + 0.0454 * (a - b) + 0.0042 * (a - b) ** 3
        return [a_t, b_t, force * np.cos(lam * t) - 0.002 * a_t - a - a**3 - coupling, coupling / 0.05]

    end = 2.0 * np.pi / lam * periods
    times = np.linspace(end - 2.0 * np.pi / lam, end, 60)
    marched = solve_ivp(slopes, (0.0, end), start, t_eval=times, method="DOP853", rtol=1e-7, atol=1e-9)
    return float(np.max(np.abs(marched.y[0])))


def peak(x: Any) -> float:
    """Largest displacement of the first mass in a motion of harmonics 1 and 3."""
    phase = np.linspace(0.0, 2.0 * np.pi, 200)
    waves = np.column_stack([np.cos(phase), np.cos(3.0 * phase), np.sin(phase), np.sin(3.0 * phase)])
    return float(np.max(np.abs(waves @ x[:4])))


def upper(branch: Any, lam: float) -> Any:
    """Unknowns with the largest amplitude of a branch close to a frequency."""
    near = np.abs(branch.lam - lam) < 0.1
    return branch.x[near][np.argmax(np.hypot(branch.x[near, 0], branch.x[near, 2]))]


def test_the_isola_exists_in_time_between_birth_and_meeting(system: Any, folds: FoldCurve) -> None:
    """A motion on it persists, and dies out where the force is smaller than at the birth."""
    born, met = (next(p.lam for p in folds.special if p.kind is kind) for kind in (Kind.ISOLA_CENTRE, Kind.CROSSING))
    # of harmonics 1 and 3; the fifth moves both by less than 1e-3
    assert [born, met] == pytest.approx([0.1247, 0.1856], abs=1e-4)
    settings = Settings(lam_end=3.5, lam_min=0.4, step=0.02)
    force, lam = 0.15, 1.8
    (isola,) = isolas(folds, force, [system.response(force, settings)], settings)
    assert isola.closed
    on_it = continue_branch(AtMu(system.problem, force), upper(isola, lam), 1.78, Settings(lam_end=lam)).points[-1].x
    there = peak(on_it)
    assert peak_after(lam, force, on_it, 200) == pytest.approx(there, rel=2e-3)  # the fifth harmonic
    assert peak_after(lam, 0.96 * born, on_it, 400) < 0.5 * there


def test_no_isola_outside(system: Any, folds: FoldCurve) -> None:
    settings = Settings(lam_end=3.5, lam_min=0.4, step=0.02)
    for force in (0.12, 0.19):
        assert isolas(folds, force, [system.response(force, settings)], settings) == ()


def test_figure_has_every_special_point(example: ModuleType) -> None:
    figure = example.main()
    labels = [text.get_text() for axis in figure.axes if axis.get_legend() for text in axis.get_legend().get_texts()]
    assert {"cusp", "isola centre", "crossing"} <= set(labels)
    plt.close(figure)
