"""What the beam does with the Stribeck law of Table 3, where no stable period-1 motion is found.

At every frequency the rig is marched from rest, first with ten times its damping (alpha 0.6 1/s, so that transients
are gone after 25 s), then on from there with its own (alpha 0.06 1/s, 30 s). The end of each march is looked at once a
period (Poincare section) and between the harmonics, and a second march started beside it tells by how much neighbours
part (largest Lyapunov exponent). Harmonic balance and shooting look for the period-1 motion and its multipliers.

The model does not lift off: where R turns negative the motion is no prediction.

Run: python benchmarks/stribeck_motion.py
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from continuation import ConvergenceError
from hbm.balance.solution import PeriodicSolution
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.history import State, TimeHistory
from hbm.integration.integrate import PeriodicMotion, simulate
from hbm.integration.integrate import steady_state as shoot
from hbm.response.trace import steady_state
from models import Damping, FrictionLaw, Rig
from models.published import PAPER_FIGURE_9C, PAPER_STRIBECK, paper_rig

FREQUENCIES = np.arange(44.0, 62.01, 1.0)
STEPS = 1024  # per period
MARCHES = ((0.6, 25.0), (0.06, 30.0))  # alpha [1/s], duration [s]
KEPT, SAMPLES = 128, 256  # periods looked at, samples per period that are kept
HARMONICS = 21
PERIODIC = 1e-3  # largest change of the state over n periods, relative to its largest value
PARTING = 0.02  # Lyapunov exponent per period that 150 periods tell from zero
DISTANCE = 1e-7  # of the neighbour, relative to the state


def rig_with(damping: Damping, modes: int = 5, law: FrictionLaw = PAPER_STRIBECK) -> Rig:
    """Return the paper's rig with a falling friction law."""
    return replace(paper_rig(law), damping=damping, channels=()).with_modes(modes)


@dataclass(frozen=True)
class Motion:
    """The last `KEPT` periods of a march."""

    history: TimeHistory

    @property
    def section(self) -> np.ndarray:
        """Modal displacements and velocities once a period, relative to the largest of each kind, (periods, 2n)."""
        h = self.history
        once = slice(1, None, h.samples_per_period)
        return np.hstack([h.q[once] / np.abs(h.q).max(), h.qdot[once] / np.abs(h.qdot).max()])

    def change(self, periods: int) -> float:
        """Largest change of the section over a number of periods."""
        section = self.section
        return float(np.abs(section[periods:] - section[:-periods]).max())

    def between(self, channel: str) -> tuple[float, float]:
        """Share of a channel's variance that is not at harmonics of the excitation, and its strongest line [Hz]."""
        signal = self.history.channels[channel].values[1:]
        power = np.abs(np.fft.rfft(signal - signal.mean())) ** 2
        total = power.sum()
        power[::KEPT] = 0.0
        return float(power.sum() / total), float(power.argmax() * self.history.hz / KEPT)

    @property
    def period(self) -> int | None:
        """Smallest number of periods after which the motion repeats, up to 8."""
        return next((n for n in range(1, 9) if self.change(n) < PERIODIC), None)


def in_words(motion: Motion, exponent: float | None = None) -> str:
    """Name of a motion."""
    lifts = ", lift-off" if motion.history.channels["normal"].values.min() < 0.0 else ""
    if motion.period is not None:
        return f"period {motion.period}{lifts}"
    if exponent is None:
        return f"not periodic{lifts}"
    return ("chaotic" if exponent > PARTING else "quasi-periodic") + lifts


def march(rig: Rig, hz: float, duration: float, start: State | None = None, steps: int = STEPS) -> Motion:
    """March and keep the end."""
    periods, every = round(duration * hz), steps // SAMPLES
    return Motion(
        simulate(rig, hz, duration=periods / hz, start=start, steps_per_period=steps, last_periods=KEPT, every=every)
    )


def lyapunov(rig: Rig, hz: float, start: State, periods: int = 150, settle: int = 50) -> float:
    """Largest Lyapunov exponent [1/period], by two marches whose distance is reset every period (Benettin)."""
    omega = rig.structure.omega_n

    def distance(a: State, b: State) -> float:
        return float(np.linalg.norm(np.concatenate([omega * (a.q - b.q), a.qdot - b.qdot])))

    gap = DISTANCE * float(np.linalg.norm(np.concatenate([omega * start.q, start.qdot])))
    a, b = start, replace(start, qdot=start.qdot + gap / np.sqrt(rig.structure.n))
    grown = []
    for _ in range(settle + periods):
        a, b = (
            simulate(rig, hz, duration=1 / hz, start=s, steps_per_period=STEPS, last_periods=1).state for s in (a, b)
        )
        apart = max(distance(a, b), 1e-6 * gap)
        grown.append(np.log(apart / gap))
        b = State.from_flat(a.flat + (b.flat - a.flat) * gap / apart, rig.structure.n, a.time)
    return float(np.mean(grown[settle:]))


def sliding(rig: Rig, history: TimeHistory) -> np.ndarray:
    """Where the contact slides: where the slip behind its tangential spring moves, (samples,)."""
    law, P = rig.contact.law, rig.contact.normal_load
    anchor = history.channels["slip"].values + history.friction * law.critical_slip / (law.mu_static * P)
    return np.abs(np.gradient(anchor)) > 1e-12


def phases(rig: Rig, history: TimeHistory) -> float:
    """Sliding phases per period."""
    slides = sliding(rig, history).astype(int)
    return float(np.sum(np.diff(slides) == 1)) / KEPT


def growth(rig: Rig, history: TimeHistory) -> np.ndarray:
    """Mean growth rate of every mode from friction that falls with speed, less its damping, (n,) [1/s].

    While it slides at speed v a mode with du/dq = c grows with -(c^2 / 2) R dmu/dv.
    """
    s, law = rig.structure, rig.contact.law
    x = np.abs(history.channels["slip_velocity"].values - s.compliance * history.friction_rate) / law.stribeck_velocity
    falls = (law.mu_static - law.mu) * law.exponent / law.stribeck_velocity * x ** (law.exponent - 1)
    rate = history.channels["normal"].values * falls * np.exp(-(x**law.exponent)) * sliding(rig, history)
    return s.slip_row**2 / 2 * rate.mean() - s.damping / 2


def balanced(rig: Rig, hz: float, near: PeriodicSolution | None) -> PeriodicSolution | None:
    """Period-1 motion by harmonic balance, from a neighbour or from nothing."""
    for start in (near, None):
        try:
            return steady_state(rig, hz, harmonics=HARMONICS, start=start)
        except ConvergenceError:
            continue
    return None


def period_one(rig: Rig, hz: float, starts: Iterable[State]) -> PeriodicMotion | None:
    """Period-1 motion by shooting; the least unstable one found."""
    found = []
    for start in starts:
        try:
            motion = shoot(rig, hz, start=start, steps_per_period=STEPS)
        except ArithmeticError:
            continue
        found += [motion] if motion.converged else []
    return min(found, key=lambda motion: abs(motion.multipliers[0]), default=None)


def multiplier(motion: PeriodicMotion | None) -> str:
    """Largest multiplier of a period-1 motion in words."""
    if motion is None:
        return "none found"
    largest = motion.multipliers[0]
    return f"{abs(largest):.3f} at {abs(np.degrees(np.angle(largest))):.0f}°"


def motions(alpha: float, duration: float, starts: dict[float, State]) -> Table:
    """One line per frequency; `starts` holds where to begin and takes where the march ended."""
    table = Table(
        "Hz",
        "motion",
        "drive\nmm",
        "change over\na period",
        "exponent\n1/period",
        "between harmonics\ndrive / slip",
        "strongest\nline, Hz",
        "sliding phases\nper period",
        "growth of modes\n1 / 5, 1/s",
        "least R\nN",
        "period 1:\nbalance",
        "shooting,\nmultiplier",
        title=f"Stribeck law of Table 3, 6.5 N, alpha {alpha:g} 1/s, {duration:g} s",
    )
    rig, near = rig_with(Damping(mass_proportional=alpha)), None
    for hz in FREQUENCIES.tolist():
        motion = march(rig, hz, duration, starts.get(hz))
        history, channels = motion.history, motion.history.channels
        starts[hz] = replace(history.state, time=0.0)  # whole periods have passed
        exponent = lyapunov(rig, hz, starts[hz])
        solution = balanced(rig, hz, near)
        near = solution or near
        one = period_one(rig, hz, [starts[hz]] + ([state_at_phase_zero(solution)] if solution else []))
        rates, (share, line) = growth(rig, history), motion.between("slip")
        table.add_row(
            f"{hz:g}",
            in_words(motion, exponent),
            f"{1e3 * np.abs(channels['drive'].values).max():.4f}",
            f"{motion.change(1):.1e}",
            f"{exponent:+.3f}",
            f"{motion.between('drive')[0]:.1e} / {share:.1e}",
            "" if motion.period == 1 else f"{line:.1f}",
            f"{phases(rig, history):.1f}",
            f"{rates[0]:+.1f} / {rates[4]:+.0f}",
            f"{channels['normal'].values.min():.0f}",
            "found" if solution else "not found",
            multiplier(one),
        )
    return table


def described(motion: Motion) -> tuple[str, ...]:
    """Its name, drive displacement, what is between harmonics, and where."""
    share, line = motion.between("slip")
    peak = 1e3 * np.abs(motion.history.channels["drive"].values).max()
    return in_words(motion), f"{peak:.4f}", f"{share:.1e}", "" if motion.period == 1 else f"{line:.1f}"


# what is varied, damping, modes, steps per period
VARIANTS = (
    ("as above", Damping(mass_proportional=0.6), 5, STEPS),
    ("4 times the steps", Damping(mass_proportional=0.6), 5, 4 * STEPS),
    ("8 modes, 6 to 8 with 2 %", Damping(mass_proportional=0.6), 8, 4 * STEPS),
    ("2 % from mode 5", Damping(mass_proportional=0.6, high_mode_from=5), 5, STEPS),
    ("2 % from mode 3", Damping(mass_proportional=0.6, high_mode_from=3), 5, STEPS),
    ("1 % on every mode", Damping(modal_ratios=(0.01,) * 5), 5, STEPS),
    ("12 modes, alpha alone", Damping(mass_proportional=0.6, high_mode_ratio=0.0), 12, 4 * STEPS),
)


def variants() -> Table:
    """The same motions with a finer step, other modes, and other damping of the upper modes."""
    table = Table(
        "Hz",
        "what",
        "motion",
        "drive\nmm",
        "between harmonics\nof the slip",
        "strongest\nline, Hz",
        title="Variants, 10 s",
    )
    for hz in (44.0, 53.0, 57.0):
        for what, damping, modes, steps in VARIANTS:
            motion = march(rig_with(damping, modes), hz, 10.0, steps=steps)
            table.add_row(f"{hz:g}", what, *described(motion))
    return table


def figure_9c() -> Table:
    """The decay law of the paper's Figure 9c, with two dampings."""
    title = "Decay law of Figure 9c, 10 s"
    table = Table(
        "Hz", "damping", "motion", "drive\nmm", "between harmonics\nof the slip", "strongest\nline, Hz", title=title
    )
    dampings = {"alpha 0.6 1/s": Damping(mass_proportional=0.6), "1 % on every mode": Damping(modal_ratios=(0.01,) * 5)}
    for hz in (46.0, 50.0, 53.0, 57.0):
        for what, damping in dampings.items():
            motion = march(rig_with(damping, law=PAPER_FIGURE_9C), hz, 10.0)
            table.add_row(f"{hz:g}", what, *described(motion))
    return table


def main() -> None:
    """March, print."""
    for table in (variants(), figure_9c()):
        Console().print(table)
    starts: dict[float, State] = {}
    for alpha, duration in MARCHES:
        Console().print(motions(alpha, duration, starts))


if __name__ == "__main__":
    main()
