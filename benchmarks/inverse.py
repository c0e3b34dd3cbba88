"""Formulations of the inverse harmonic balance against the independent simulator: error, coverage and time, as tables.

The paper's beam with ten times its damping and a Coulomb contact in penalty form, 60 records of five levels around
resonance, from finite elements marched in time (tests/truth). Harmonics 0 to 9 of eight accelerometers, and of the
force with a tenth of their noise; noise is relative to the largest fundamental of each channel, as in the example data.
Errors are relative L2 errors over the period, medians over records: friction T and slip u without their mean where the
contact never slips, slip always without; R is the reaction. Coverage is the share of samples within the 95 % interval.

A second table has a rig file that is wrong by 2 % in Young's modulus: by noise alone, with what the rig file may be off
by (1 % of that modulus among it), and with the numbers that sensors ask for.

Run: python -m benchmarks.inverse [--quick]
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hbm.identification.contacterrors import contact_errors
from hbm.inverse.reconstruct import FORMULATIONS, reconstruct, reconstruct_again
from hbm.inverse.reconstruction import Reconstruction
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models import Beam, Channel, Damping, Rig
from models.published import paper_rig
from tests.truth.laws import Coulomb
from tests.truth.rig import table_1
from tests.truth.simulate import scattered, simulate_records

POSITIONS = {"a1": 0.1, "a2": 0.2, "a3": 0.3, "a4": 0.4, "a5": 0.5, "a6": 0.58, "a7": 0.25, "a8": 0.45}
LAYOUTS = {4: ("a1", "a3", "a5", "a6"), 6: ("a1", "a2", "a3", "a4", "a5", "a6"), 8: tuple(POSITIONS)}
DECIBELS = (40, 50, 60)
FORCE_DECIBELS = 20
HARMONICS = 9
LEVELS, HERTZ = (1.5, 2.5, 4.0, 5.5, 6.5), np.linspace(45.0, 60.0, 12)
FEW_LEVELS, FEW_HERTZ = (2.5, 6.5), np.linspace(46.0, 58.0, 6)
TOO_STIFF = 1.02
SEED = 20261121


@dataclass(frozen=True)
class Truth:
    """Records without noise: amplitudes of each channel (r, H+1), and signals at the contact over a period (r, N)."""

    hz: NDArray[np.float64]
    level: NDArray[np.float64]
    amplitudes: dict[str, NDArray[np.complex128]]
    friction: NDArray[np.float64]
    slip: NDArray[np.float64]
    normal: NDArray[np.float64]


def truth(quick: bool) -> Truth:
    """Steady states of the simulator; the only place that knows it."""
    law = Coulomb(mu=0.52, critical_slip=4.146e-6)
    levels, hertz = (FEW_LEVELS, FEW_HERTZ) if quick else (LEVELS, HERTZ)
    records = scattered(list(product(levels, hertz.tolist())), np.random.default_rng(SEED))
    found = simulate_records(table_1(law, sensors=tuple(POSITIONS.values())), records)
    found = found.where(found.usable)
    signals = {"force": found.force, **{name: found.acceleration[:, i] for i, name in enumerate(POSITIONS)}}
    return Truth(
        hz=np.array([r.hz for r in found.records]),
        level=np.array([r.level for r in found.records]),
        amplitudes={name: np.fft.rfft(s)[:, : HARMONICS + 1] * 2 / s.shape[1] for name, s in signals.items()},
        friction=found.T,
        slip=found.u,
        normal=found.R,
    )


def nominal() -> Rig:
    """The rig file: everything as simulated."""
    channels = (Channel("force", "force", 0.555), *(Channel(n, "acceleration", x) for n, x in POSITIONS.items()))
    return replace(paper_rig(), channels=channels, damping=Damping(mass_proportional=0.6))


def measure(rig: Rig, true: Truth, decibels: float) -> MeasuredSpectra:
    """All channels with noise."""
    rng = np.random.default_rng(SEED)
    coefficients, std = {}, {}
    for name, c in true.amplitudes.items():
        quieter = decibels + (FORCE_DECIBELS if name == "force" else 0)
        noise = np.abs(c[:, 1]).max() * 10 ** (-quieter / 20)
        exact = np.concatenate([np.zeros((len(c), 1)), c.real[:, 1:], -c.imag[:, 1:]], axis=1)
        coefficients[name] = exact + noise * rng.normal(size=exact.shape)
        std[name] = np.full(c.shape, noise)
    return spectra_of(rig, true.hz, true.level, coefficients, std)


def compared(found: Reconstruction, true: Truth, name: str) -> tuple[float, float]:
    """Median relative L2 error of a signal over records, and coverage of its 95 % intervals."""
    exact = getattr(true, name)
    signal = found[name]
    estimate, std = (x[:, :: x.shape[1] // 256] for x in (signal.samples, signal.whole_std))
    exact = exact[:, :: exact.shape[1] // 256]
    unknown = np.full(len(exact), name == "slip") | ((name == "friction") & ~found.slips)
    estimate = estimate - unknown[:, None] * estimate.mean(axis=1, keepdims=True)
    exact = exact - unknown[:, None] * exact.mean(axis=1, keepdims=True)
    error = np.linalg.norm(estimate - exact, axis=1) / np.linalg.norm(exact, axis=1)
    return float(np.median(error)), float(np.mean(np.abs(estimate - exact) < 1.96 * std))


def row(rig: Rig, spectra: MeasuredSpectra, true: Truth, formulation: str) -> list[str]:
    """Errors, coverages and seconds of one reconstruction."""
    began = time.perf_counter()
    found = reconstruct(rig, spectra, formulation=formulation)
    return judged(found, true, time.perf_counter() - began)


def judged(found: Reconstruction, true: Truth, spent: float) -> list[str]:
    """Errors, coverages and seconds."""
    pairs = [compared(found, true, name) for name in ("friction", "slip", "normal")]
    errors, coverages = zip(*pairs, strict=True)
    return [*(f"{100 * e:.2f}" for e in errors), *(f"{100 * c:.0f}" for c in coverages), f"{spent:.2f}"]


def rows(rig: Rig, true: Truth, cases: Iterator[tuple[int, int]]) -> Iterator[list[str]]:
    """Sensors, decibels and formulation, then what :func:`row` says."""
    for sensors, decibels in cases:
        spectra = measure(nominal(), true, decibels).select(channels=["force", *LAYOUTS[sensors]])
        for formulation in FORMULATIONS:
            yield [str(sensors), str(decibels), formulation, *row(rig, spectra, true, formulation)]


def rows_of_errors(rig: Rig, true: Truth) -> Iterator[list[str]]:
    """The same with what the rig file may be off by, and with the numbers that sensors ask for."""
    spectra = measure(nominal(), true, 60).select(channels=["force", *LAYOUTS[6]])
    found, began = reconstruct(rig, spectra), time.perf_counter()
    errors = contact_errors(found)
    yield ["6", "60", "and the rig file", *judged(errors.stated, true, time.perf_counter() - began)]
    again, began = reconstruct_again(found, found.rig.with_numbers(errors.known.calibrated)), time.perf_counter()
    stated = contact_errors(again).stated
    yield ["6", "60", "calibrated", *judged(stated, true, time.perf_counter() - began)]


def table(title: str, lines: Iterator[list[str]]) -> Table:
    """Print-ready."""
    heads = ("sensors", "dB", "formulation", "T %", "u %", "R %", "T\ncovered", "u\ncovered", "R\ncovered", "s")
    out = Table(*heads, title=title)
    for line in lines:
        out.add_row(*line, end_section=line[2] == list(FORMULATIONS)[-1])
    return out


def main(quick: bool) -> None:
    """Simulate, reconstruct, print."""
    true, rig = truth(quick), nominal()
    assert isinstance(rig.body, Beam)
    stiff = replace(rig, body=replace(rig.body, youngs_modulus=TOO_STIFF * rig.body.youngs_modulus))
    console = Console(width=110)
    layouts, decibels = ((6,), (50,)) if quick else (tuple(LAYOUTS), DECIBELS)
    console.print(table(f"{len(true.hz)} records, rig file right", rows(rig, true, product(layouts, decibels))))
    console.print(
        table(
            "Young's modulus 2 % too large", chain(rows(stiff, true, product((6,), (60,))), rows_of_errors(stiff, true))
        )
    )


if __name__ == "__main__":
    main("--quick" in sys.argv[1:])
