"""The force that is missing at one place: its harmonics and phase, with which powers it grows, and this in words."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hbm.diagnosis.places import AnyPlace, Complex
from hbm.fourier import Array

CLEAR = 3.0
"""A force of so many standard deviations is clear; growth is told from clear ones."""

FEWEST = 4
LEAST_RANGE = 1.2
"""Records, and their largest amplitude or frequency over the least, from which growth can be told; records, from which
it can be told whether energy is taken."""

SOME = 0.05
"""Share that is worth a word."""

STRONG, MOST_NAMED = 0.1, 5
"""A harmonic is named where its amplitude is at least this part of the strongest; so many at most."""


@dataclass(frozen=True)
class Exponent:
    """Power of a growth, with its standard deviation."""

    value: float
    std: float

    def __repr__(self) -> str:
        return f"{self.value:.2g} +- {self.std:.1g}"


@dataclass(frozen=True)
class Share:
    """A part of the most there could be, -1..1, with its standard deviation, and whether records agree in its sign."""

    value: float
    std: float
    agreed: bool

    @property
    def certain(self) -> bool:
        """Whether it is worth a word, and its sign beyond doubt."""
        return self.agreed and abs(self.value) > max(SOME, CLEAR * self.std)

    def __repr__(self) -> str:
        return f"{100 * abs(self.value):.0f} +- {100 * self.std:.1g} %"


@dataclass(frozen=True, eq=False)
class MissingForce:
    """The force that is missing if it is missing at one place alone.

    Attributes
    ----------
    place : Place
    share : float
        Part of the misfit beyond noise that it explains, 0..1.
    chi2 : float
        Misfit that is left.
    left : float
        The same per coefficient beyond the unknowns, in noise variances.
    unknowns : int
        Numbers found: two per harmonic and record.
    force : (r, H) complex array
        Amplitudes of harmonics 1..H [place.unit].
    std : (r, H) array
        Standard deviation of each of their parts.
    seen : (r, H) complex array
        Amplitudes of what it is held against [place.against], with what the force itself adds to it where that is
        known.
    missed : (r,) array
        Part of the response of each record that the model misses, with the force where `seen` is with it: so uncertain
        is `seen`, relatively.
    hz : (r,) array
    """

    place: AnyPlace
    share: float
    chi2: float
    left: float
    unknowns: int
    force: Complex
    std: Array
    seen: Complex
    missed: Array
    hz: Array

    @property
    def turned(self) -> Complex:
        """The force where the fundamental of what it is held against is a cosine, (r, H): in phase it is real."""
        k = np.arange(1, self.force.shape[1] + 1)
        return np.asarray(self.force * np.exp(-1j * np.angle(self.seen[:, :1]) * k))

    @property
    def elastic(self) -> Array:
        """Rms over the records of the part in phase, (H,), noise taken off; 0 where it is lost in noise."""
        return self._rms(self.turned.real)

    @property
    def dissipative(self) -> Array:
        """Rms over the records of the part in quadrature, (H,), noise taken off."""
        return self._rms(self.turned.imag)

    def _rms(self, values: Array) -> Array:
        known = np.isfinite(self.std)
        variance = np.where(known, self.std, 0.0) ** 2
        sums = np.sum(np.where(known, values, 0.0) ** 2 - variance, axis=0)
        sums[sums < CLEAR * np.sqrt(2.0 * np.sum(variance**2, axis=0))] = 0.0
        return np.asarray(np.sqrt(sums / np.maximum(known.sum(axis=0), 1)))

    @property
    def dissipative_share(self) -> float:
        """Part of the squared fundamental that is in quadrature; nan where it is lost in noise."""
        across, along = self.dissipative[0] ** 2, self.elastic[0] ** 2
        return float(across / (across + along)) if across + along > 0.0 else np.nan

    @property
    def work(self) -> Array:
        """Work done on the structure per cycle, (r,) [J]; for a reading without meaning."""
        k = np.arange(1, self.force.shape[1] + 1)
        f, d = (self.seen, self.force) if self.place.kind == "motion" else (self.force, self.seen)
        return np.asarray(np.pi * np.sum(k * np.imag(np.nan_to_num(f * d.conj())), axis=1))

    @property
    def taken(self) -> Share:
        """Energy that it takes from the structure, over the most that a force so large on such a motion could take.

        A law that dissipates takes some in every record. A conservative one takes none, but the force that is found in
        its place may, as far as force and motion are uncertain, the misfit that is left is larger than noise, and
        calibration has taken a part of it: then it takes in one record and gives in another.
        """
        k = np.arange(1, self.force.shape[1] + 1)
        most = np.pi * np.sum(k * np.nan_to_num(np.abs(self.force * self.seen)), axis=1)
        if not most.any():
            return Share(0.0, np.inf, agreed=False)
        by_force = np.pi * np.linalg.norm(k * np.nan_to_num(self.std * np.abs(self.seen)), axis=1)
        std = np.hypot(max(self.left, 1.0) ** 0.5 * by_force, self.missed * most)
        clear = np.sign(self.work[np.abs(self.work) > CLEAR * std])
        whole = -float(np.sum(self.work) / np.sum(most))
        parts = np.concatenate([std, self.work + whole * most])
        agreed = len(clear) >= FEWEST and bool(np.all(clear == clear[0]))
        return Share(whole, float(np.linalg.norm(parts) / np.sum(most)), agreed)

    @property
    def stiffness(self) -> float:
        """Force against displacement in phase, of the fundamental over all records; negative for a mass [N/m]."""
        f, d = self.force[:, 0], self.seen[:, 0]
        return float(-np.real(np.nansum(f * d.conj())) / np.nansum(np.abs(d) ** 2))

    @property
    def harmonics(self) -> list[int]:
        """The strongest, those that count beside it too, in descending order; none where all are lost in noise."""
        size = np.hypot(self.elastic, self.dissipative)
        order = np.argsort(-size)
        return [int(i) + 1 for i in order[:MOST_NAMED] if size[i] > STRONG * size[order[0]]]

    @property
    def growth(self) -> tuple[Exponent | None, Exponent | None]:
        """Powers with which its strongest harmonic grows with what it is held against, and with the frequency."""
        if not self.harmonics:
            return None, None
        k = self.harmonics[0] - 1
        size2, noise2 = np.abs(self.force[:, k]) ** 2, 2 * self.std[:, k] ** 2
        clear = size2 > CLEAR**2 * noise2
        size = np.sqrt(np.maximum(size2 - noise2, np.finfo(float).tiny))[clear]
        amplitude = np.linalg.norm(self.seen, axis=1)[clear]
        return _powers(size, amplitude, self.hz[clear])


def _powers(size: Array, amplitude: Array, hz: Array) -> tuple[Exponent | None, Exponent | None]:
    """Slopes of a plane through logarithms; None for what hardly varies."""
    varies = [len(size) >= FEWEST and float(np.ptp(np.log(x))) > np.log(LEAST_RANGE) for x in (amplitude, hz)]
    chosen = [np.log(x) for x, known in zip((amplitude, hz), varies, strict=True) if known]
    if not chosen:
        return None, None
    A = np.column_stack([np.ones(len(size)), *chosen])
    slopes, *_ = np.linalg.lstsq(A, np.log(size))
    left = np.log(size) - A @ slopes
    covariance = np.linalg.pinv(A.T @ A) * float(left @ left) / max(len(size) - A.shape[1], 1)
    found = iter([Exponent(float(b), float(s)) for b, s in zip(slopes, np.sqrt(np.diag(covariance)), strict=True)][1:])
    first, second = (next(found) if known else None for known in varies)
    return first, second


# ---------------------------------------------------------------------------------------- in sentences


def character(force: MissingForce) -> Iterator[str]:
    """Harmonics, phase and growth of a missing force."""
    if not force.harmonics:
        yield "Each of its harmonics is lost in noise."
        return
    listed = ", ".join(map(str, force.harmonics))
    several = f"harmonics {listed}, the strongest first" if len(force.harmonics) > 1 else f"harmonic {listed} alone"
    yield f"It has {several}{_parity(force)}; {_phase(force)}."
    amplitude, frequency = force.growth
    if amplitude is not None or frequency is not None:
        of = {"force": "the motion there", "motion": "the load there", "reading": "the reading"}[force.place.kind]
        powers = [f"with {of} to the power {amplitude}"] * (amplitude is not None)
        powers += [f"with the frequency to the power {frequency}"] * (frequency is not None)
        yield f"It grows {', '.join(powers)}."


def share_text(share: float) -> str:
    """A share, with a digit where it is near all.

    >>> share_text(0.9876), share_text(0.613)
    ('98.8 %', '61 %')
    """
    return f"{100 * share:.1f} %" if 0.9 < share < 0.9995 else f"{100 * share:.0f} %"


def _parity(f: MissingForce) -> str:
    odd = {k % 2 for k in f.harmonics}
    if len(f.harmonics) < 2 or len(odd) == 2:
        return ""
    return " (odd ones only)" if odd == {1} else " (even ones only)"


def _phase(f: MissingForce) -> str:
    share = f.dissipative_share
    if np.isnan(share):
        return "its fundamental is lost in noise"
    if f.place.kind == "reading":
        return f"{share_text(share)} of its squared fundamental is in quadrature to the reading"
    against = "load" if f.place.kind == "motion" else "motion"
    taken = f.taken
    flow = "takes energy from" if taken.value > 0.0 else "gives energy to"
    told = f"; it {flow} the structure, {taken} of the most that one so large could" if taken.certain else ""
    return (
        f"{share_text(share)} of its squared fundamental is in quadrature to the {against}, "
        f"{share_text(1.0 - share)} in phase{told}"
    )
