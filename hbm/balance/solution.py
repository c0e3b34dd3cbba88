"""One periodic solution in physical terms: channels with names and units.

:func:`describe` turns a solution of the harmonic balance into a :class:`PeriodicSolution` of :class:`Signal` objects.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hbm.balance.contactloss import contact_lost, joints_open
from hbm.balance.jointed import JointBalance
from hbm.balance.jointequations import JointEquations
from hbm.balance.problem import AnyBalance, HarmonicBalance, Kinematics, State
from hbm.channels import DISPLACEMENT, read
from hbm.errors import channel_named
from hbm.fourier import Array, FourierBasis
from models.display import Displayed
from models.parts import UNITS, Channel

WALKING = 1e-3
"""Mean force on a free body, relative to the excitation, from which on it walks and does not stay where it is."""

UNSOLVED = 1e-3
"""Share of a law's largest force that is open, at a sample or over a period, from which on a state is no motion."""


@dataclass(frozen=True)
class Signal:
    """One period of one quantity.

    Attributes
    ----------
    unit : str
        SI unit.
    coefficients : (2H+1,) array
        Fourier coefficients a_0, a_1..a_H, b_1..b_H.
    samples : (N_t,) array
        Values at the phases of the basis.
    peak : float
        Largest magnitude over the period; of the zero-mean signal for a slip, the maximum for a normal reaction.
    """

    unit: str
    coefficients: Array
    samples: Array
    peak: float

    def __repr__(self) -> str:
        """Peak and size."""
        return f"peak {self.peak:.6g} {self.unit}, {len(self.coefficients) // 2} harmonics, {len(self.samples)} samples"

    @property
    def amplitude(self) -> Array:
        """Amplitude of harmonics 0..H, (H+1,)."""
        return amplitudes(self.coefficients)

    @property
    def phase(self) -> Array:
        """Phase of harmonics 0..H against the force's cosine, (H+1,) [rad], negative for a lag."""
        return phases(self.coefficients)

    @property
    def rms(self) -> float:
        """Root mean square over the period."""
        return float(np.sqrt(np.mean(self.samples**2)))


class Series(Signal):
    """A signal that its coefficients tell whole; samples and peak are worked out when they are asked for."""

    _basis: FourierBasis

    def __init__(self, unit: str, coefficients: Array, basis: FourierBasis) -> None:
        self.__dict__.update(unit=unit, coefficients=coefficients, _basis=basis)

    @cached_property
    def samples(self) -> Array:
        """Values at the phases of the basis, (N_t,)."""
        return np.asarray(self._basis.samples(self.coefficients))

    @cached_property
    def peak(self) -> float:
        """Largest magnitude over the period."""
        return _smooth_peak(self.samples)


def amplitudes(coefficients: Array) -> Array:
    """Amplitude of each harmonic, (..., 2H+1) -> (..., H+1)."""
    H = coefficients.shape[-1] // 2
    out = np.abs(coefficients[..., : H + 1])
    out[..., 1:] = np.hypot(coefficients[..., 1 : H + 1], coefficients[..., H + 1 :])
    return out


def phases(coefficients: Array) -> Array:
    """Phase of each harmonic, negative for a lag, (..., 2H+1) -> (..., H+1) [rad]."""
    H = coefficients.shape[-1] // 2
    sines = np.zeros((*coefficients.shape[:-1], H + 1))
    sines[..., 1:] = coefficients[..., H + 1 :]
    return np.asarray(np.arctan2(-sines, coefficients[..., : H + 1]))


def _smooth_peak(samples: Array) -> float:
    """Largest magnitude of a smooth periodic signal, by a parabola through the three samples around it."""
    magnitude = np.abs(samples)
    i = int(magnitude.argmax())
    before, top, after = (float(magnitude[j]) for j in (i - 1, i, (i + 1) % len(samples)))
    bend = before + after - 2 * top
    return top - (after - before) ** 2 / (8 * bend) if bend < 0.0 else top


@dataclass(frozen=True, eq=False)
class PeriodicSolution(Displayed):
    """One steady state of a rig.

    Attributes
    ----------
    hz, level : float
        Excitation frequency [Hz] and force amplitude [N].
    basis : FourierBasis
        One period of the motion, which may be two of the force (:func:`hbm.response.branching.doubled`).
    state : State
        Modal and friction coefficients.
    channels : dict of str to Signal
        The rig's channels, `drive` (displacement at the excitation), `slip`, `slip_velocity`, `friction`, `normal`.
    memory : (states,) array
        Internal state of the friction law before the first sample.
    closure : float
        Change of the friction state over the period, relative to its range.
    energy_error : float
        Excitation work minus losses in damping, friction, elements and clamp over a period, relative to the work.
    unheld : float
        Mean force on a free body that nothing balances, relative to the excitation.
    conservative : tuple of str
        Joints that give back within the period all that they take, as springs and stops do.
    off : dict of str to float
        Share of the period for which contacts that may separate are open: "the tip", or "joint NAME".
    """

    hz: float
    level: float
    basis: FourierBasis
    state: State
    channels: Mapping[str, Signal]
    memory: Array
    closure: float
    energy_error: float
    unheld: float = 0.0
    conservative: tuple[str, ...] = ()
    off: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Say where it is, the peak of each channel, and what is not known of it."""
        head = (
            f"steady state at {self.hz:.6g} Hz, {self.level:g} N, H = {self.basis.H}, {self.basis.N_t} samples; peaks:"
        )
        width = max(len(name) for name in self.channels)
        peaks = (f"  {n:<{width}}  {s.peak:.6g} {s.unit}" for n, s in self.channels.items())
        judged = "numerical error and stability: not judged here, but by error_of(rig, it) and stability_of(rig, it)"
        return "\n".join([head, *peaks, *self._leaving, judged])

    @property
    def _leaving(self) -> list[str]:
        """What contacts that separate do, in words."""
        if self.lift_off:
            return ["the tip would lift off: the normal reaction turns negative; the model keeps it on its support"]
        return contact_lost([self.off])

    def __getitem__(self, name: str) -> Signal:
        """Channel by name."""
        return channel_named(self.channels, name)

    @property
    def periods(self) -> int:
        """Periods of the force that the motion takes to repeat."""
        return round(2 * np.pi * self.hz / self.state.Omega)

    @property
    def lift_off(self) -> bool:
        """Whether the normal reaction would turn negative: the tip leaves the support, the model does not.

        Joints that can separate do; for them it is never said.
        """
        return "normal" in self.channels and bool(self.channels["normal"].samples.min() < 0.0)

    @property
    def walks(self) -> bool:
        """Whether friction pushes a free body along: then this is no motion of it, for none is periodic."""
        return self.unheld > WALKING

    @property
    def unsolved(self) -> bool:
        """Whether a law is not solved at its samples, or its loop not closed: then this is no motion of the rig."""
        return not self.closure <= UNSOLVED

    @property
    def work_rate(self) -> float:
        """Wear work rate [W], the mean of R |v| over the period (26), v the velocity of the contact point itself.

        The paper prints R v, whose mean over a period can be zero where the contact slides; wear has no sign. Where the
        reaction would be negative the tip is off its support and does not wear.
        """
        return (
            self.state.Omega
            / (2 * np.pi)
            * path_work(np.abs, np.maximum(self["normal"].samples, 0.0), self["slip"].samples)
        )

    @property
    def friction_loss(self) -> float:
        """Energy that friction takes from the structure in one period [J], the area of the loop of T over the slip.

        Of a rig with joints, what all of them take that do not give it back: dashpots too, but no spring or stop.
        """
        if "friction" in self.channels:
            return self._taken([("friction", "slip")])
        return self._taken(self._ports)

    def taken(self, joint: str) -> float:
        """Energy that a joint takes from the body in one period [J], over all its ports; none if it is conservative.

        Raises
        ------
        KeyError
            With the joints that there are, if there is no such joint.
        """
        own = [ends for ends in self._ports if ends[0] == f"{joint}.force" or ends[0].startswith(f"{joint}.force.")]
        if not own:
            joints = dict.fromkeys(force.rpartition(".force")[0] for force, _ in self._ports)
            raise KeyError(f'no joint "{joint}"; there are {", ".join(joints) or "none"}')
        return self._taken(own)

    @property
    def motions(self) -> list[str]:
        """Channels of the motion at the contact, or at every port of every joint in order."""
        return ["slip"] if "friction" in self.channels else [motion for _, motion in self._ports]

    @property
    def _ports(self) -> list[tuple[str, str]]:
        """Channels of force and motion at every port of every joint."""
        named = [(name, name.replace(".force", ".motion")) for name in self.channels if ".force" in name]
        return [(force, motion) for force, motion in named if motion in self.channels]

    def _taken(self, ports: list[tuple[str, str]]) -> float:
        # the sampled loop of a conservative force has an area, that of the corners it cuts
        kept = {f"{joint}.force" for joint in self.conservative}
        lossy = [(self[force].samples, self[motion].samples) for force, motion in ports if force not in kept]
        return sum((-path_work(np.asarray, f, u) for f, u in lossy), 0.0)


def path_work(measure: Callable[[Array], Array], force: Array, slip: Array) -> float:
    """Sum of the force over the slip's steps, trapezoidal; from samples, so that a stuck contact does no work."""
    return float(0.5 * (force + np.roll(force, -1)) @ measure(np.roll(slip, -1) - slip))


def describe(problem: AnyBalance, x: Array, lam: float) -> PeriodicSolution:
    """Physical channels of a solution of the harmonic balance.

    Parameters
    ----------
    problem : HarmonicBalance or JointBalance
    x : (size,) array
        Scaled unknowns.
    lam : float
        Continuation parameter.

    Returns
    -------
    PeriodicSolution
    """
    state, hz = problem.unpack(x, lam), problem.hz_at(lam)
    return describe_joints(problem, state, hz) if isinstance(problem, JointBalance) else described(problem, state, hz)


def described(problem: HarmonicBalance, state: State, hz: float, kin: Kinematics | None = None) -> PeriodicSolution:
    """Channels of a state of a rig with one contact; with its kinematics where these are known."""
    kin, T, memory, closure = problem.contact_state(state, kin)
    rig, s, basis, Omega = problem.rig, problem.structure, problem.basis, state.Omega
    friction = Signal("N", basis.analysis @ T, T, float(np.abs(T).max()))
    modal_slip = kin.signals[:, 0] + problem.dynamic_lagrangian * state.T
    slip = modal_slip + s.compliance * friction.coefficients
    # the elastic part C T follows the force at every sample, beyond the harmonics kept
    slip_samples = basis.synthesis @ modal_slip + s.compliance * T
    normal = (basis.synthesis @ kin.signals[:, 2]) + (basis.synthesis @ kin.signals[:, 3]) * T
    if rig.contact.lift_off:
        tension = _unborne(problem, state)  # of which the balance knows the harmonics kept
        on_support = normal - basis.synthesis @ (basis.analysis @ tension)
        normal = np.where(tension > 0.0, 0.0, np.maximum(on_support, 0.0))

    force = state.F * problem.force_shape

    def motion(place: int, channel: Channel, row: Array, by_force: float, by_friction: float) -> Signal:
        coefficients = state.Q @ row + by_force * force + by_friction * friction.coefficients
        if problem.clamp is not None and kin.clamp is not None:
            coefficients += problem.clamp.port.residual[place] * kin.clamp.slid
        if problem.elements is not None and kin.elements is not None:
            coefficients += kin.elements @ problem.elements.static[:, place - 1]
        return Series(UNITS[channel.quantity], read(channel, basis, coefficients, Omega), basis)

    residual = s.residual
    places = {c.name: i for i, c in enumerate(rig.response_channels, start=2)}
    channels = {
        c.name: Series("N", force, basis)
        if c.quantity == "force"
        else motion(places[c.name], c, s.channel_rows[c.name], *residual.channels.get(c.name, (0.0, 0.0)))
        for c in rig.channels
    }
    channels |= {
        "drive": motion(1, DISPLACEMENT, s.excitation, residual.drive_by_force, residual.slip_by_force),
        "slip": Signal("m", slip, slip_samples, float(np.abs(slip_samples - slip_samples.mean()).max())),
        "slip_velocity": Series("m/s", Omega * basis.derivative(slip), basis),
        "friction": friction,
        "normal": Signal("N", basis.analysis @ normal, normal, float(normal.max())),
    }
    off = {"the tip": float(np.mean(normal <= 0.0))} if rig.contact.lift_off else {}
    energy = _energy_error(problem, state, kin, channels)
    return PeriodicSolution(hz, state.F, basis, state, channels, memory, closure, energy, off=off)


def _unborne(problem: HarmonicBalance, state: State) -> Array:
    """Tension that a tip off its support does not bear, (N_t,) [N]."""
    elements = problem.elements
    if elements is None:
        return np.zeros(problem.basis.N_t)
    forces = elements.in_time(state.Q, state.Omega, state.F * problem.force_shape)
    return np.asarray(forces[:, -1] * problem.rig.contact.normal_load / elements.weight[-1])


def _energy_error(problem: HarmonicBalance, state: State, kin: Kinematics, channels: Mapping[str, Signal]) -> float:
    """Excitation work minus losses over a period, relative to the largest of them."""
    basis, s, Omega, friction = problem.basis, problem.structure, state.Omega, channels["friction"].coefficients
    slip = kin.signals[:, 0] + problem.dynamic_lagrangian * state.T

    def work(force: Array, displacement: Array) -> float:
        # mean of s1 s2' over the period from the coefficients, times the period
        return float(np.pi * np.vdot(force[1:], basis.derivative(displacement)[1:]))

    supplied = work(state.F * problem.force_shape, channels["drive"].coefficients)
    velocity = Omega * basis.derivative(state.Q)
    damped = float(np.pi / Omega * np.sum(s.damping * velocity[1:] ** 2))
    rubbed = -work(friction, slip)
    taken = 0.0
    if problem.elements is not None and kin.elements is not None:
        taken = -work(kin.elements, problem.elements.read(state.Q, state.F * problem.force_shape))
    taken += 0.0 if kin.clamp is None else kin.clamp.taken
    largest = max(abs(supplied), damped, abs(rubbed), abs(taken), np.finfo(float).tiny)
    return (supplied - damped - rubbed - taken) / largest


def describe_joints(
    problem: JointEquations, state: State, hz: float, signals: list[Array] | None = None
) -> PeriodicSolution:
    """Channels of a state of a rig with joints, whose signals may be known: its own, the drive, and those of ports."""
    rig, s, basis, Omega = problem.rig, problem.structure, problem.basis, state.Omega
    signals = problem.signals(state) if signals is None else signals
    found, memory, closure = problem.forces(state, signals)
    f, F = basis.coefficients(found), state.F * problem.force_shape
    own = state.Q @ s.channels.T + f @ s.channels_by_joints.T + np.outer(F, s.channels_by_force)
    moved = dict(zip((c.name for c in rig.response_channels), own.T, strict=True))
    channels: dict[str, Signal] = {
        c.name: Series("N", F, basis)
        if c.quantity == "force"
        else Series(UNITS[c.quantity], read(c, basis, moved[c.name], Omega), basis)
        for c in rig.channels
    }
    channels["drive"] = Series("m", state.Q @ s.excitation + f @ s.flexibility_to_force + s.drive_by_force * F, basis)
    shown = [u for j, seen in zip(problem.joints, signals, strict=True) for u in seen[:, : j.ports].T]
    kept = np.where(problem.own > 0.0, np.minimum(problem.own, s.flexibility.diagonal()), 0.0)
    for i, (name, force, (unit, unit_of_force)) in enumerate(zip(rig.motions, rig.forces, rig.units, strict=True)):
        # a compliance of the body that its law takes into account follows the force beyond the harmonics kept; one that
        # was lent does not
        samples = basis.samples(shown[i] + (problem.own[i] - kept[i]) * state.T[:, i]) + kept[i] * found[:, i]
        moved_by = shown[i] + problem.own[i] * state.T[:, i]
        channels[name] = Signal(unit, moved_by, samples, float(np.abs(samples).max()))
        channels[force] = Signal(unit_of_force, f[:, i], found[:, i], float(np.abs(found[:, i]).max()))
    energy = _joint_energy_error(problem, state, channels)
    unheld = float(np.abs(problem.held_adrift(state)).max(initial=0.0)) / problem.modal_force_ref
    conservative = tuple(j.name for j, law in zip(rig.joints, problem.joints, strict=True) if law.conservative)
    off = joints_open(rig.joints, problem.slices, found)
    return PeriodicSolution(hz, state.F, basis, state, channels, memory, closure, energy, unheld, conservative, off)


def _joint_energy_error(problem: JointEquations, state: State, channels: Mapping[str, Signal]) -> float:
    """Excitation work minus losses over a period, relative to the largest of them."""
    basis, rig, Omega = problem.basis, problem.rig, state.Omega

    def work(force: Array, displacement: Array) -> float:
        return float(np.pi * np.vdot(force[1:], basis.derivative(displacement)[1:]))

    velocity = Omega * basis.derivative(state.Q)[1:]
    supplied = work(state.F * problem.force_shape, channels["drive"].coefficients)
    damped = float(np.pi / Omega * np.sum((velocity @ problem.structure.damping) * velocity))
    taken = [
        -work(channels[force].coefficients, channels[name].coefficients)
        for name, force in zip(rig.motions, rig.forces, strict=True)
    ]
    largest = max(abs(supplied), damped, *map(abs, taken), np.finfo(float).tiny)
    return (supplied - damped - sum(taken)) / largest
