"""How many harmonics hold the force of a rig: a tone that is cut drives nothing, and no error estimate misses it."""

from hbm.errors import InputError, expect_whole
from hbm.fourier import FourierBasis, default_samples
from models.jointed import AnyRig

USUAL = 15
"""Harmonics where none are asked for."""

ABOVE = 8
"""Harmonics above the highest of the force, for what the nonlinearity makes of it."""


def highest_tone(rig: AnyRig) -> int:
    """Number of the highest harmonic of the force."""
    return max(k for k, _, _ in rig.excitation.tones)


def holding(rig: AnyRig, usual: int = USUAL) -> int:
    """The usual harmonics, or as many as hold a force that has harmonics of its own, with some above."""
    return max(usual, highest_tone(rig) + ABOVE) if rig.excitation.harmonics else usual


def harmonics_for(rig: AnyRig, harmonics: int | None, where: str) -> int:
    """Harmonics as asked for, or as many as hold the force.

    Raises
    ------
    InputError
        If it is no whole number, or the force has a harmonic above it.
    """
    if harmonics is None:
        return holding(rig)
    expect_whole(harmonics, "harmonics", where)
    tone = highest_tone(rig)
    if harmonics < tone:
        raise InputError(
            f"{where}: harmonics = {harmonics} and harmonic {tone} in excitation.harmonics of {rig.name}; "
            f"must be >= {tone}; more where joints or contact answer to it"
        )
    return harmonics


def basis_for(rig: AnyRig, harmonics: int | None, samples: int | None, where: str) -> FourierBasis:
    """Harmonics as of :func:`harmonics_for`, and samples as asked for, or as many as do for them."""
    H = harmonics_for(rig, harmonics, where)
    return FourierBasis(H, samples or default_samples(H))
