"""How far a backbone is from the exact answer: one of its motions solved again with finer numerics."""

from dataclasses import dataclass, replace

import numpy as np

from continuation import ConvergenceError
from hbm.balance.padding import pad
from hbm.fourier import FourierBasis, default_samples
from hbm.modes.amplitudes import solved
from hbm.modes.backbone import Backbone, described, point_of
from hbm.parallel import one_thread
from models.jointed import AnyRig


@dataclass(frozen=True)
class NumericalChange:
    """How much one motion changes, relatively, with a finer discretisation; nan where it cannot be solved with it.

    Attributes
    ----------
    amplitude : float
        Amplitude of the drive [m].
    harmonics, samples : (float, float)
        Changes of frequency and damping ratio, with 1.5 times the harmonics, twice the samples.
    modes : (float, float) or None
        The same with twice the modes; None where all that the body has are kept.
    """

    amplitude: float
    harmonics: tuple[float, float]
    samples: tuple[float, float]
    modes: tuple[float, float] | None

    @property
    def by_source(self) -> dict[str, tuple[float, float]]:
        """The changes by what was made finer."""
        sources = {"harmonics": self.harmonics, "samples": self.samples, "modes": self.modes}
        return {source: change for source, change in sources.items() if change is not None}


@one_thread
def numerical_change(backbone: Backbone, i: int | None = None) -> NumericalChange:
    """How far a point of a backbone is from the exact answer, measured by solving it again.

    Parameters
    ----------
    backbone : Backbone
    i : int, optional
        The point; that of largest damping where omitted.

    Returns
    -------
    NumericalChange
        Of that point.
    """
    i = int(np.argmax(backbone.damping_ratio)) if i is None else i
    rig, (H, N_t) = backbone.rig, (backbone.problem.balance.basis.H, backbone.problem.balance.basis.N_t)
    more, most = rig.with_modes(2 * rig.structure.n), H + (H + 1) // 2
    return NumericalChange(
        float(backbone.amplitude[i]),
        harmonics=_changed(backbone, i, rig, FourierBasis(most, max(N_t, default_samples(most)))),
        samples=_changed(backbone, i, rig, FourierBasis(H, 2 * N_t)),
        modes=_changed(backbone, i, more, FourierBasis(H, N_t)) if more.structure.n > rig.structure.n else None,
    )


def _changed(backbone: Backbone, i: int, rig: AnyRig, basis: FourierBasis) -> tuple[float, float]:
    """Relative changes of frequency and damping ratio of a point on another rig and basis."""
    near, problem = backbone.branch.points[i], type(backbone.problem)(rig, basis)
    balance = backbone.problem.unpack(near.x, near.lam)[0]
    scale = problem.scale(near.lam)
    state = backbone.points[i].state
    sustain = problem.pack_sustain(state.F if problem.grows else balance.relief, scale)
    x = np.append((pad(problem.balance, state) - problem.rest) / scale, [problem.balance.pack(state)[1], sustain])
    try:
        point = point_of(problem, solved(problem, x, near.lam))
    except ConvergenceError:
        return float("nan"), float("nan")
    again = replace(
        backbone,
        rig=rig,
        points=described(problem, [point]),
        branch=replace(backbone.branch, points=(point,)),
        problem=problem,
    )
    return float(again.hz[0] / backbone.hz[i] - 1), float(again.damping_ratio[0] / backbone.damping_ratio[i] - 1)
