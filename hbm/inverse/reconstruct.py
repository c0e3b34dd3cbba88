"""Inverse harmonic balance: friction, reaction and slip at the contact from accelerations along the beam.

:func:`reconstruct` is the entry. Which formulation finds the force is a name of `FORMULATIONS`; what follows from the
force, slip and reaction, energy and uncertainty, is the same for all of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError, expect_rig
from hbm.fourier import Array, coefficients_of
from hbm.inverse.contact import Contact, contact_of
from hbm.inverse.contactforce import ForceEstimate, likeliest, regularised
from hbm.inverse.kinematic import modal, nnm, nnm_spline
from hbm.inverse.reconstruction import SIGNALS, EstimatedSignal, Estimates, Misfit, Reconstruction
from hbm.inverse.resolution import resolution_of
from hbm.inverse.sensing import Complex, Sensing, sensing
from hbm.inverse.sensorcheck import SensorCheck, check_sensors
from hbm.measurement.spectra import MeasuredSpectra
from models.rig import Rig

FORMULATIONS: dict[str, Callable[[Sensing, Array], ForceEstimate]] = {
    "regularised": regularised,
    "modal": modal,
    "nnm": nnm,
    "nnm-spline": nnm_spline,
}
"""Formulations, docs/theory/inverse.md. The first is the default; the others fit the deflection first."""

MEAN_ROUNDS = 4
"""The mean friction and the motion are found in turns; the motion hardly depends on it."""

SIGNIFICANT = 5.0
OPEN = 0.01
"""A contact slips where its loop is open by so many standard deviations, and by this share of the box around it."""


def reconstruct(rig: Rig, spectra: MeasuredSpectra, *, formulation: str = "regularised") -> Reconstruction:
    """Reconstruct what happens at the contact.

    Parameters
    ----------
    rig : Rig
        Its friction law is not used.
    spectra : MeasuredSpectra
        Accelerations, velocities or displacements along the structure and, if measured, the force.
    formulation : str
        A name of `FORMULATIONS`.

    Returns
    -------
    Reconstruction

    Raises
    ------
    InputError
        If the formulation is unknown or knows no nonlinear elements but the rig has some, or no response was measured.

    References
    ----------
    docs/theory/equations.md section 5; (6)-(14), (26).
    """
    expect_rig(rig, "reconstruct")
    if formulation not in FORMULATIONS:
        raise InputError(f'reconstruct: formulation = "{formulation}"; must be one of {", ".join(FORMULATIONS)}')
    if rig.elements and formulation != "regularised":
        found = ", ".join(element.name for element in rig.elements)
        raise InputError(
            f'reconstruct: formulation = "{formulation}", but the rig has {found}; must be regularised there'
        )
    check = check_sensors(rig, spectra)
    result, contact = _reconstructed(rig, check.spectra, formulation, FORMULATIONS[formulation])
    beside = () if check.unit else (*_beside(contact, result.slips), *_held(result))
    return replace(result, warnings=(*spectra.silent, *check.findings, *beside), unit=check.unit)


def _beside(contact: Contact, slips: npt.NDArray[np.bool_]) -> tuple[str, ...]:
    """Warnings about what was found, beside those about sensors."""
    resolution = resolution_of(contact.estimate).warnings
    return (*_gains(contact), *resolution, *contact.unseen.warnings(contact.samples, slips))


def _held(found: Reconstruction) -> Iterator[str]:
    """The least that the limit of friction can be where no record slips: half of what friction spans, mean or not."""
    T = found["friction"]
    span = (T.samples - 2.0 * T.std).max(axis=1) - (T.samples + 2.0 * T.std).min(axis=1)
    if not found.slips.any() and span.max() > 0.0:
        yield f"no record slips: the limit of friction is at least {span.max() / 2.0:.3g} N"


def reconstruct_again(reconstruction: Reconstruction, rig: Rig) -> Reconstruction:
    """Reconstruct the same records with a rig whose numbers differ; sensors are taken as they are, without warnings."""
    name = reconstruction.formulation
    return _reconstructed(rig, reconstruction.spectra, name, FORMULATIONS[name])[0]


def reconstruct_likeliest(rig: Rig, spectra: MeasuredSpectra) -> tuple[Reconstruction, SensorCheck]:
    """The best guess of what happens at the contact, for simulations to start from; its deviations are too small."""
    check = check_sensors(rig, spectra)
    result, contact = _reconstructed(rig, check.with_force(rig, spectra), "regularised", likeliest)
    findings = (*check.findings, *resolution_of(contact.estimate).warnings)
    return replace(result, warnings=findings, unit=check.unit), check


def _reconstructed(
    rig: Rig, spectra: MeasuredSpectra, formulation: str, find: Callable[[Sensing, Array], ForceEstimate]
) -> tuple[Reconstruction, Contact]:
    """Reconstruction from sensors that are taken as they are, and the signals that it is of."""
    seen = sensing(rig, spectra)
    mean = np.zeros(len(spectra))
    slips = np.zeros(len(spectra), dtype=bool)
    for _ in range(MEAN_ROUNDS):
        contact = contact_of(seen, find(seen, mean))
        slips = _slips(contact)
        used, mean = mean, np.where(slips, mean + _asymmetry(contact), 0.0)
    other = contact_of(seen, find(seen, used + contact.mean_std("friction", slips)))
    return _reconstruction(contact, other, formulation, slips), contact


def _slips(contact: Contact) -> npt.NDArray[np.bool_]:
    """Whether the loop of friction over slip is open, beyond doubt and more than by its corners, (r,)."""
    return _open(contact, contact.energy.value)


def _open(contact: Contact, energy: Array) -> npt.NDArray[np.bool_]:
    """Whether energies per cycle (r,) are beyond doubt, and a share of the box around the loop."""
    span = np.ptp(contact.samples["friction"], axis=1) * np.ptp(contact.samples["slip"], axis=1)
    return np.asarray((energy > SIGNIFICANT * contact.energy.std) & (energy > OPEN * span))


def _gains(contact: Contact) -> list[str]:
    """A warning where friction would supply energy, which it cannot."""
    energy, records = contact.energy, contact.sensing.spectra.labels
    wrong = _open(contact, -energy.value)
    if not wrong.any():
        return []
    most = int(np.argmin(energy.value))
    return [
        f"friction supplies energy in {np.count_nonzero(wrong)} of {len(wrong)} records, most in record "
        f"{records[most]}: {-1e3 * energy.value[most]:.3g} ± {1e3 * energy.std[most]:.2g} mJ a period, where it can "
        "only take it; are the signs of all sines reversed (exp(-i omega t)), or that of the force?"
    ]


def _asymmetry(contact: Contact) -> Array:
    """Mean friction that is missing, (r,) [N].

    No accelerometer sees it. A contact that slips both ways reaches the same limit |T| / R both ways, whatever its law,
    unless friction depends on the direction.
    """
    R = np.maximum(contact.samples["normal"], 0.01 * contact.load)
    ratio = contact.samples["friction"] / R
    r = np.arange(len(ratio))
    i, j = ratio.argmax(axis=1), ratio.argmin(axis=1)
    return np.asarray(-(ratio[r, i] + ratio[r, j]) / (1.0 / R[r, i] + 1.0 / R[r, j]))


def _reconstruction(contact: Contact, other: Contact, formulation: str, slips: npt.NDArray[np.bool_]) -> Reconstruction:
    """Signals with standard deviations, inflated where the sensors contradict the structure.

    `other` has a mean friction that is a standard deviation larger: it bends the beam, and so stiffens it.
    """
    seen, estimate = contact.sensing, contact.estimate
    misfit = misfit_of(seen, estimate)
    inflation = misfit.widening
    signals = {name: _signal(contact, other, name, inflation, slips) for name in SIGNALS}
    energy, work = contact.energy, contact.work_rate
    energy_std = np.hypot(energy.std * inflation, other.energy.value - energy.value)
    work_std = np.hypot(work.std * inflation, other.work_rate.value - work.value)
    return Reconstruction(
        rig=seen.rig,
        spectra=seen.spectra,
        formulation=formulation,
        signals=signals,
        slips=slips,
        energy_per_cycle=Estimates(energy.value, np.hypot(energy_std, contact.unseen.energy), "J"),
        work_rate=Estimates(work.value, np.hypot(work_std, contact.work_unseen), "W"),
        misfit=misfit,
        residual=_residual(seen, estimate),
        resolution=estimate.resolution,
        condition=estimate.condition,
        law_inputs=contact.law_inputs(other, slips),
        warnings=(),
    )


def misfit_of(seen: Sensing, estimate: ForceEstimate) -> Misfit:
    """Squared residuals of the channels beside what noise leaves of them."""
    measured = seen.weight > 0.0
    return Misfit(
        channels=seen.channels,
        chi2=np.sum(np.abs(estimate.residual) ** 2, axis=1),
        expected=np.sum(2.0 * (measured - estimate.leverage), axis=1),
    )


def _residual(seen: Sensing, estimate: ForceEstimate) -> Complex:
    """Measured less explained, of the response channels and of the force, in standard deviations, (r, H+1, c + 1)."""
    known = seen.force_std > 0.0
    of_force = np.where(known, seen.force - estimate.force, 0.0) / np.where(known, seen.force_std, 1.0)
    return np.concatenate([estimate.residual, of_force[..., None]], axis=2)


def _signal(
    contact: Contact, other: Contact, name: str, inflation: Array, slips: npt.NDArray[np.bool_]
) -> EstimatedSignal:
    coefficients, samples = coefficients_of(contact.amplitudes[name]), contact.samples[name]
    # what nobody measured is as uncertain as expected, whatever the sensors say of each other
    measured = (contact.sensing.weight > 0.0).any(axis=2)
    std = contact.std(name) * np.where(measured, inflation[:, None], 1.0)
    mean_std = np.where(slips | (name == "normal"), contact.mean_std(name, slips), 0.0)
    noise = np.sqrt(np.sum(std[:, 1:] ** 2, axis=1) + mean_std**2)
    total = np.hypot(noise, contact.unseen.std[name])[:, None]
    by_mean = other.samples[name] - samples
    by_mean -= by_mean.mean(axis=1, keepdims=True)
    std = np.hypot(std, np.abs(other.amplitudes[name] - contact.amplitudes[name]) / np.sqrt(2.0))  # of cos and sin
    std[:, 0] = mean_std
    return EstimatedSignal(SIGNALS[name], coefficients, std, samples, np.hypot(total, by_mean))
