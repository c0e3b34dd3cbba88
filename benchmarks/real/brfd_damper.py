"""A band-brake friction device under imposed displacement: friction laws from measured loops, no reconstruction needed.

With a constant R = 1 N a law's friction coefficient is its limit in N. Laws are fitted to harmonics 0..25 of the
force, beside a viscous part and a constant: the constant is the difference between forward and backward limits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group
from rich.table import Table
from scipy.optimize import least_squares

from hbm import identify as identify_laws
from hbm.figures.style import INK, SMALL, WIDTH, dressed
from hbm.fourier import coefficients_of
from hbm.inverse.contactforce import to_samples
from hbm.inverse.reconstruction import SIGNALS, EstimatedSignal, Estimates, LawInputs, Misfit, Reconstruction
from hbm.measurement.spectra import spectra_of
from hbm.response.loop import friction_loop
from models.friction import Dahl, FrictionLaw, Iwan, Jenkins
from models.friction.law import parameters
from models.parts import Channel, Contact, Damping, Excitation, ModalBody
from models.rig import Rig

from .common import DATA, Finding, legend_above, read_rows, table, with_std

FOLDER = DATA / "brfd_friction_damper"
H = 25
SAMPLES = 512
LAWS: dict[str, FrictionLaw] = {
    "coulomb-penalty": Jenkins(mu=1.0, critical_slip=1.0),
    "dahl": Dahl(mu=1.0, stiffness=1.0),
    "iwan": Iwan(mu=1.0, stiffness=1.0, spread=0.5),
}
SHOWN = ("BRFD1_0.5Hz_35lb_1in", "BRFD3_0.5Hz_30lb_1.5in", "BRFD2_0.25Hz_36lb_1in")
SET_UP = "BRFD3"
"""All loops of it have one nominal tension."""
RIGID_HZ = 1e4
FITTED_HZ = 1.0
"""Faster loops carry inertia and an actuator at its limit; loops with chatter stay in."""


@dataclass(frozen=True, eq=False)
class Loop:
    """One test: displacement and force, coefficients a_0, a_1..a_H, b_1..b_H, std of each by harmonic."""

    name: str
    hz: float
    x: np.ndarray
    x_std: np.ndarray
    F: np.ndarray
    F_std: np.ndarray
    given: dict[str, str]

    @property
    def energy(self) -> tuple[float, float]:
        """Energy per cycle of the harmonics with its standard deviation [J]."""
        k = np.arange(1, H + 1)
        (xc, xs), (Fc, Fs) = (np.split(c[1:], 2) for c in (self.x, self.F))
        value = np.pi * np.sum(k * (Fc * xs - Fs * xc))
        of_F, of_x = (xc**2 + xs**2) * self.F_std[1:] ** 2, (Fc**2 + Fs**2) * self.x_std[1:] ** 2
        return float(value), float(np.pi * np.sqrt(np.sum(k**2 * (of_F + of_x))))

    @property
    def of_table(self) -> tuple[float, float]:
        """Energy per cycle of the set's table, integrated over the samples, with its standard deviation [J]."""
        return float(self.given["energy_per_cycle_j"]), float(self.given["energy_std_j"])

    @property
    def limits(self) -> tuple[float, float]:
        """Median force while moving fast forward and backward, of the table [N]."""
        return float(self.given["median_force_forward_n"]), float(self.given["median_force_backward_n"])

    @property
    def sound(self) -> bool:
        """Whether the source trusts its band tension, and the displacement is slow and a sine."""
        others = np.hypot(*np.split(self.x[1:], 2))[1:]
        pure = np.linalg.norm(others) < 0.02 * np.hypot(self.x[1], self.x[H + 1])
        return self.given["band_tension_suspect"] == "0" and self.hz <= FITTED_HZ and bool(pure)


@cache
def loops() -> tuple[Loop, ...]:
    """All tests."""
    rows = read_rows(FOLDER / "loop_harmonics.csv")
    return tuple(
        _loop(entry, [r for r in rows if r["record"] == entry["loop"]])
        for entry in read_rows(FOLDER / "loop_table.csv")
    )


def _loop(entry: dict[str, str], rows: list[dict[str, str]]) -> Loop:
    def of(channel: str) -> tuple[np.ndarray, np.ndarray]:
        coefficients, std = np.zeros(2 * H + 1), np.zeros(H + 1)
        for r in rows:
            if r["channel"] == channel:
                k = int(r["harmonic"])
                coefficients[k], std[k] = float(r["cos"]), float(r["std"])
                if k:
                    coefficients[H + k] = float(r["sin"])
        return coefficients, std

    return Loop(entry["loop"], float(entry["frequency_hz"]), *of("displacement"), *of("force"), entry)


@dataclass(frozen=True, eq=False)
class Identified:
    """A law of one loop: its parameters, viscous coefficient [N s/m], constant [N], and what it leaves over.

    `left` is the root mean square over that of the force, of harmonics 0..25.
    """

    law: FrictionLaw
    viscous: float
    constant: float
    left: float
    force: np.ndarray


def identify(loop: Loop, name: str) -> Identified:
    """Fit one law to one loop, all harmonics alike."""
    amplitude = float(np.hypot(loop.x[1], loop.x[H + 1]))
    limit = float(np.mean(np.abs(loop.limits)))
    start = [0.0, np.log(0.05)] + ([0.0] if name == "iwan" else [])

    def law(p: np.ndarray) -> FrictionLaw:
        mu, slip = limit * np.exp(p[0]), amplitude * np.exp(p[1])
        if name == "coulomb-penalty":
            return replace(LAWS[name], mu=mu, critical_slip=slip)
        spread = {"spread": 1 / (1 + np.exp(-p[2]))} if name == "iwan" else {}
        return replace(LAWS[name], mu=mu, stiffness=mu / slip, **spread)

    def force(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        seen = friction_loop(law(p), loop.x, loop.hz, load=1.0, samples=SAMPLES)
        A = np.column_stack([_harmonics(seen.v), _harmonics(np.ones(SAMPLES))])
        dry = _harmonics(-seen.T)
        linear = np.linalg.lstsq(A, loop.F - dry, rcond=None)[0]
        return dry + A @ linear, linear, seen.v

    weight = np.where(np.arange(2 * H + 1) == 0, 1.0, np.sqrt(0.5)) / limit
    fit = least_squares(
        lambda p: (force(p)[0] - loop.F) * weight, start, bounds=([-2, -9, -4][: len(start)], [2, 0, 4][: len(start)])
    )
    modelled, linear, _ = force(fit.x)
    left = np.linalg.norm((modelled - loop.F) * weight) / np.linalg.norm(loop.F * weight)
    return Identified(law(fit.x), float(linear[0]), float(linear[1]), float(left), modelled)


def _harmonics(samples: np.ndarray) -> np.ndarray:
    """Coefficients a_0, a_1..a_H, b_1..b_H of samples of a period."""
    c = np.fft.rfft(samples)[: H + 1] * 2 / len(samples)
    return np.concatenate([[c[0].real / 2], c[1:].real, -c[1:].imag])


def measured(chosen: Sequence[Loop]) -> Reconstruction:
    """Loops as `hbm.identification` takes them: contact signals that were measured, not reconstructed.

    The structure is a mode so stiff that the force moves nothing, R is 1 N, and slip and force have the standard
    deviations of the set.
    """
    rig = Rig(
        "friction damper",
        ModalBody((RIGID_HZ,), ((1.0,),), (1.0,), (1.0,)),
        Damping(modal_ratios=(0.01,)),
        Contact(1.0, Jenkins(mu=1e4, critical_slip=1e-3)),
        Excitation(1.0),
        (Channel("x", "displacement"),),
    )
    n, hz = len(chosen), np.array([x.hz for x in chosen])
    x_std, F_std = np.array([x.x_std for x in chosen]), np.array([x.F_std for x in chosen])
    given = spectra_of(rig, hz, np.ones(n), {"x": np.array([x.x for x in chosen])}, {"x": x_std}, source="loops")
    u, T = given.complex("x"), -np.array([_complex(x.F) for x in chosen])
    i_omega = 2j * np.pi * hz[:, None] * np.arange(H + 1)
    one, energy = np.zeros((n, H + 1), dtype=complex), np.array([x.energy for x in chosen])
    one[:, 0] = 1.0
    factor = np.zeros((n, H + 1, 4, 2), dtype=complex)
    factor[:, :, 0, 0], factor[:, :, 1, 1] = F_std, x_std

    def signal(name: str, amplitudes: np.ndarray, std: np.ndarray) -> EstimatedSignal:
        samples = to_samples(amplitudes, SAMPLES)
        return EstimatedSignal(SIGNALS[name], coefficients_of(amplitudes), std, samples, np.zeros_like(samples))

    return Reconstruction(
        rig=rig,
        spectra=given,
        formulation="measured",
        signals={
            "slip": signal("slip", u, x_std),
            "slip_velocity": signal("slip_velocity", i_omega * u, np.abs(i_omega) * x_std),
            "friction": signal("friction", T, F_std),
            "normal": signal("normal", one, np.zeros((n, H + 1))),
        },
        slips=np.ones(n, dtype=bool),
        energy_per_cycle=Estimates(energy[:, 0], energy[:, 1], "J"),
        work_rate=Estimates(energy[:, 0] * hz, energy[:, 1] * hz, "W"),
        misfit=Misfit(("x",), np.ones((n, 1)), np.ones((n, 1))),
        resolution=F_std,
        condition=np.ones((n, H + 1)),
        law_inputs=LawInputs(u, one, np.zeros((n, H + 1), dtype=complex), factor),
        warnings=(),
    )


def _complex(coefficients: np.ndarray) -> np.ndarray:
    """Amplitudes 0..H of coefficients a_0, a_1..a_H, b_1..b_H."""
    turning = coefficients[1 : H + 1] - 1j * coefficients[H + 1 :]
    return np.concatenate([[complex(coefficients[0])], turning])


def together() -> Table:
    """One law for all loops of a set-up, by the project's own identification."""
    chosen = [x for x in loops() if x.sound and x.name.startswith(SET_UP)]
    seen = measured(chosen)
    found = identify_laws(seen.rig, seen, tuple(LAWS))
    rows = []
    for name, fit in found.fits.items():
        mu, held = fit.parameters["mu"], fit.held_out
        assert held is not None
        rows.append((name, with_std(mu.value, mu.std, 1e-3), f"{held.relative_error:.1%}", f"{fit.chi2.mean():.2g}"))
    title = f"One law for all {len(chosen)} loops of set-up {SET_UP}, hbm.identification; best: {found.best.name}"
    return table(title, ("law", "limit, kN", "left over, held out", "chi2 a loop"), rows)


def run() -> Finding:
    """Table, figure and conclusion."""
    every = loops()
    fitted = [x for x in every if x.sound]
    found = {x.name: {name: identify(x, name) for name in LAWS} for x in fitted}
    apart = np.array([(x.energy[0] - x.of_table[0]) / x.of_table[1] for x in every])
    relative = np.array([x.energy[0] / x.of_table[0] - 1.0 for x in every])
    rows = []
    for x in fitted:
        best = found[x.name]["iwan"]
        ratio, table_ratio = _asymmetry(best), -x.limits[0] / x.limits[1]
        rows.append(
            (
                x.name,
                with_std(*x.energy),
                with_std(*x.of_table),
                *(f"{found[x.name][name].left:.1%}" for name in LAWS),
                f"{parameters(best.law)['mu'] / 1e3:.2f}",
                f"{ratio:.3f}",
                f"{table_ratio:.3f}",
            )
        )
    left = {name: np.median([found[x.name][name].left for x in fitted]) for name in LAWS}
    ratios = np.array([(_asymmetry(found[x.name]["iwan"]), -x.limits[0] / x.limits[1]) for x in fitted])
    head = ("loop", "E [J]", "table", *(f"{name}" for name in LAWS), "limit, kN", "F+/F-", "table")
    return Finding(
        "brfd_friction_damper",
        Group(
            table("Friction damper: energy per cycle, force left over by each law, asymmetry", head, rows), together()
        ),
        _figure([next(x for x in every if x.name == name) for name in SHOWN], found),
        (
            f"Energy from harmonics differs from the table by {np.abs(relative).max():.1e} at most, "
            f"{np.abs(apart).max():.2f} of its std, in {len(every)} loops; forward over backward limit is "
            f"{ratios[:, 0].min():.2f} to {ratios[:, 0].max():.2f} (table: {ratios[:, 1].min():.2f} to "
            f"{ratios[:, 1].max():.2f}).",
            "Left over on the median of "
            + f"{len(fitted)} loops: "
            + ", ".join(f"{name} {value:.0%}" for name, value in left.items())
            + "; what is left is backlash (the force rests near zero after each turn), a peak at breakaway, chatter.",
        ),
    )


def _asymmetry(found: Identified) -> float:
    """Forward over backward limit."""
    mu = parameters(found.law)["mu"]
    return (mu + found.constant) / (mu - found.constant)


def _figure(shown: list[Loop], found: dict[str, dict[str, Identified]]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.7), layout="constrained")
    axes = figure.subplots(1, len(shown))
    samples = read_rows(FOLDER / "hysteresis_loops.csv")
    inks = dict(zip(LAWS, (("C0", "-"), ("C2", (0, (4, 2))), ("C3", "-")), strict=True))
    theta = 2 * np.pi * np.arange(SAMPLES + 1) / SAMPLES
    k = np.arange(1, H + 1)
    rows = np.hstack([np.ones((len(theta), 1)), np.cos(np.outer(theta, k)), np.sin(np.outer(theta, k))])
    for ax, loop in zip(axes, shown, strict=True):
        mine = [r for r in samples if r["loop"] == loop.name]
        x, F = (np.array([float(r[c]) for r in mine]) for c in ("displacement_m", "force_n"))
        ax.plot(x * 1e3, F * 1e-3, color="0.7", linewidth=0.9, label="measured, three cycles")
        for name, (color, style) in inks.items():
            if name != "dahl":
                force = rows @ found[loop.name][name].force
                ax.plot(rows @ loop.x * 1e3, force * 1e-3, color=color, linestyle=style, linewidth=1.1, label=name)
        ax.set_title(loop.name.replace("_", ", "), fontsize=SMALL, color=INK)
        dressed(ax, "Displacement [mm]", "")
    axes[0].set_ylabel("Force [kN]", color=INK)
    legend_above(figure, axes[0])
    return figure
