"""The Silverbox circuit: its restoring force from harmonics, and what its anti-alias filters did to the records.

Both channels pass the same steep low-pass filter, so that their ratio is that of the circuit and a linear fit sees
nothing of it. The cube is formed before the filter: where the filter's phase is not proportional to frequency, the
cube of what was recorded is not the recorded cube. Its phase A(f) = exp(-i (c_3 f^3 + c_5 f^5)), less a delay that
matters to nobody, is found with the circuit on the training records, and undone.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from hbm.figures.style import FAINT, INK, SMALL, WIDTH, dressed
from hbm.inverse.reconstruct import reconstruct
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.historyfile import load_history
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models.friction import Frictionless
from models.parts import Channel, Contact, Damping, Excitation, ModalBody
from models.rig import Rig

from .common import DATA, Finding, legend_above, read_rows, table, with_std, write_history

FOLDER = DATA / "silverbox_circuit"
H = 2683
"""Last excited line; all odd lines up to it are excited."""
HELD_OUT = 2
"""The last records are not shown to any fit."""
H_CHECKED = 300
TOP = 200.0
"""Frequency that filter coefficients refer to [Hz]."""
MODELS = ("no filter", "f³", "f³, f⁵")


@dataclass(frozen=True, eq=False)
class Circuit:
    """Records in harmonics k (r, H+1) of v1 and v2, zero where not excited; std of each of cos and sin, (r, H+1)."""

    names: list[str]
    hz: float
    v1: np.ndarray
    v2: np.ndarray
    v1_std: np.ndarray
    v2_std: np.ndarray
    held_out: int = HELD_OUT

    @property
    def train(self) -> slice:
        """Records that are fitted."""
        return slice(0, len(self.names) - self.held_out)

    @property
    def held(self) -> slice:
        """Records that are not shown to any fit."""
        return slice(len(self.names) - self.held_out, None)

    @property
    def f(self) -> np.ndarray:
        """Frequencies of the harmonics [Hz]."""
        return self.hz * np.arange(H + 1)

    @property
    def used(self) -> np.ndarray:
        """Odd lines, (H+1,)."""
        return np.arange(H + 1) % 2 == 1


@dataclass(frozen=True, eq=False)
class Linear:
    """v2'' + d v2' + w2 v2 + k_3 v2^3 + k_2 v2^2 = b v1, behind a filter; chi2 per degree of freedom by record."""

    b: float
    d: float
    w2: float
    k3: float
    k2: float
    filter: np.ndarray
    chi2: np.ndarray

    @property
    def rig(self) -> Rig:
        """Rig of the linear part; v1 is the force, and the contact moves as v2 does."""
        f, r = np.sqrt(self.w2) / 2 / np.pi, np.sqrt(self.b)
        return Rig(
            "Silverbox",
            ModalBody((f,), ((r,), (r,)), (r,), (r,)),
            Damping(modal_ratios=(self.d / 2 / np.sqrt(self.w2),)),
            Contact(0.1, Frictionless()),
            Excitation(0.02),
            (Channel("v1", "force"), Channel("v2", "displacement")),
        )

    def undone(self, f: np.ndarray) -> np.ndarray:
        """What recorded amplitudes are multiplied with to undo the filter."""
        return np.exp(1j * sum(c * (f / TOP) ** (3 + 2 * i) for i, c in enumerate(self.filter)))


def circuit() -> Circuit:
    """All records of the set, and the standard deviations it gives."""
    periods = np.load(FOLDER / "multisine_periods.npz")
    names = sorted({key.rsplit("_", 1)[0] for key in periods if key != "sampling_hz"})
    N = len(periods[f"{names[0]}_v1"])
    odd = np.arange(H + 1) % 2 == 1

    def of(channel: str) -> np.ndarray:
        samples = np.array([periods[f"{name}_{channel}"] for name in names], dtype=float)
        return np.where(odd, np.fft.rfft(samples, axis=1)[:, : H + 1] * 2 / N, 0.0)

    std = {c: np.full((len(names), H + 1), np.nan) for c in ("v1_input", "v2_output")}
    for row in read_rows(FOLDER / "multisine_harmonics.csv"):
        std[row["channel"]][names.index(row["record"]), int(row["harmonic"])] = float(row["std"])
    return Circuit(names, float(periods["sampling_hz"]) / N, of("v1"), of("v2"), std["v1_input"], std["v2_output"])


def first_and_last(c: Circuit) -> Circuit:
    """One record to fit, one held out."""
    kept = np.array([0, len(c.names) - 1])
    names = [c.names[i] for i in kept]
    return Circuit(names, c.hz, c.v1[kept], c.v2[kept], c.v1_std[kept], c.v2_std[kept], held_out=1)


def power(amplitudes: np.ndarray, n: int) -> np.ndarray:
    """Harmonics 0..H of the n-th power of a signal, by samples enough that none folds back."""
    N = 1 << int(np.ceil(np.log2(2 * n * H)))
    samples = np.fft.irfft(amplitudes * N / 2, N, axis=-1) ** n
    return np.fft.rfft(samples, axis=-1)[..., : H + 1] * 2 / N


def fit(c: Circuit, filters: int) -> Linear:
    """Circuit and filter of the training records, by least squares over the odd lines, weighted by their noise."""
    omega = 2 * np.pi * c.f
    scale = np.array([1e5, 50.0, 1e5, 1e6, 1e5] + [0.3] * filters)
    start = np.array([1.8e5, 50.0, 1.8e5, 7e5, 0.0] + [0.0] * filters)

    def left(p: np.ndarray, rows: slice) -> np.ndarray:
        b, d, w2, k3, k2 = p[:5]
        y = c.v2[rows] * Linear(*p[:5], p[5:], np.empty(0)).undone(c.f)
        F = c.v1[rows] * Linear(*p[:5], p[5:], np.empty(0)).undone(c.f)
        Z = w2 - omega**2 + 1j * omega * d
        e = Z * y + k3 * power(y, 3) + k2 * power(y, 2) - b * F
        std = np.sqrt(np.abs(Z) ** 2 * c.v2_std[rows] ** 2 + b**2 * c.v1_std[rows] ** 2)
        shares = e[:, c.used] / std[:, c.used]
        return np.concatenate([shares.real, shares.imag], axis=1)

    found = least_squares(lambda x: left(x * scale, c.train).ravel(), start / scale)
    p = found.x * scale
    return Linear(*p[:5].tolist(), p[5:], np.mean(left(p, slice(None)) ** 2, axis=1))


def spectra(c: Circuit, model: Linear) -> MeasuredSpectra:
    """Records with the filter undone, one fundamental of 0.07 Hz and its odd harmonics each."""
    turn, seen = model.undone(c.f), c.used

    def coefficients(amplitudes: np.ndarray) -> np.ndarray:
        kept = np.where(seen, amplitudes * turn, np.nan)
        return np.concatenate([kept.real, -kept.imag[:, 1:]], axis=1)

    r = len(c.names)
    return spectra_of(
        model.rig,
        np.full(r, c.hz),
        np.sqrt(np.sum(np.abs(c.v1) ** 2, axis=1) / 2),
        {"v1": coefficients(c.v1), "v2": coefficients(c.v2)},
        {"v1": np.where(seen, c.v1_std, np.nan), "v2": np.where(seen, c.v2_std, np.nan)},
        source="silverbox",
    )


@dataclass(frozen=True, eq=False)
class Lines:
    """Reconstructed amplitudes of all records at the lines used, (r, lines); u at all harmonics, (r, H+1)."""

    T: np.ndarray
    T_std: np.ndarray
    u: np.ndarray
    energy: np.ndarray
    energy_std: np.ndarray


def whole(c: Circuit, model: Linear) -> Lines:
    """Reconstruct each record as what it is: one period with H harmonics."""
    found = reconstruct(model.rig, spectra(c, model))
    T, energy = found["friction"], found.energy_per_cycle
    return Lines(
        T.complex[:, c.used],
        T.coefficient_std[:, c.used],
        found["slip"].complex,
        energy.value,
        energy.std,
    )


def line_by_line(c: Circuit, model: Linear) -> Lines:
    """Reconstruct each line as a record with one harmonic: the circuit is linear beside T, so that lines are apart.

    The prior of `reconstruct` lets a record's harmonics fall like k^-1 at least, from at most ten times the largest:
    a multisine whose force peaks at harmonic 900 does not do that, and loses part of its force to the prior.
    """
    r, lines = len(c.names), int(c.used.sum())
    turn = model.undone(c.f)

    def of(amplitudes: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = (amplitudes * turn)[:, c.used].ravel()
        coefficients, by_harmonic = np.full((len(x), 3), np.nan), np.full((len(x), 2), np.nan)
        coefficients[:, 1], coefficients[:, 2], by_harmonic[:, 1] = x.real, -x.imag, std[:, c.used].ravel()
        return coefficients, by_harmonic

    (v1, v1_std), (v2, v2_std) = of(c.v1, c.v1_std), of(c.v2, c.v2_std)
    hz = np.tile(c.f[c.used], r)
    level = np.hypot(v1[:, 1], v1[:, 2])
    given = spectra_of(model.rig, hz, level, {"v1": v1, "v2": v2}, {"v1": v1_std, "v2": v2_std}, source="silverbox")
    found = reconstruct(model.rig, given)
    u = np.zeros((r, H + 1), dtype=complex)
    u[:, c.used] = found["slip"].complex[:, 1].reshape(r, lines)
    # a period of the record holds f / hz periods of a line
    share = np.tile(np.arange(H + 1)[c.used], (r, 1))
    energy = found.energy_per_cycle
    return Lines(
        found["friction"].complex[:, 1].reshape(r, lines),
        found["friction"].coefficient_std[:, 1].reshape(r, lines),
        u,
        np.sum(share * energy.value.reshape(r, lines), axis=1),
        np.sqrt(np.sum((share * energy.std.reshape(r, lines)) ** 2, axis=1)),
    )


@dataclass(frozen=True, eq=False)
class RestoringForce:
    """T = -(k_1 u + k_3 u^3 + k_5 u^5) of reconstructed harmonics; how much of held-out records it explains.

    `weighted` counts every harmonic in its standard deviations, `plain` in volts.
    """

    powers: tuple[int, ...]
    k: np.ndarray
    std: np.ndarray
    chi2: float
    weighted: float
    plain: float
    noise_plain: float

    def __call__(self, u: np.ndarray) -> np.ndarray:
        """T of u."""
        return -sum(k * u**n for k, n in zip(self.k, self.powers, strict=True))


def restoring(c: Circuit, found: Lines, powers: tuple[int, ...] = (1, 3, 5)) -> RestoringForce:
    """Fit the reconstructed force of the training records, score on the others."""
    T, std = found.T, found.T_std
    terms = -np.stack([power(found.u, n)[:, c.used] for n in powers], axis=2)
    train, held = c.train, c.held

    def real(x: np.ndarray, rows: slice) -> np.ndarray:
        scaled = x[rows] / (std[rows] if x.ndim == 2 else std[rows][..., None])
        flat = scaled.reshape(-1, *x.shape[2:])
        return np.concatenate([flat.real, flat.imag])

    A, y = real(terms, train), real(T, train)
    length = np.linalg.norm(A, axis=0)
    k = np.linalg.lstsq(A / length, y, rcond=None)[0] / length
    chi2 = float(np.sum((A @ k - y) ** 2) / (len(y) - len(k)))
    k_std = np.sqrt(np.diag(np.linalg.inv((A / length).T @ (A / length)))) / length * np.sqrt(max(chi2, 1.0))
    rest = T[held] - terms[held] @ k
    return RestoringForce(
        powers,
        k,
        k_std,
        chi2,
        1.0 - float(np.sum(np.abs(rest / std[held]) ** 2) / np.sum(np.abs(T[held] / std[held]) ** 2)),
        1.0 - float(np.sum(np.abs(rest) ** 2) / np.sum(np.abs(T[held]) ** 2)),
        1.0 - float(2 * np.sum(std[held] ** 2) / np.sum(np.abs(T[held]) ** 2)),
    )


def converted(c: Circuit, folder: Path) -> float:
    """Largest difference of harmonics 1..H_CHECKED through a CSV history from those of the set, over the largest."""
    periods = np.load(FOLDER / "multisine_periods.npz")
    given = [r for r in read_rows(FOLDER / "multisine_harmonics.csv") if int(r["harmonic"]) <= H_CHECKED]
    worst = 0.0
    for name in c.names:
        v1, v2 = (periods[f"{name}_{x}"].astype(float) for x in ("v1", "v2"))
        time = np.arange(len(v1)) / float(periods["sampling_hz"])
        file = write_history(folder / f"{name}.csv", time, {"v1_input": v1, "v2_output": v2})
        ours = harmonic_spectra(load_history(file), c.hz, H_CHECKED)
        for row in given:
            if row["record"] == name:
                k = int(row["harmonic"])
                mine = ours.coefficients[ours.channels.index(row["channel"])][[k, k + H_CHECKED]]
                worst = max(worst, float(np.abs(mine - [float(row["cos"]), float(row["sin"])]).max()))
    return worst / float(np.abs(c.v1).max())


def run() -> Finding:
    """Table, figure and conclusion."""
    c = circuit()
    with tempfile.TemporaryDirectory() as folder:
        difference = converted(c, Path(folder))
    models = [fit(c, n) for n in range(len(MODELS))]
    ways = {
        f"{MODELS[0]}, line by line": (models[0], line_by_line(c, models[0])),
        f"{MODELS[-1]} undone, line by line": (models[-1], line_by_line(c, models[-1])),
        f"{MODELS[-1]} undone, whole records": (models[-1], whole(c, models[-1])),
    }
    forces = {name: restoring(c, found) for name, (_, found) in ways.items()}
    rows = [
        (
            name,
            f"{np.sqrt(m.w2) / 2 / np.pi:.3f}",
            f"{m.d / 2 / np.sqrt(m.w2) * 100:.2f}",
            f"{m.chi2[c.held].mean():.2f}",
            with_std(forces[name].k[1], forces[name].std[1]),
            f"{forces[name].weighted:.5f}",
            f"{forces[name].plain:.4f}",
            f"{np.max(np.abs(found.energy / found.energy_std)):.1f}",
        )
        for name, (m, found) in ways.items()
    ]
    lag = -np.degrees(np.angle(models[-1].undone(np.array([68.0, 150.0, TOP]))))
    plain, best, _ = forces.values()
    head = ("filter", "f_0 [Hz]", "ζ [%]", "held-out χ²", "cubic [1/V²]", "weighted", "plain", "max |E|/std")
    return Finding(
        "silverbox_circuit",
        table(
            f"Silverbox: T reconstructed from {len(c.names)} records, explained on {c.held_out} held out "
            f"(conversion differs by {difference:.0e})",
            head,
            rows,
        ),
        _figure(c, [x for _, x in ways.values()][:2], [plain, best]),
        (
            f"T = -k_3 u^3 with k_3 = {with_std(best.k[1], best.std[1])} 1/V^2, hardening, explains "
            f"{best.weighted:.2%} of held-out records in units of std, {best.plain:.2%} in volts, no hysteresis.",
            f"{1 - plain.plain:.2%} is missing in volts with the filter ignored, {1 - best.plain:.2%} with it undone "
            f"(noise, at most: {1 - best.noise_plain:.1%}): its phase is {abs(lag[0]):.0f}, {abs(lag[1]):.0f} and "
            f"{abs(lag[2]):.0f} degrees off a delay at 68, 150 and 200 Hz. Whole records lose k_3 to the prior.",
        ),
    )


def _figure(c: Circuit, found: list[Lines], forces: list[RestoringForce]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.9), layout="constrained")
    axes = figure.subplots(1, 2)
    held = c.held
    measured = np.zeros_like(found[-1].u)
    measured[:, c.used] = found[-1].T
    said = np.where(
        c.used, -sum(k * power(found[-1].u, n) for k, n in zip(forces[-1].k, forces[-1].powers, strict=True)), 0
    )
    N = 1 << int(np.ceil(np.log2(4 * H)))
    shown = slice(0, int(0.25 * c.hz * N))
    time = np.arange(N)[shown] / (c.hz * N)
    looks = ((measured, "0.2", "-", "reconstructed"), (said, "C3", (0, (3, 2)), "$-k_1 u - k_3 u^3 - k_5 u^5$"))
    for x, color, style, label in looks:
        samples = np.fft.irfft(x[-1] * N / 2, N)[shown] * 1e3
        axes[0].plot(time, samples, color=color, linestyle=style, linewidth=1.1, label=label)
    dressed(axes[0], "Time [s], held-out record", "Nonlinear force [mV]")
    axes[0].annotate(
        "the record's ends\ndo not meet",
        (0.0, 2.3),
        (10, -2),
        textcoords="offset points",
        fontsize=SMALL,
        color="0.4",
        arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6},
    )
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.25 * (high - low))
    axes[0].legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="upper left", ncols=2, columnspacing=1.0)
    f, width = c.f[c.used], 40
    axes[1].semilogy(*_smooth(f, found[-1].T[held], width), color="0.2", linewidth=1.2, label="force")
    inks = {"left over, filter ignored": "C0", "left over, filter undone": "C3"}
    for x, force, (label, color) in zip(found, forces, inks.items(), strict=True):
        model = -sum(k * power(x.u[held], n)[:, c.used] for k, n in zip(force.k, force.powers, strict=True))
        axes[1].semilogy(*_smooth(f, x.T[held] - model, width), color=color, linewidth=1.2, label=label)
    noise = found[-1].T_std[held] * np.sqrt(2.0)
    axes[1].semilogy(*_smooth(f, noise, width), color=FAINT, linewidth=1.2, label="std of the reconstruction", zorder=0)
    dressed(axes[1], "Frequency [Hz]", "Amplitude [V]")
    legend_above(figure, axes[1])
    return figure


def _smooth(f: np.ndarray, amplitudes: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square over neighbouring lines and records."""
    n = len(f) // width * width
    square = np.mean(np.abs(amplitudes[:, :n]) ** 2, axis=0).reshape(-1, width)
    return f[:n].reshape(-1, width).mean(axis=1), np.sqrt(square.mean(axis=1))
