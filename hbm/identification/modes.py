"""Modes of a structure with their residuals, each with its std: what :mod:`hbm.identification.modalfit` finds."""

from dataclasses import dataclass

import numpy as np

from hbm.channels import DERIVATIVES
from hbm.errors import InputError
from hbm.fourier import Array
from hbm.identification.beyond import Beyond
from hbm.measurement.responses import FrequencyResponses
from models.display import Displayed

CERTAIN = 5.0
"""Standard deviations from which a delay is one."""

FITS = 4.0
"""Misfit above which it is doubted that there are such modes."""

SURE = 3.0
"""Standard deviations from which the drive moves with the force in a mode above the band."""


@dataclass(frozen=True, eq=False)
class Modes(Displayed):
    """Modes fitted to frequency responses.

    Attributes
    ----------
    responses : FrequencyResponses
    hz, hz_std, ratio, ratio_std : (r,) array
        Natural frequencies [Hz], ascending, and damping ratios.
    A, A_std : (c, r) array
        Product of a channel's shape and that of the drive [1/kg].
    above, above_std, beside, below, below_std : (c,) array
        U [m/N], V [m s2/N] and L [1/kg]. Losses of modes beyond the band are fitted beside them, and not listed.
    phase, phase_std : float
        By which the force leads the channel that stands for it [rad]; 0 where that is the force.
    delays, delays_std : (c,) array
        By which channels come after the force, against the modes [s]; 0 where none is seen. The modes are without them.
    chi2_reduced : float
        Misfit; deviations are multiplied by its root where it is above 1, or their size was not known.
    damping, damping_std : (r, r) array or None
        Viscous damping between the modes [1/s], where they damp one another; of normal modes there is none but ratios.
    phases_misfit : float or None
        Misfit with phases of each channel in each mode, where that is most of what is left: shapes are not real.
    beyond : Beyond or None
        A mode next above the band, where the data ask for it; U and V are what it and all others add at rest.
    """

    responses: FrequencyResponses
    hz: Array
    hz_std: Array
    ratio: Array
    ratio_std: Array
    A: Array
    A_std: Array
    above: Array
    above_std: Array
    beside: Array
    below: Array
    below_std: Array
    phase: float
    phase_std: float
    delays: Array
    delays_std: Array
    chi2_reduced: float
    damping: Array | None = None
    damping_std: Array | None = None
    phases_misfit: float | None = None
    beyond: Beyond | None = None

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.hz)

    @property
    def leaves_more(self) -> bool:
        """Whether they leave plainly more than noise, where its size is known."""
        return self.responses.sized and self.chi2_reduced > FITS

    def __repr__(self) -> str:
        """List the modes."""
        lines = [
            f"{f:.6g} ± {sf:.2g} Hz, damping ratio {z:.4g} ± {sz:.2g}"
            for f, sf, z, sz in zip(self.hz, self.hz_std, self.ratio, self.ratio_std, strict=True)
        ]
        return "\n".join([f"{len(self)} modes, misfit {self.chi2_reduced:.3g} noise variances", *lines])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the channels: delays, one sentence each."""
        late = np.flatnonzero(self.delays)
        t, std, names = self.delays[late], self.delays_std[late], list(self.responses.channels)
        if not len(late):
            return ()
        alone = "; of one mode alone, a shape that is not real looks the same" if len(self) == 1 else ""
        advice = f"against the phases of all modes{alone}. It is taken off here: align the channels in the file"
        if len(names) == len(late) > 1 and np.ptp(t) < CERTAIN * np.linalg.norm(std):
            mean = float(np.average(t, weights=std**-2.0))
            return (f"all channels come {_beside(mean, float(np.sum(std**-2.0) ** -0.5))} the force, {advice}",)
        return tuple(
            f"{names[j]} comes {_beside(self.delays[j], self.delays_std[j])} the force, {advice}" for j in late
        )

    def flexibility(self, *, masses: bool, beyond: bool) -> Array:
        """The one number of each channel that comes nearest to its residuals in the band, (c,) [m/N].

        In a narrow band the three residual terms are hardly told apart, and one of them alone says nothing. It is above
        the static flexibility where a mode next above the band is among what it stands for.

        Parameters
        ----------
        masses, beyond : bool
            Whether what is below the band is told by L, and the mode above it by itself; else they are among what the
            number stands for.
        """
        squared = (2 * np.pi * self.responses.hz[:, None]) ** 2
        order = np.array([DERIVATIVES[quantity] for quantity in self.responses.channels.values()])
        weight = np.where(np.isfinite(self.responses.H), squared**order / self.responses.std**2, 0.0)
        if self.beyond is None:
            rest = self.above + self.beside * squared
        else:
            rest = self.beyond.rest + (0.0 if beyond else self.beyond.answer(squared))
        rest = rest - (0.0 if masses else self.below / squared)
        return np.asarray(np.sum(weight * rest, axis=0) / np.sum(weight, axis=0))

    def shapes(self, drive: str | None) -> tuple[Array, Array, Array]:
        """Mass-normalised shapes of the channels (c, r), their standard deviations, and the shape at the drive (r,).

        Parameters
        ----------
        drive : str or None
            Channel at the point that is driven, along the force. Without one the drive's shapes are 1, and those of
            the channels carry their scale.

        Raises
        ------
        InputError
            If the channel is none, or does not move with the force in a mode.
        """
        if drive is None:
            return self.A, self.A_std, np.ones(len(self))
        self.responses.expect_drive(drive)
        names = list(self.responses.channels)
        own, std = self.A[names.index(drive)], self.A_std[names.index(drive)]
        for f, a, s in zip(self.hz, own, std, strict=True):
            if a <= 0.0:
                raise InputError(
                    f"modal: mode at {f:.6g} Hz: {drive} moves against the force ({a:.2g} ± {s:.2g} 1/kg); must be the "
                    "channel at the point driven, along the force"
                )
        root = np.sqrt(own)
        relative = np.hypot(self.A_std / np.abs(self.A), 0.5 * std / own)
        relative[names.index(drive)] = 0.5 * std / own
        return self.A / root, np.abs(self.A / root) * relative, root

    def shape_beyond(self, drive: str | None) -> tuple[Array, float] | None:
        """Shape of the mode above the band, (c,), and that at the drive, as of :meth:`shapes`; None where none is sure.

        It is one where the drive moves with the force.
        """
        if self.beyond is None or drive is None:
            return None if self.beyond is None else (self.beyond.A, 1.0)
        at = list(self.responses.channels).index(drive)
        own, std = self.beyond.A[at], self.beyond.A_std[at]
        return (self.beyond.A / np.sqrt(own), float(np.sqrt(own))) if own > SURE * std else None


def _beside(delay: float, std: float) -> str:
    """How much later or earlier, with its standard deviation."""
    return f"{1e3 * abs(delay):.5g} ± {1e3 * std:.2g} ms {'after' if delay > 0.0 else 'before'}"
