"""The clamped payload of an F-16: what the interface under a random multisine does, and what a sweep does not."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from hbm.figures.style import INK, SMALL, WIDTH, dressed, graded
from hbm.measurement.harmonics import HarmonicEstimate, harmonic_spectra
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import recording

from .common import DATA, Finding, read_rows, table, with_std, write_history

FOLDER = DATA / "f16_ground_vibration"
RATE, N = 400.0, 8192
CHANNELS = ("force", "acc1", "acc2", "acc3")
BAND = (2.0, 20.0)
"""Below, twice integrated accelerations are noise; above, nothing of interest [Hz]."""
MODE = (6.8, 7.8)
"""Where the payload moves against the wing [Hz]."""
H_CHECKED = 300
CROPPED = 4.0
"""Sweeps are looked at in pieces of so many seconds: about 29 cycles, over which the sweep moves 0.2 Hz."""


@dataclass(frozen=True, eq=False)
class Interface:
    """One level of the full multisine; amplitudes at the lines k / (N / RATE)."""

    name: str
    level: float
    hz: np.ndarray
    force: np.ndarray
    payload: np.ndarray
    payload_std: np.ndarray
    relative: np.ndarray
    per_mass: np.ndarray

    @property
    def inside(self) -> np.ndarray:
        """Lines of the mode."""
        return (self.hz >= MODE[0]) & (self.hz <= MODE[1])

    @property
    def travel(self) -> float:
        """Root mean square of the relative displacement in the band of the mode [m]."""
        return float(np.sqrt(np.sum(np.abs(self.relative[self.inside]) ** 2) / 2))

    @property
    def stiffness(self) -> complex:
        """Interface force over relative displacement, per payload mass; least squares over the band [1/s^2]."""
        x, T = self.relative[self.inside], self.per_mass[self.inside]
        return complex(np.vdot(x, T) / np.vdot(x, x))

    @property
    def energy(self) -> float:
        """Energy the interface takes per payload mass in one cycle of the mode [J/kg]."""
        x, T = self.relative[self.inside], self.per_mass[self.inside]
        omega = 2 * np.pi * self.hz[self.inside]
        return float(np.sum(omega * (T * x.conj()).imag) / 2 / np.mean(self.hz[self.inside]))

    def time(self, amplitudes: np.ndarray, low: float, high: float) -> np.ndarray:
        """Samples of one period, of the lines within a band."""
        kept = (self.hz >= low) & (self.hz <= high)
        return np.fft.irfft(np.where(kept, amplitudes, 0.0) * N / 2, N)


def levels() -> list[Interface]:
    """All levels, by rising force."""
    periods = np.load(FOLDER / "multisine_period_average.npz")
    names = sorted({key.split("_")[0] for key in periods})
    return [_interface(name, {c: periods[f"{name}_{c}"].astype(float) for c in CHANNELS}) for name in names]


def _interface(name: str, samples: dict[str, np.ndarray]) -> Interface:
    hz = np.arange(N // 2 + 1) * RATE / N
    force, _, wing, payload = (np.fft.rfft(samples[c]) * 2 / N for c in CHANNELS)
    omega = np.where(hz > 0, 2 * np.pi * hz, np.inf)
    inside = (hz >= BAND[0]) & (hz <= BAND[1])
    relative = np.where(inside, (payload - wing) / omega**2, 0.0)
    rows = _file_std(name)
    return Interface(name, float(samples["force"].std()), hz, force, payload, rows, relative, -payload)


def _file_std(name: str) -> np.ndarray:
    """Standard deviations of acc3's lines, as the file gives them; inf beyond."""
    std = np.full(N // 2 + 1, np.inf)
    for row in read_rows(FOLDER / "multisine_harmonics.csv"):
        if row["record"] == name and row["channel"] == "acc3":
            std[int(row["harmonic"])] = float(row["std"])
    return std


def mode_of(found: Interface) -> tuple[float, float, float, float]:
    """Frequency and damping ratio of the mode in payload over force, with standard deviations.

    One pole over a straight line (all other modes); at high levels the best linear description of what is not linear.
    """
    hz = found.hz[found.inside]
    g = found.payload[found.inside] / found.force[found.inside]
    weight = np.abs(found.force[found.inside]) / found.payload_std[found.inside]

    def columns(p: np.ndarray) -> np.ndarray:
        pole = 1.0 / (p[0] ** 2 - hz**2 + 2j * p[1] * p[0] * hz)
        return np.column_stack([pole, np.ones(len(hz)), hz - 7.3]) * weight[:, None]

    def left(p: np.ndarray) -> np.ndarray:
        A = columns(p)
        e = A @ np.linalg.lstsq(A, g * weight, rcond=None)[0] - g * weight
        return np.concatenate([e.real, e.imag])

    top = float(hz[np.abs(g).argmax()])
    fit = least_squares(left, [top, 0.01], x_scale=(0.1, 0.01))
    chi2 = 2 * fit.cost / (2 * len(hz) - 8)
    std = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)) * max(chi2, 1.0))
    return float(fit.x[0]), float(std[0]), float(abs(fit.x[1])), float(std[1])


def converted(name: str, folder: Path) -> float:
    """Largest difference between our harmonics of a period, through a CSV file, and those of the set.

    Relative to the largest harmonic of the channel.
    """
    periods = np.load(FOLDER / "multisine_period_average.npz")
    samples = {c: periods[f"{name}_{c}"].astype(float) for c in CHANNELS}
    file = write_history(folder / f"{name}.csv", np.arange(N) / RATE, samples)
    ours = harmonic_spectra(load_history(file), RATE / N, H_CHECKED)
    worst, largest = 0.0, dict.fromkeys(CHANNELS, 0.0)
    rows = [r for r in read_rows(FOLDER / "multisine_harmonics.csv") if r["record"] == name]
    for row in rows:
        largest[row["channel"]] = max(largest[row["channel"]], abs(complex(float(row["cos"]), float(row["sin"]))))
    for row in rows:
        k, c = int(row["harmonic"]), row["channel"]
        if k <= H_CHECKED:
            mine = ours.coefficients[ours.channels.index(c)][[k, k + ours.H]]
            apart = np.abs(mine - [float(row["cos"]), float(row["sin"])]).max()
            worst = max(worst, float(apart) / largest[c])
    return worst


def sweep_piece(name: str, hz: float) -> HarmonicEstimate:
    """What `hbm spectra` makes of a piece of the sine sweep about a frequency."""
    sweep = np.load(FOLDER / "sine_sweep_time_5p6_to_9p6hz.npz")
    at = int(np.abs(sweep[f"{name}_frequency_hz"] - hz).argmin())
    half = int(CROPPED * RATE / 2)
    piece = slice(at - half, at + half)
    channels = {c: sweep[f"{name}_{c}"][piece] for c in ("force", "acc2", "acc3")}
    return harmonic_spectra(recording(name, sweep[f"{name}_time_s"][piece], channels), hz, 3)


def unsteady(estimate: HarmonicEstimate) -> str:
    """What speaks against a record, of its payload channel, or of all phases."""
    q = estimate.quality[estimate.channels.index("acc3")].steadiness
    return f"{q.change:.0%}, p = {q.p_steady:.0e}" if not q.steady else "steady"


def run() -> Finding:
    """Table, figure and conclusion."""
    found = levels()
    with tempfile.TemporaryDirectory() as folder:
        differences = [converted(x.name, Path(folder)) for x in found]
    modes = [mode_of(x) for x in found]
    pieces = {"MS1": "SW1", "MS3": "SW3", "MS5": "SW5", "MS7": "SW7"}
    verdicts = [unsteady(sweep_piece(pieces[x.name], 7.2)) for x in found]
    rows = [
        (
            f"{x.name}, {x.level:.0f} N",
            f"{d:.1e}",
            with_std(f, f_std),
            with_std(z, z_std, 1e2),
            f"{x.travel * 1e6:.0f}",
            f"{x.stiffness.real / 1e3:.1f}",
            f"{x.stiffness.imag / x.stiffness.real:.2f}",
            said,
        )
        for x, d, (f, f_std, z, z_std), said in zip(found, differences, modes, verdicts, strict=True)
    ]
    slope, slope_std = growth(found)
    f, z = [m[0] for m in modes], [m[2] for m in modes]
    k = [x.stiffness for x in found]
    head = ("record", "conversion", "mode [Hz]", "ζ [%]", "travel [µm]", "k/m [1e3/s²]", "loss", "sweep at 7.2 Hz")
    return Finding(
        "f16_ground_vibration",
        table(
            "F-16 interface: conversion against the set, linear mode, interface stiffness and loss in "
            f"{MODE[0]}..{MODE[1]} Hz, and what hbm spectra says of the sweep",
            head,
            rows,
        ),
        _figure(found),
        (
            f"From {found[0].level:.0f} to {found[-1].level:.0f} N the mode falls from {f[0]:.3f} to {f[-1]:.3f} Hz, "
            f"its ζ changes from {z[0] * 100:.2f} to {z[-1] * 100:.2f} %; the interface keeps "
            f"{k[-1].real / k[0].real:.0%} of its stiffness, its loss factor rises from "
            f"{k[0].imag / k[0].real:.2f} to {k[-1].imag / k[-1].real:.2f}.",
            f"Energy per cycle ~ travel^{with_std(slope, slope_std)}; the sweep is flagged as unsteady at "
            f"{sum(v != 'steady' for v in verdicts)} of {len(verdicts)} levels. Loss at low level is not friction "
            "alone: rotation of the payload is in acc2 - acc3 too.",
        ),
    )


def growth(found: list[Interface]) -> tuple[float, float]:
    """Exponent of energy over travel between the levels, with its standard deviation."""
    x, y = np.log([i.travel for i in found]), np.log([i.energy for i in found])
    (slope, _), cov = np.polyfit(x, y, 1, cov=True)
    return float(slope), float(np.sqrt(cov[0, 0]))


def _figure(found: list[Interface]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.3, 1, 1))
    for x, color in zip(found, graded([x.level for x in found]), strict=True):
        shown = (x.hz >= 6.0) & (x.hz <= 9.0)
        axes[0].semilogy(
            x.hz[shown],
            np.abs(x.payload[shown] / x.force[shown]),
            color=color,
            linewidth=1.0,
            label=f"{x.level:.0f} N",
        )
    for ax, x, color in zip(axes[1:], (found[0], found[-1]), graded([0.0, 1.0]), strict=True):
        u, T = x.time(x.relative, *MODE), x.time(x.per_mass, *MODE)
        ax.plot(u * 1e6, T, color=color, linewidth=0.3)
        ax.set_title(f"{x.level:.0f} N rms", fontsize=SMALL + 1, color=INK)
        dressed(ax, "Relative\ndisplacement [µm]", "")
    dressed(axes[0], "Frequency [Hz]", "Payload acceleration\nper force [1/kg]")
    axes[0].legend(frameon=False, fontsize=SMALL, labelcolor=INK)
    axes[1].set_ylabel("Interface force\nper payload mass [N/kg]", color=INK)
    return figure
