"""Measured records beside the steady states a rig predicts for them: forces turned to cosines, and where Newton starts.

What fits to spectra share, whatever they fit: a :class:`Measurement` of :class:`Record` objects, and
:func:`solve_record`, which finds the steady state of one on the branch it was measured on.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from continuation import ConvergenceError, Correction, NewtonSettings, solve_at
from hbm.balance.problem import TOLERANCE, AnyBalance, State, balance_of
from hbm.balance.solution import PeriodicSolution, describe
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from hbm.inverse.observed import motion_of
from hbm.inverse.reconstruction import Reconstruction
from hbm.inverse.sensing import Complex, Readings, Sensing
from hbm.response.liftoff import solve_lifting
from hbm.response.start import first_solution
from models.jointed import AnyRig


@dataclass(frozen=True, eq=False)
class Record:
    """One record of c channels and harmonics 1..H, turned so that its force is a cosine.

    Attributes
    ----------
    number : int
    name : str
        As in the file.
    hz, force, force_std : float
        Frequency [Hz], amplitude of the force [N] and standard deviation of each of its cos and sin.
    measured : (2, c, H) array
        Real and imaginary part of the amplitudes, nan where not measured.
    std : (c, H) or (2, c, H) array
        Standard deviation of each of them, alike for both parts or not.
    start : State
        Motion by the reconstruction.
    distortion : (2, H-1) array
        Coefficients of cos and sin of harmonics 2..H of the force [N], nan where not measured.
    distortion_std : (H-1,) array
        Standard deviation of each of them, nan where not measured.
    level : float
        As in the file.
    """

    number: int
    name: str
    hz: float
    force: float
    force_std: float
    measured: Array
    std: Array
    start: State
    distortion: Array
    distortion_std: Array
    level: float

    @property
    def listed(self) -> npt.NDArray[np.bool_]:
        """Whether each amplitude was measured, (2, c, H)."""
        return np.isfinite(self.measured)

    @property
    def tones(self) -> tuple[tuple[int, float, float], ...]:
        """Harmonics of the force that were measured, as :class:`models.parts.Excitation` has them."""
        found = np.flatnonzero(np.isfinite(self.distortion_std))
        ratios = (self.distortion[:, found] / self.force).T.tolist()
        return tuple((int(i) + 2, cosine, sine) for i, (cosine, sine) in zip(found, ratios, strict=True))

    def force_on(self, rig: AnyRig) -> float:
        """Amplitude of the force on a rig: it may differ from what was measured in its place [N]."""
        return self.force * rig.excitation.gain(self.level)

    def rig(self, rig: AnyRig) -> AnyRig:
        """A rig as it is in this record: what drifts, and the harmonics of the force where the rig minds them.

        Raises
        ------
        ValueError
            As :meth:`models.numbers.Numbered.at_record`.
        """
        rig = rig.at_record(self.number)
        if not rig.excitation.measured_harmonics:
            return rig
        return replace(rig, excitation=replace(rig.excitation, harmonics=self.tones))


@dataclass(frozen=True, eq=False)
class Measurement:
    """Records of the same channels and harmonics; `speed` (r,) is the largest slip velocity of each [m/s].

    Of a rig with joints it is any measure of how fast they move, the fastest the largest. `other_unit` is whether force
    and responses of a rig with one contact agree in another unit of either alone.
    """

    records: tuple[Record, ...]
    channels: tuple[str, ...]
    H: int
    speed: Array
    other_unit: bool = False

    @property
    def distorted(self) -> float | None:
        """Largest of the harmonics 2..H of the force, in standard deviations; None where none was measured."""
        sizes = np.concatenate([np.hypot(*r.distortion) / r.distortion_std for r in self.records])
        return float(np.nanmax(sizes)) if np.isfinite(sizes).any() else None


def measurement_of(r: Reconstruction, seen: Sensing | None = None) -> Measurement:
    """Records of a reconstruction.

    Parameters
    ----------
    r : Reconstruction
    seen : Sensing, optional
        The measurement, where more channels are to be compared than the reconstruction trusted.
    """
    motion = motion_of(r)
    seen = motion.sensing if seen is None else seen
    expect_fundamental(r.rig, seen)
    under, friction = motion.sensing.force[:, 1], r["friction"].complex
    records = tuple(turned(seen, motion.q[i], friction[i], i, complex(under[i])) for i in range(len(r)))
    speed = np.abs(r["slip_velocity"].samples).max(axis=1)
    return Measurement(records, seen.channels, r.H, speed)


MOST_LISTED = 4
"""Records in a message."""


def expect_fundamental(rig: AnyRig, seen: Readings) -> None:
    """Refuse records of which the force was measured without what drives a simulation of them.

    Raises
    ------
    InputError
        If the force of a record has harmonics and no fundamental.
    """
    undriven = np.flatnonzero(seen.force.any(axis=1) & (seen.force[:, 1] == 0.0))
    if not len(undriven):
        return
    spectra, channel = seen.spectra, next(c.name for c in rig.channels if c.quantity == "force")
    named = ", ".join(map(str, spectra.labels[undriven[:MOST_LISTED]]))
    others = f" and {len(undriven) - MOST_LISTED} others" if len(undriven) > MOST_LISTED else ""
    raise InputError(
        f'{spectra.source}: record {named}{others}: channel "{channel}" has harmonics and not the fundamental; '
        "must have harmonic 1, or none"
    )


def turned(seen: Readings, q: Complex, T: Complex, i: int, under: complex = 0.0) -> Record:
    """A record turned so that its force is a cosine; amplitudes q (H+1, n) and T (H+1, ...) are where Newton starts.

    They belong to a force `under`, where that is not the one that was measured.
    """
    spectra, H = seen.spectra, seen.H
    level = float(spectra.level[i])
    known = bool(seen.force[i].any())  # without a force channel the level with phase 0 stands for it
    force = complex(seen.force[i, 1]) if known else complex(level)
    turn = np.exp(-1j * np.angle(force) * np.arange(H + 1))
    listed = seen.weight[i].T > 0.0
    nothing = complex(np.nan, np.nan)
    amplitudes = np.where(listed, (seen.measured[i] * turn[:, None]).T, nothing)[:, 1:]
    std = np.where(listed, 1.0 / np.where(listed, seen.weight[i].T, 1.0), np.nan)[:, 1:]
    force_std = np.where(seen.force_std[i, 2:] > 0.0, seen.force_std[i, 2:], np.nan)
    harmonics = np.where(np.isfinite(force_std), (seen.force[i] * turn)[2:], nothing)
    basis = FourierBasis(H, 3 * H + 2)
    start = State(
        basis.real(q * turn[:, None]),
        basis.real(T * turn.reshape(-1, *[1] * (T.ndim - 1))),
        2 * np.pi * float(spectra.hz[i]),
        ((under or force) * turn[1]).real,
    )
    return Record(
        number=int(spectra.records[i]),
        name=spectra.label(int(spectra.records[i])),
        hz=float(spectra.hz[i]),
        force=abs(force),
        force_std=float(seen.force_std[i, 1]) if known else 0.0,
        measured=np.array([amplitudes.real, amplitudes.imag]),
        std=std,
        start=start,
        distortion=np.array([harmonics.real, -harmonics.imag]),
        distortion_std=force_std,
        level=level,
    )


def solve_record(
    rig: AnyRig, basis: FourierBasis, record: Record, last: State | None
) -> tuple[PeriodicSolution, Correction]:
    """Steady state of a record, from its last one or from the reconstruction, else from nothing.

    Returns
    -------
    PeriodicSolution
    continuation.Correction
        Where Newton's method found it: it knows the derivative there.

    Raises
    ------
    ConvergenceError
        If it is not found; from a last one, nothing else is tried.
    """
    try:
        return solve_from(rig, basis, record, start_on(rig, record, record.start if last is None else last))
    except ConvergenceError:
        if last is not None:
            raise
    problem = balance_of(rig, basis, level=record.force_on(rig))
    lam = problem.lam_at(record.hz)
    return _described(
        problem, solve_at(problem, first_solution(problem, lam), lam, NewtonSettings(tolerance=TOLERANCE))
    )


def start_on(rig: AnyRig, record: Record, state: State) -> State:
    """A state to start a record from: turned over where it belongs to a force the other way round."""
    if state.F * record.force_on(rig) >= 0.0:
        return state
    return replace(state, Q=-state.Q, T=-state.T, F=-state.F)


def solve_from(
    rig: AnyRig, basis: FourierBasis, record: Record, start: State, steps: int = 40
) -> tuple[PeriodicSolution, Correction]:
    """As :func:`solve_record`, by Newton's method from a state.

    Raises
    ------
    ConvergenceError
        If it does not get there.
    """
    problem = balance_of(rig, basis, level=record.force_on(rig))
    settings = NewtonSettings(tolerance=TOLERANCE, max_iterations=steps)
    return _described(problem, solve_lifting(problem, start, problem.lam_at(record.hz), settings))


def _described(problem: AnyBalance, found: Correction) -> tuple[PeriodicSolution, Correction]:
    if not found.converged:
        raise ConvergenceError(f"no convergence, last residual {found.residual_norm:.2g}; {found.reason.value}")
    return describe(problem, found.x, found.lam), found


def parts(basis: FourierBasis, coefficients: Array, H: int) -> Array:
    """Real and imaginary part of amplitudes 1..H of coefficients (2H'+1, ...), (2, H, ...)."""
    amplitudes = basis.complex(coefficients)[1 : H + 1]
    return np.array([amplitudes.real, amplitudes.imag])


def force_columns(record: Record, amplitudes: Array, by_force: Array, by_tones: Array | None = None) -> Array:
    """Effect of one standard deviation of each part of the force on simulated amplitudes (2, c, H).

    Parameters
    ----------
    record : Record
    amplitudes : (2, c, H) array
    by_force : (2, c, H) array
        Their derivatives to the amplitude of the force, the ratios of its harmonics held.
    by_tones : (2, c, H, 2t) array, optional
        To the coefficients of cos and sin of each of :attr:`Record.tones`, where these were simulated.

    Returns
    -------
    (2 + 2t, 2, c, H) array
        For amplitude and phase of the fundamental, the harmonics held; then for those coefficients.
    """
    k = np.arange(1, amplitudes.shape[2] + 1)
    real, imaginary = amplitudes
    by_phase = np.array([-imaginary, real]) * k  # the phase of the force turns harmonic k by k times as much
    if by_tones is None:
        return np.asarray(record.force_std * np.array([by_force, by_phase / record.force]))
    number, cosine, sine = np.array(record.tones).reshape(-1, 3).T
    # ratios to a fundamental that grows, and phases beside one that turns
    by_force = by_force - by_tones @ np.column_stack([cosine, sine]).ravel() / record.force
    by_phase = by_phase + by_tones @ np.column_stack([-number * sine, number * cosine]).ravel()
    fundamental = record.force_std * np.array([by_force, by_phase / record.force])
    std = record.distortion_std[np.isfinite(record.distortion_std)]
    return np.concatenate([fundamental, np.moveaxis(by_tones * np.repeat(std, 2) / record.force, -1, 0)])
