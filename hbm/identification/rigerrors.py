"""What a rig file is uncertain by, in the parameters of a law: one number at a time.

Friction is reconstructed with the numbers of the rig: a modulus, a load, the place of a sensor. Noise says nothing of
their errors, and many records do not average them out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hbm.fourier import Array
from hbm.identification.fit import LeastSquares
from hbm.identification.known import TOLD, Known, known_by, tolerance_text
from hbm.identification.lawfit import LawFit
from hbm.identification.start import candidate, scales_of
from hbm.inverse.observed import observe
from hbm.inverse.reconstruction import Reconstruction
from hbm.parallel import one_thread
from models.display import Displayed
from models.plausible import quiet


@dataclass(frozen=True, eq=False)
class RigErrors(Displayed):
    """What errors of the numbers of a rig file do to the parameters of a law.

    Attributes
    ----------
    law : str
    names, units : tuple of str, (p,)
        The parameters that were fitted.
    known : Known
        The numbers of the rig file, and what records leave of their tolerances.
    changes : mapping of str to (p,) array
        Change of the parameters where that number is a tolerance larger.
    """

    law: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    known: Known
    changes: Mapping[str, Array]

    @property
    def tolerances(self) -> Mapping[str, float]:
        """Standard deviation of each number of the rig file: relative, of a delay in seconds."""
        return self.known.tolerances

    @property
    def std(self) -> Array:
        """Standard deviations of the parameters by all of them, (p,)."""
        return self.known.errors(np.array(list(self.changes.values())))

    def __repr__(self) -> str:
        """What they do to each parameter, and which do most."""
        rows = [f"{name} ± {std}, most by {most}" for name, std, most in self.told]
        said = f"{self.law}, by what the rig file may be off by, beside noise: {'; '.join(rows)}"
        where = ": hbm inverse makes a rig file of that" if self.known.asked else ""
        return f"{said}\n{self.known.asks}{where}" if self.known.asks else said

    @property
    def told(self) -> list[tuple[str, str, str]]:
        """Each parameter, its standard deviation with its unit, and the numbers that do most to it, in words."""
        rows, size = [], self.known.size
        for i, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            own = {key: float(change[i]) * s for (key, change), s in zip(self.changes.items(), size, strict=True)}
            most = sorted(own.items(), key=lambda item: -abs(item[1]))[:TOLD]
            changes = (f"{key} ({self._off(key)}: {change:+.2g})" for key, change in most)
            rows.append((name, f"{self.std[i]:.2g}{'' if unit == '1' else f' {unit}'}", ", ".join(changes)))
        return rows

    def _off(self, key: str) -> str:
        """What a number is off by, as far as sensors leave its tolerance."""
        return tolerance_text(key, self.tolerances[key] * float(self.known.size[list(self.changes).index(key)]))


@one_thread
@quiet()
def rig_errors(fit: LawFit, reconstruction: Reconstruction, tolerances: Mapping[str, float] | None = None) -> RigErrors:
    """What errors of the numbers of a rig file do to the parameters of a law that was identified with it.

    Each number in turn is taken a standard deviation off, contact signals are reconstructed again, and the law is
    fitted again from where it was. Where sensors contradict each other with it off they know it better than that.

    Parameters
    ----------
    fit : LawFit
        Of :func:`hbm.identification.identify.identify`.
    reconstruction : Reconstruction
        That it was fitted to.
    tolerances : mapping of str to float, optional
        As for :func:`hbm.contact_errors`.

    Returns
    -------
    RigErrors
    """
    rig, entries = reconstruction.rig, fit.parameters.entries
    held = tuple(p.name for p in entries if p.held)
    of = candidate(fit.law, rig.contact.law, scales_of(reconstruction), held)
    shown = np.isin(reconstruction.spectra.records, fit.records)
    problem = LeastSquares(of, observe(reconstruction).of(shown))
    problem.answers(of.x)  # where the others start from
    free = [i for i, p in enumerate(entries) if not p.held]
    values = of.coordinates.values(of.x)
    known, others = known_by(reconstruction, tolerances)

    def changed(again: Reconstruction) -> Array:
        other = LeastSquares(of, observe(again).of(shown))
        other.model.start_from(problem.model)
        return np.asarray(of.coordinates.values(other.search(of.x)) - values)[free]

    names, units = zip(*((entries[i].name, entries[i].unit) for i in free), strict=True)
    changes = {key: other.per_tolerance(changed(other.found)) for key, other in others.items()}
    return RigErrors(fit.name, names, units, known, changes)
