"""What records leave of the tolerances of a rig's numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.inverse.jointed import reconstruct_joints
from hbm.inverse.reconstruct import reconstruct_again
from hbm.inverse.reconstruction import Reconstructed, Reconstruction
from hbm.outputerror.model import FAR
from hbm.outputerror.nominal import tolerances as with_usual
from hbm.parallel import one_thread
from models.plausible import quiet
from models.scalars import FRICTION

OF_LAWS = (FRICTION, "joints.")
"""Beginnings of keys of numbers that no reconstruction uses."""

ASKED, WORTH = 3.0, 0.5
"""Sensors ask for another number where it is off by more than so many standard deviations of what they leave, and by
this share of its tolerance: beside less, small differences of any model count as much."""

STEPS = (1.0, -1.0, 0.1, -0.1, 0.01, -0.01)
"""Tolerances by which a number is tried larger, the first with which a rig can be made."""

TOLD = 2
"""So many numbers of the rig file are named for a signal: those that do most."""


@dataclass(frozen=True, eq=False)
class Known:
    """How well k numbers of a rig file are known: by their tolerances, and by sensors that would contradict each other.

    To first order in their errors, independent and of variance one in units of the tolerances before anything was
    measured, what residuals say of them is a linear least-squares problem (Gauss-Markov).

    Attributes
    ----------
    values : mapping of str to float
        The numbers.
    tolerances : mapping of str to float
        Standard deviation of each: relative, of a delay in seconds.
    residual : (m,) array
        What sensors contradict each other by, in standard deviations.
    by_numbers : (k, m) array
        Its change where each number is a tolerance larger.
    """

    ROW: ClassVar = ("number", "value", "tolerance", "left", "expected")

    values: Mapping[str, float]
    tolerances: Mapping[str, float]
    residual: Array
    by_numbers: Array

    @property
    def rows(self) -> list[tuple[str, float, float, float, float]]:
        """What is known of each number, under the headings `ROW`; `left` and `expected` in tolerances."""
        numbers = zip(self.left.tolist(), self.expected.tolist(), strict=True)
        return [
            (key, value, self.tolerances[key], *both)
            for (key, value), both in zip(self.values.items(), numbers, strict=True)
        ]

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the errors that sensors leave, (k, k), in units of the tolerances."""
        return np.asarray(np.linalg.inv(np.eye(len(self.by_numbers)) + self.by_numbers @ self.by_numbers.T))

    @cached_property
    def expected(self) -> Array:
        """Errors that sensors ask for, (k,), in units of the tolerances: the mean of what is left."""
        return np.asarray(self.covariance @ (self.by_numbers @ -self.residual))

    @property
    def left(self) -> Array:
        """Standard deviation of each error around what is expected, (k,), in units of the tolerances."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def size(self) -> Array:
        """Root of the mean square of each error, (k,), in units of the tolerances."""
        return np.asarray(np.hypot(self.left, self.expected))

    @property
    def asked(self) -> dict[str, float]:
        """Numbers that sensors ask for, where they do; none where they ask for what no tolerance explains."""
        there = (np.abs(self.expected) > np.maximum(ASKED * self.left, WORTH)) & (not self.strained)
        return {key: value for (key, value), asked in zip(self.calibrated.items(), there, strict=True) if asked}

    @property
    def strained(self) -> dict[str, float]:
        """By how many tolerances numbers would be off that are farther off than tolerances explain."""
        pulls = zip(self.values, self.expected.tolist(), strict=True)
        return {key: pull for key, pull in pulls if abs(pull) > FAR}

    @property
    def calibrated(self) -> dict[str, float]:
        """All numbers as sensors ask for them, together."""
        return {key: _moved(key, value, self.tolerances[key] * x) for key, value, x in self._expected}

    @property
    def _expected(self) -> Iterator[tuple[str, float, float]]:
        return zip(self.values, self.values.values(), self.expected.tolist(), strict=True)

    @property
    def asks(self) -> str:
        """What numbers the sensors ask for, in words; empty where they ask for none."""
        if self.strained:
            key, pull = max(self.strained.items(), key=lambda item: abs(item[1]))
            return (
                "sensors contradict the structure by more than the tolerances of the rig file explain: "
                f"{key} would be off by {pull:+.1f} of them; hbm diagnose may tell what is missing"
            )
        said = []
        for key, value in self.asked.items():
            i = list(self.values).index(key)
            size, left = self.expected[i] * self.tolerances[key], self.left[i] * self.tolerances[key]
            scale, unit = (1.0, "s") if key.endswith(".delay") else (100.0, "%")
            change = f"{scale * size:+.2g} ± {scale * left:.1g} {unit}"
            said.append(f"{key} = {value:.5g} ({change})")
        return f"sensors agree better with {', '.join(said)}" if said else ""

    def errors(self, changes: Array) -> Array:
        """Root of the mean square of what errors of the numbers do.

        Parameters
        ----------
        changes : (k, ...) array
            Changes where each number is a tolerance larger.
        """
        flat = changes.reshape(len(changes), -1)
        square = np.einsum("ki,ki->i", flat, self.covariance @ flat) + (self.expected @ flat) ** 2
        return np.asarray(np.sqrt(square).reshape(changes.shape[1:]))

    def most(self, changes: Array) -> str:
        """The numbers that do most to a value, in words.

        Parameters
        ----------
        changes : (k,) array
            Changes of the value where each number is a tolerance larger.
        """
        own = np.abs(changes) * self.size
        names = [list(self.values)[i] for i in np.argsort(-own)[:TOLD] if own[i] > 0.0]
        return ", ".join(f"{key} ({tolerance_text(key, self.tolerances[key])})" for key in names)


def tolerance_text(key: str, std: float) -> str:
    """What a number may be off by, in words."""
    return f"{std:.2g} s" if key.endswith(".delay") else f"{100.0 * std:.2g} %"


Kind = TypeVar("Kind", bound=Reconstructed)


@dataclass(frozen=True, eq=False)
class Tried(Generic[Kind]):
    """What is reconstructed with a number some tolerances larger; the number of tolerances may be negative."""

    size: float
    found: Kind

    def per_tolerance(self, change: Array) -> Array:
        """A change as it is per tolerance, to first order."""
        return change / self.size


@one_thread
@quiet()
def known_by(
    reconstruction: Kind, tolerances: Mapping[str, float] | None = None
) -> tuple[Known, dict[str, Tried[Kind]]]:
    """What records leave of the tolerances of a rig's numbers, and what is reconstructed with each of them moved.

    Parameters
    ----------
    reconstruction : Reconstruction or JointReconstruction
    tolerances : mapping of str to float, optional
        As for :func:`hbm.contact_errors`.
    """
    rig = reconstruction.rig
    every = with_usual(rig, reconstruction.spectra.channels, tolerances)
    off = {key: std for key, std in every.items() if not key.startswith(OF_LAWS)}
    values = {key: float(rig.number(key)) for key in off}
    others = {key: _tried(reconstruction, key, values[key], std) for key, std in off.items()}
    here = _contradiction(reconstruction, reconstruction.widening)
    changes = [o.per_tolerance(_contradiction(o.found, reconstruction.widening) - here) for o in others.values()]
    return Known(values, off, here, np.array(changes).reshape(len(off), -1)), others


def _tried(reconstruction: Kind, key: str, value: float, std: float) -> Tried[Kind]:
    """What is reconstructed with a number moved: up by a tolerance, or as far as a rig can be made."""
    up = -1.0 if key.endswith(".position") else 1.0  # a place further on may lie beyond the beam
    for size in STEPS:
        try:
            rig = reconstruction.rig.with_numbers({key: _moved(key, value, up * size * std)})
        except ValueError:  # modes that are close do not change places
            continue
        return Tried(up * size, _again(reconstruction, rig))
    raise InputError(f"{key} = {value:g} cannot be off by any part of its tolerance; state 0 for one that is exact")


def _again(found: Kind, rig: Any) -> Kind:
    """The same records with a rig whose numbers differ."""
    if isinstance(found, Reconstruction):
        return reconstruct_again(found, rig)  # type: ignore[return-value]
    return reconstruct_joints(rig, found.spectra)  # type: ignore[return-value]


def _contradiction(found: Reconstructed, widening: Array) -> Array:
    """Residuals as real numbers, in units of what noise, or of records that contradict the structure more, leaves."""
    scaled = found.residual / widening[:, None, None]
    return np.concatenate([scaled.real.ravel(), scaled.imag.ravel()])


def _moved(key: str, value: float, std: float) -> float:
    """A number so much larger: relative, where it is not zero or a delay."""
    return value + std * (1.0 if key.endswith(".delay") or value == 0.0 else value)
