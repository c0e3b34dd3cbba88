"""Inverse harmonic balance of a rig with joints: the forces at all ports and the motion there, no law assumed.

Beside its joints a body is linear: harmonic by harmonic its channels read the joint forces and the excitation through
receptances, and weighted least squares turn that round. As many forces can be found as there are sensors; which
harmonics tell them apart, the standard deviations say.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hbm.channels import factor
from hbm.errors import InputError, expect_joints
from hbm.fourier import Array, coefficients_of, sampled
from hbm.inverse.contactforce import Indices, decay, last_counted, prior
from hbm.inverse.jointreconstruction import SAMPLES, JointReconstruction, consistent, widening
from hbm.inverse.jointsensors import joint_sensors
from hbm.inverse.reconstruction import EstimatedSignal, Estimates, Misfit
from hbm.inverse.sensing import UNKNOWN_FORCE
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import JointedRig
from models.jointedstructure import JointedStructure
from models.parts import Channel

Complex = npt.NDArray[np.complex128]

ABSENT = 1e-9
"""Standard deviation of harmonics of the force that count as zero, as a fraction of the largest level."""

TOLD_APART = 1e-10
"""Forces are told apart where the least singular value of what sensors read of them exceeds this of the largest."""


ALL_USED = 1e-9
"""A reading is all used where less than this share of it is left to check the others by."""


class Receptances(NamedTuple):
    """Motion at response channels and joints per force at joints and drive, at one frequency [m/N]."""

    channels_by_joints: Complex
    channels_by_force: Complex
    joints_by_joints: Complex
    joints_by_force: Complex


def receptances(s: JointedStructure, omega: float) -> Receptances:
    """Receptances of a body at `omega` [rad/s], > 0."""
    dynamic = np.diag(s.omega_n**2 - omega**2) + 1j * omega * s.damping
    through = np.linalg.solve(dynamic, np.column_stack([s.joints.T, s.excitation]))
    by_joints, by_force = through[:, :-1], through[:, -1]
    return Receptances(
        np.asarray(s.channels @ by_joints + s.channels_by_joints, dtype=complex),
        np.asarray(s.channels @ by_force + s.channels_by_force, dtype=complex),
        np.asarray(s.joints @ by_joints + s.flexibility, dtype=complex),
        np.asarray(s.joints @ by_force + s.flexibility_to_force, dtype=complex),
    )


def reconstruct_joints(rig: JointedRig, spectra: MeasuredSpectra) -> JointReconstruction:
    """Forces and motions at the joints of a rig, from its channels; the laws of the joints are not used.

    Parameters
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
        Spectra of response channels and, if measured, the force; else its fundamental is one more unknown.

    Raises
    ------
    InputError
        If the rig has a contact or no joints, there are more ports than response channels measured, or the channels do
        not tell their forces apart at any harmonic of any record.
    """
    expect_joints(rig, "reconstruct_joints")
    if not rig.joints:
        raise InputError(f"reconstruct_joints: {rig.name} has no joints; must have some, whose forces are found")
    found = _found(rig, spectra)
    if not np.isfinite(found.f_std).any():
        channels = ", ".join(c.name for c in rig.response_channels if c.name in spectra.channels)
        raise InputError(
            f"{spectra.source}: channels {channels} do not tell the {rig.ports} joint forces apart at any harmonic; "
            "must be at other places"
        )
    misfit, wide = found.misfit, widening(found.misfit)
    left_out, signals = _left_out(rig, spectra, found.f, found.f_std), {}
    for j, (name, motion, units) in enumerate(zip(rig.forces, rig.motions, rig.units, strict=True)):
        f_std, u_std = (std[..., j] * wide[:, None] for std in (found.f_std, found.u_std))
        signals[name] = _signal(units[1], found.f[..., j], f_std, left_out.forces[:, j])
        signals[motion] = _signal(units[0], found.u[..., j], u_std, left_out.motions[:, j])
    spread = np.hypot(np.sqrt(found.variance) * wide[:, None], left_out.energies)
    energies = {j.name: Estimates(found.energy[:, i], spread[:, i], "J") for i, j in enumerate(rig.joints)}
    return JointReconstruction(
        rig=rig,
        spectra=spectra,
        signals=signals,
        energy=energies,
        misfit=misfit,
        residual=found.residual,
        findings=() if consistent(misfit).all() else joint_sensors(rig, spectra, misfit, _misfit),
    )


class _Found(NamedTuple):
    """Forces f and motions u at the ports, (r, H+1, m), and energies (r, joints), of spectra as they are.

    Standard deviations are those of noise, and `variance` is that of the energies; nan where sensors do not tell.
    """

    f: Complex
    f_std: Array
    u: Complex
    u_std: Array
    energy: Array
    variance: Array
    misfit: Misfit
    residual: Complex


def _found(rig: JointedRig, spectra: MeasuredSpectra) -> _Found:
    sensors = _Sensors.of(rig, spectra)
    r, H, m = len(spectra), spectra.H, rig.ports
    f, u = (np.full((r, H + 1, m), np.nan, dtype=complex) for _ in range(2))
    f_std, u_std = (np.full((r, H + 1, m), np.nan) for _ in range(2))
    energy, variance = np.zeros((2, r, len(rig.joints)))
    chi2, expected = np.zeros((2, r, len(sensors.channels) + 1))
    residual = np.zeros((r, H + 1, len(sensors.channels) + 1), dtype=complex)
    for k in range(1, H + 1):
        for solved in sensors.solved(k):
            at = solved.records
            f[at, k], u[at, k], f_std[at, k], u_std[at, k] = solved.signals
            taken, noise = solved.taken(k, [j.law.ports for j in rig.joints])
            energy[at] += taken
            variance[at] += noise**2
            residual[at[:, None], k, solved.read] = solved.residual
            chi2[at[:, None], solved.read] += solved.chi2
            expected[at[:, None], solved.read] += solved.expected
    misfit = Misfit((*(c.name for c in sensors.channels), "force"), chi2, expected)
    return _Found(f, f_std, u, u_std, energy, variance, misfit, residual)


def _misfit(rig: JointedRig, spectra: MeasuredSpectra) -> Misfit:
    return _found(rig, spectra).misfit


@dataclass(frozen=True, eq=False)
class _Solved:
    """Joint forces and excitation of one harmonic of r records, by weighted least squares.

    Attributes
    ----------
    records : (r,) int array
        Places of the records.
    read : (readings,) int array
        Places of the channels read; the force is behind the last.
    forces : (r, m + 1) complex array
        Of the joints, then of the excitation.
    spread : (r, m + 1, readings) complex array
        Their deviations per standard deviation of each reading; of cosine and sine alike.
    motion : (r, m, m + 1) complex array
        Motion at the joints per force.
    residual : (r, readings) complex array
        Measured less explained, in standard deviations.
    expected : (r, readings) array
        What noise alone leaves of their squares on the mean.
    """

    records: Indices
    read: Indices
    forces: Complex
    spread: Complex
    motion: Complex
    residual: Complex
    expected: Array

    @property
    def chi2(self) -> Array:
        """Squared residuals, (r, readings)."""
        return np.asarray(np.abs(self.residual) ** 2)

    @property
    def signals(self) -> tuple[Complex, Complex, Array, Array]:
        """Forces and motions at the ports, and their standard deviations, (r, m) each."""
        std = np.linalg.norm(self.spread[:, :-1], axis=2), np.linalg.norm(self.motion @ self.spread, axis=2)
        return self.forces[:, :-1], _times(self.motion, self.forces), *std

    def taken(self, k: int, ports: Sequence[int]) -> tuple[Array, Array]:
        """Energy that each joint takes in a period by harmonic k [J], and its standard deviation, (r, joints) each."""
        (f, u, *_), at = self.signals, np.cumsum([0, *ports[:-1]])
        by_forces = self.spread[:, :-1] * u.conj()[..., None]
        by_motion = (self.motion @ self.spread) * f.conj()[..., None]
        taken, spread = (f * u.conj()).imag, np.add.reduceat(by_forces - by_motion, at, axis=1)
        return -np.pi * k * np.add.reduceat(taken, at, axis=1), np.pi * k * np.linalg.norm(spread, axis=2)


@dataclass(frozen=True, eq=False)
class _Sensors:
    """Measured amplitudes of a rig, and the response of its channels to joint forces and excitation."""

    rig: JointedRig
    spectra: MeasuredSpectra
    channels: list[Channel]
    values: Complex  # (r, c, H+1)
    std: Array
    force: Complex  # (r, H+1)
    force_std: Array

    @staticmethod
    def of(rig: JointedRig, spectra: MeasuredSpectra) -> "_Sensors":
        measured = [c for c in rig.response_channels if c.name in spectra.channels]
        if len(measured) < rig.ports:
            raise InputError(
                f"{spectra.source}: {len(measured)} response channels measured and {rig.ports} joint forces unknown; "
                "must be at least as many channels"
            )
        values = np.stack([spectra.complex(c.name) for c in measured], axis=1)
        std = np.stack([spectra.std[:, spectra.index(c.name)] for c in measured], axis=1)
        return _Sensors(rig, spectra, measured, values, std, *_force(rig, spectra))

    def solved(self, k: int) -> Iterator[_Solved]:
        """Harmonic k of the records whose sensors tell the joint forces apart, those of the same readings at once."""
        known = np.isfinite(self.values[..., k]) & np.isfinite(self.std[..., k])
        for reads in np.unique(known, axis=0):
            if np.count_nonzero(reads) >= self.rig.ports:
                yield self._solved(k, np.flatnonzero((known == reads).all(axis=1)), np.flatnonzero(reads))

    def _solved(self, k: int, records: Indices, read: Indices) -> _Solved:
        std = np.column_stack([self.std[records[:, None], read, k], self.force_std[records, k]])
        # records of the same frequency and deviations share all but what was measured
        alike, of = np.unique(np.column_stack([self.spectra.hz[records], std]), axis=0, return_inverse=True)
        A, motion = self._equations(k, read, alike[:, 0], alike[:, 1:])
        columns = A[:, :-1, :-1]
        values = np.linalg.svd(columns / np.linalg.norm(columns, axis=1, keepdims=True), compute_uv=False)
        told = (values[:, -1] > TOLD_APART * values[:, 0])[of]
        records, of, std = records[told], of[told], std[told]
        scale = np.linalg.norm(A, axis=1)
        inverse = np.linalg.pinv(A / scale[:, None]) / scale[..., None]
        leverage = np.einsum("rbx,rxb->rb", A, inverse).real
        expected = 2 * np.where(leverage < 1.0 - ALL_USED, 1.0 - leverage, 0.0)
        b = np.column_stack([self.values[records[:, None], read, k], self.force[records, k]]) / std
        forces = _times(inverse[of], b)
        return _Solved(
            records=records,
            read=np.append(read, len(self.channels)),
            forces=forces,
            spread=inverse[of],
            motion=motion[of],
            residual=b - _times(A[of], forces),
            expected=expected[of],
        )

    def _equations(self, k: int, read: Indices, hz: Array, std: Array) -> tuple[Complex, Complex]:
        """Readings per force in standard deviations, and motion at the joints per force, at harmonic k of `hz`.

        The force is an unknown too, and what was measured of it one more reading: (n, readings, m + 1), (n, m, m + 1).
        """
        frequencies, at = np.unique(hz, return_inverse=True)
        omega = 2 * np.pi * k * frequencies
        each = [receptances(self.rig.structure, w) for w in omega.tolist()]
        names = [c.name for c in self.rig.response_channels]
        rows = [names.index(self.channels[c].name) for c in read]
        factors = np.column_stack([factor(self.channels[c], 1j * omega) for c in read])
        responses = [np.column_stack([on.channels_by_joints, on.channels_by_force])[rows] for on in each]
        force = np.eye(self.rig.ports + 1)[-1:]
        G: Complex = np.array([np.vstack([g * x[:, None], force]) for g, x in zip(responses, factors, strict=True)])
        motion: Complex = np.array([np.column_stack([on.joints_by_joints, on.joints_by_force]) for on in each])
        return G[at] / std[..., None], motion[at]


def _times(matrices: Complex, vectors: Complex) -> Complex:
    """Products of stacks of matrices and of vectors, (r, rows)."""
    return np.asarray(np.einsum("rij,rj->ri", matrices, vectors))


def _force(rig: JointedRig, spectra: MeasuredSpectra) -> tuple[Complex, Array]:
    """Complex coefficients of the excitation and the standard deviations of cosine and sine, (r, H+1) each."""
    name, level = rig.force_among(spectra.channels), spectra.level[:, None]
    found = np.zeros((len(spectra), spectra.H + 1), dtype=complex)
    std = np.full(found.shape, np.nan)
    if name is not None:
        found, std = spectra.complex(name), spectra.std[:, spectra.index(name)]
    tones = np.isin(np.arange(spectra.H + 1), [k for k, _, _ in rig.excitation.tones])
    known, absent = np.isfinite(std), np.where(tones, UNKNOWN_FORCE * level, ABSENT * level.max())
    return np.where(known, found, 0.0), np.where(known, std, absent)


class _LeftOut(NamedTuple):
    """What harmonics that were not found may do.

    Attributes
    ----------
    forces, motions : (r, m) array
        Standard deviations at the ports.
    energies : (r, joints) array
        Root of the mean square of what each joint takes by them in a period [J].
    """

    forces: Array
    motions: Array
    energies: Array


def _left_out(rig: JointedRig, spectra: MeasuredSpectra, f: Complex, f_std: Array) -> _LeftOut:
    """What harmonics that were not found may do to the forces, motions and energies of joints.

    Most of them are above those measured, where what slides or strikes rounds a series off: each force falls on as the
    prior that its own harmonics make most likely says (:mod:`hbm.inverse.contactforce`), and moves all joints.

    Parameters
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
    f : (r, H+1, m) complex array
        Forces found, nan where they were not.
    f_std : (r, H+1, m) array
        Standard deviation of each of their cos and sin.
    """
    found = np.isfinite(f_std[:, 1:])
    k = np.arange(1, last_counted(spectra.H) + 1)
    expected = np.empty((len(spectra), len(k), f.shape[2]))
    for j in range(f.shape[2]):
        amplitude, std = np.nan_to_num(np.abs(f[:, 1:, j])), np.where(found[..., j], f_std[:, 1:, j], np.inf)
        order, size, _ = prior(amplitude, std)
        expected[..., j] = decay(order, size, k)
    expected[:, : spectra.H][found] = 0.0
    expected[~found.any(axis=(1, 2))] = 0.0  # nothing says how large they are
    motions, energies = np.empty((len(spectra), f.shape[2])), np.empty((len(spectra), len(rig.joints)))
    for hz in np.unique(spectra.hz).tolist():
        there = spectra.hz == hz
        moved = np.array([receptances(rig.structure, 2 * np.pi * n * hz).joints_by_joints for n in k])
        motions[there] = np.sqrt(np.einsum("kpj,rkj->rp", np.abs(moved) ** 2, expected[there] ** 2))
        energies[there] = _energies(k, moved, expected[there], [j.law.ports for j in rig.joints])
    return _LeftOut(np.linalg.norm(expected, axis=1), motions, energies)


def _energies(k: Indices, moved: Complex, expected: Array, ports: Sequence[int]) -> Array:
    """Root of the mean square of what joints take in a period by forces of random phases [J], (r, joints).

    Of harmonic k that is pi k Im(conj(f) u), u = moved f. What a force does to its own motion goes from the joint to
    the body, always; what those of other joints do to it goes either way.

    Parameters
    ----------
    k : (K,) array
    moved : (K, m, m) complex array
        Motion at the ports per force.
    expected : (r, K, m) array
        Standard deviation of the cosine and of the sine of each force.
    ports : sequence of int
        How many each joint has.
    """
    at, joint = np.cumsum([0, *ports[:-1]]), np.repeat(np.arange(len(ports)), ports)
    power = 2.0 * np.pi * k[:, None] * expected**2  # pi k times the mean of |f|^2
    mean = np.einsum("kpp,rkp->rp", moved.imag, power)
    within = joint[:, None] == joint
    crossed = np.where(within, moved.imag**2, np.abs(moved) ** 2 / 2)
    variance = np.einsum("kpq,rkp,rkq->rp", crossed, power, power)
    return np.asarray(np.sqrt(np.add.reduceat(mean, at, axis=1) ** 2 + np.add.reduceat(variance, at, axis=1)))


def _signal(unit: str, values: Complex, std: Array, left_out: Array) -> EstimatedSignal:
    """A signal of its harmonics; those that were not found are not in its samples but in their deviation."""
    basis = sampled(values.shape[1] - 1, SAMPLES)
    coefficients = coefficients_of(values)
    samples = np.nan_to_num(coefficients) @ basis.synthesis.T
    spread = np.sqrt(np.sum(np.nan_to_num(std) ** 2, axis=1) + left_out**2)[:, None] * np.ones(basis.N_t)
    return EstimatedSignal(unit, coefficients, std, samples, spread)
