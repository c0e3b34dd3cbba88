"""What a rig file is uncertain by, in the parameters of a law: one number at a time.

Friction is reconstructed with the numbers of the rig: a modulus, a load, the place of a sensor. Noise says nothing of
their errors, and many records do not average them out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.identification.fit import LeastSquares
from hbm.identification.lawfit import LawFit
from hbm.identification.start import candidate, scales_of
from hbm.inverse.observed import observe
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.reconstruction import Reconstruction
from hbm.outputerror.nominal import tolerances as default_tolerances
from hbm.parallel import one_thread
from hbm.sensitivity.scalars import FRICTION
from models.display import Displayed
from models.plausible import quiet
from models.rig import Rig

TOLD = 2
"""So many numbers of the rig file are named for a parameter: those that do most."""


@dataclass(frozen=True, eq=False)
class RigErrors(Displayed):
    """What errors of the numbers of a rig file do to the parameters of a law.

    Attributes
    ----------
    law : str
    names, units : tuple of str, (p,)
        The parameters that were fitted.
    tolerances : mapping of str to float
        Standard deviation of each number of the rig file: relative, of a delay in seconds.
    changes : mapping of str to (p,) array
        Change of the parameters where that number is a standard deviation larger; of a position, smaller.
    """

    law: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    tolerances: Mapping[str, float]
    changes: Mapping[str, Array]

    @property
    def std(self) -> Array:
        """Standard deviations of the parameters by all of them, (p,)."""
        return np.asarray(np.sqrt(np.sum([change**2 for change in self.changes.values()], axis=0)))

    def __repr__(self) -> str:
        """What they do to each parameter, and which do most."""
        rows = [f"{name} ± {std}, most by {most}" for name, std, most in self.told]
        return f"{self.law}, by what the rig file may be off by, beside noise: {'; '.join(rows)}"

    @property
    def told(self) -> list[tuple[str, str, str]]:
        """Each parameter, its standard deviation with its unit, and the numbers that do most to it, in words."""
        rows = []
        for i, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            own = {key: float(change[i]) for key, change in self.changes.items()}
            most = sorted(own.items(), key=lambda item: -abs(item[1]))[:TOLD]
            changes = (f"{key} ({_off(key, self.tolerances[key])}: {change:+.2g})" for key, change in most)
            rows.append((name, f"{self.std[i]:.2g}{'' if unit == '1' else f' {unit}'}", ", ".join(changes)))
        return rows


def _off(key: str, std: float) -> str:
    if key.endswith(".delay"):
        return f"{std:.2g} s"
    return f"{'-' if _downwards(key) else ''}{100.0 * std:.2g} %"


def _downwards(key: str) -> bool:
    """Whether a number is tried smaller: a place further on may lie beyond the beam."""
    return key.endswith(".position")


@one_thread
@quiet()
def rig_errors(fit: LawFit, reconstruction: Reconstruction, tolerances: Mapping[str, float] | None = None) -> RigErrors:
    """What errors of the numbers of a rig file do to the parameters of a law that was identified with it.

    Each number in turn is taken a standard deviation off, contact signals are reconstructed again, and the law is
    fitted again from where it was.

    Parameters
    ----------
    fit : LawFit
        Of :func:`hbm.identification.identify.identify`.
    reconstruction : Reconstruction
        That it was fitted to.
    tolerances : mapping of str to float, optional
        Those of a diagnosis where omitted, :data:`hbm.outputerror.nominal.TOLERANCES`.

    Returns
    -------
    RigErrors
    """
    rig, entries = reconstruction.rig, fit.parameters.entries
    held = tuple(p.name for p in entries if p.held)
    of = candidate(fit.law, rig.contact.law, scales_of(reconstruction), held)
    known = np.isin(reconstruction.spectra.records, fit.records)
    problem = LeastSquares(of, observe(reconstruction).of(known))
    problem.answers(of.x)  # where the others start from
    free = [i for i, p in enumerate(entries) if not p.held]
    values = of.coordinates.values(of.x)
    if tolerances is None:
        tolerances = default_tolerances(rig, reconstruction.spectra.channels)
    off = {key: std for key, std in tolerances.items() if not key.startswith(FRICTION)}

    def changed(key: str, std: float) -> Array:
        again = reconstruct(_one_off(rig, key, std), reconstruction.spectra, formulation=reconstruction.formulation)
        other = LeastSquares(of, observe(again).of(known))
        other.model.start_from(problem.model)
        return np.asarray(of.coordinates.values(other.search(of.x)) - values)[free]

    names, units = zip(*((entries[i].name, entries[i].unit) for i in free), strict=True)
    return RigErrors(fit.name, names, units, off, {key: changed(key, std) for key, std in off.items()})


def _one_off(rig: Rig, key: str, std: float) -> Rig:
    """The rig with one number a standard deviation off."""
    value = rig.number(key)
    if key.endswith(".delay"):
        return rig.with_numbers({key: value + std})
    return rig.with_numbers({key: value * (1.0 - std if _downwards(key) else 1.0 + std)})
