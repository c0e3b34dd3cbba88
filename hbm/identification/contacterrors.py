"""What a rig file is uncertain by, in the forces and motions that are reconstructed with it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.identification.known import Known, known_by
from hbm.inverse.reconstruction import Reconstructed
from models.display import Displayed


@dataclass(frozen=True, eq=False)
class ContactErrors(Displayed):
    """What errors of the numbers of a rig file do to forces and motions that were reconstructed with them.

    Attributes
    ----------
    reconstruction : Reconstruction or JointReconstruction
    known : Known
    signals : mapping of str to (k, r, N) array
        Changes of each signal's samples where each number is a tolerance larger.
    energies : mapping of str to (k, r) array
        Changes of each number per record.
    """

    reconstruction: Reconstructed
    known: Known
    signals: Mapping[str, Array]
    energies: Mapping[str, Array]

    def std(self, name: str) -> Array:
        """Standard deviation of a signal's samples (r, N), or of a number per record (r,)."""
        return self.known.errors(self.signals[name] if name in self.signals else self.energies[name])

    @property
    def stated(self) -> Reconstructed:
        """The reconstruction with these deviations beside those of noise."""
        return self.reconstruction.with_rig_std(self.std)

    @property
    def told(self) -> list[tuple[str, str, str, str, str]]:
        """Each quantity: its largest value, standard deviations by noise and by the rig file, and what does most."""
        rows = []
        for name, s in self.reconstruction.signals.items():
            r, i = np.unravel_index(int(np.abs(s.samples).argmax()), s.samples.shape)
            rows.append(self._row(f"{name} [{s.unit}]", s.samples[r, i], s.std[r, i], self.signals[name][:, r, i]))
        for name, e in self.reconstruction.energies.items():
            at = int(np.abs(e.value).argmax())
            rows.append(self._row(f"{name} [{e.unit}]", e.value[at], e.std[at], self.energies[name][:, at]))
        return rows

    def _row(self, name: str, value: float, noise: float, changes: Array) -> tuple[str, str, str, str, str]:
        by_rig = float(self.known.errors(changes))
        return name, f"{abs(value):.4g}", f"{noise:.2g}", f"{by_rig:.2g}", self.known.most(changes)

    def __repr__(self) -> str:
        """What they do to each quantity, where it is largest."""
        rows = [f"{name} {value} ± {rig}, most by {most}" for name, value, _, rig, most in self.told]
        return "\n".join(["by what the rig file may be off by, beside noise:", *rows, *filter(None, [self.known.asks])])


def contact_errors(reconstruction: Reconstructed, tolerances: Mapping[str, float] | None = None) -> ContactErrors:
    """What errors of the numbers of a rig file do to forces and motions that were reconstructed with them.

    Friction is what the structure does not explain, and the structure is told by the rig file: a modulus, a load, the
    place of a sensor. Noise says nothing of their errors, which are the same in all records. Each number in turn is
    taken a tolerance off, and records are reconstructed again; where sensors then contradict each other they know the
    number better than its tolerance does.

    Parameters
    ----------
    reconstruction : Reconstruction or JointReconstruction
    tolerances : mapping of str to float, optional
        Standard deviations of numbers, relative, of a delay in seconds, 0 for one that is exact. Those not given are
        as in a diagnosis.

    Returns
    -------
    ContactErrors
    """
    known, others = known_by(reconstruction, tolerances)

    def changed(values: Callable[[Reconstructed], Array]) -> Array:
        here = values(reconstruction)
        changes = [o.per_tolerance(values(o.found) - here) for o in others.values()]
        return np.array(changes).reshape(-1, *here.shape)

    return ContactErrors(
        reconstruction,
        known,
        {name: changed(_samples_of(name)) for name in reconstruction.signals},
        {name: changed(_number_of(name)) for name in reconstruction.energies},
    )


def _samples_of(name: str) -> Callable[[Reconstructed], Array]:
    return lambda found: found.signals[name].samples


def _number_of(name: str) -> Callable[[Reconstructed], Array]:
    return lambda found: found.energies[name].value
