"""Modes of a structure from its frequency responses: frequencies, damping ratios, shapes, residuals, each with its std.

The response of channel j per force is (i omega)^d (sum_r A_jr / (omega_r^2 - omega^2 + 2 i zeta_r omega_r omega) + U_j
+ V_j omega^2 - L_j / omega^2): normal modes, what modes above the band answer at rest and next to it, and what modes
below it do as masses; d is 0, 1 or 2 for displacement, velocity and acceleration. Where the data ask for them there are
losses of modes above and below, - i (W_j omega + S_j / omega^3): beside peaks that are known to 1e-5 they are seen, and
modes would be off without them by several of their deviations.

All of it is fitted by weighted least squares, which is the most likely answer for the noise stated, over poles alone:
see :mod:`.projection`. Modes are added one at a time, where what is left asks for one most, as long as the Bayesian
information criterion falls: no pole is picked by hand.

A channel that comes late by tau turns by exp(-i omega tau), at all modes and between them: a fit that is not as good as
the noise is tried with a delay of each channel. A delay is believed where it is sure, and describes the channels better
than phases of their own in each mode, which shapes that are not real have, for as many numbers as each of both takes.

Shapes are not real where modes damp one another: see :mod:`.dampedmodes`. With a channel at the drive these are real,
mass-normalised, and have a full damping matrix. What is still not real comes from modes beyond the band, or is not
linear.
"""

from dataclasses import dataclass, replace

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.identification.dampedmodes import Coupled, coupled
from hbm.identification.modalproblem import Problem
from hbm.identification.modes import CERTAIN, Modes
from hbm.identification.projection import REST
from hbm.measurement.responses import FrequencyResponses

MOST_MODES = 30

LIGHT = 0.05
"""Losses of modes beyond the band are this part at most of all that they answer; what is more is of another kind."""

CLOSE = 1.5
"""Misfit above which what the channels ask for is not small, and one step does not tell their delays."""


FALL = 0.1
"""A drive is asked whether it is there where the misfit falls below this part without one."""

PART = 0.1
"""A channel moves in a mode by this part of that which moves most, at least, where its sign says where the force is."""

TAKEN = 0.5
"""Delays are believed that take at least this part of what a fit without them leaves beyond the noise."""


@dataclass(frozen=True)
class _Fit:
    """Unknowns x of a problem with so many modes, and the fit with one less that they were found from."""

    problem: Problem
    x: Array
    modes: int
    before: "_Fit | None" = None

    @property
    def poles(self) -> Array:
        return self.problem.poles(self.x, self.modes)

    @property
    def bic(self) -> float:
        return self.problem.bic(self.x, self.modes)

    @property
    def misfit(self) -> float:
        return self.problem.misfit(self.x, self.modes)

    @property
    def sure(self) -> Array:
        """Which delays (c,) are beyond doubt."""
        found = self.problem.described(self.x, self.modes)
        return np.asarray(np.abs(found.delays) > CERTAIN * found.delays_std)

    def of(self, problem: Problem) -> "_Fit":
        """The same modes in another problem."""
        turns = np.where(problem.sought, self.problem.turns(self.x), 0.0)
        return _Fit(problem, problem.fitted(self.poles, turns), self.modes, self.before)


def fit_modes(
    responses: FrequencyResponses, modes: int | None = None, *, phase: bool = False, drive: str | None = None
) -> Modes:
    """Fit modes to frequency responses.

    Parameters
    ----------
    responses : FrequencyResponses
    modes : int, optional
        How many in the band; as many as the data ask for where omitted.
    phase : bool
        Whether the channel that stands for the force, such as a shaker's voltage, may be off by one phase.
    drive : str, optional
        Channel at the point that is driven, along the force: no mode is added in which it moves against the force.

    Raises
    ------
    InputError
        If the drive is no channel, moves against the force or is elsewhere, there are too few frequencies, for one mode
        or for as many as are asked for, or nothing moves.
    """
    responses.expect_drive(drive)
    n, c = len(responses.hz), len(responses.channels)
    if n < 8:
        raise InputError(f"modal: {n} frequencies at which the force excites; must be at least 8")
    most = (2 * n * c - REST * c) // (2 + c)  # as many unknowns as numbers were measured
    if modes is not None and modes > most:
        raise InputError(f"modal: modes = {modes}; must be <= {most} with {n} frequencies of {c} channels")
    problem = Problem(responses, phase, drive)
    if not problem.together.measured.any():
        raise InputError("modal: no channel moves; must be driven by the force")
    found = _finished(_searched(problem, modes), fixed=modes is not None)
    if _doubtful(found):
        found = _with_delays(problem, found, modes, phase=phase, drive=drive)
    damped = None if drive is None or not found.modes else _damped(found, drive, fixed=modes is not None)
    misfit = found.misfit if damped is None else damped.misfit
    if drive is not None and (misfit > CLOSE or not responses.sized):
        anywhere = _searched(Problem(responses, phase, None), modes)
        if anywhere.misfit < FALL * misfit:
            _expect_there(_finished(anywhere, fixed=modes is not None), drive)
    if not found.modes:
        raise InputError("modal: no mode stands out of the noise; must be measured around one")
    if damped is None:
        return _beside_phases(found, found.problem.described(found.x, found.modes), found.bic)
    return _beside_phases(found, damped.described(), damped.bic)


def _searched(problem: Problem, modes: int | None) -> _Fit:
    """As many modes as are asked for, or as the data ask for."""
    best = _Fit(problem, problem.fitted(np.empty((0, 2))), 0)
    for _ in range(modes or MOST_MODES):
        start = np.vstack([best.poles, problem.further(best.poles, best.x)])
        tried = problem.fitted(start, problem.turns(best.x))
        if modes is None and not problem.asks_for(tried, best.x, best.modes + 1):
            break
        best = _Fit(problem, tried, best.modes + 1, best)
    return best


def _finished(found: _Fit, *, fixed: bool) -> _Fit:
    """With the error of the force by a fit, and what modes beyond the band do where it is asked for."""
    if not found.modes:
        return found
    problem = found.problem.seeking(found.problem.sought)
    if problem.together.by_force.any():
        problem.expect(found.x, found.modes)
        found = found.of(problem)
    found = _beside_beyond(found, fixed=fixed)
    problem = found.problem
    lossy = found.of(problem.lossy())
    light = lossy.problem.losses(lossy.x, lossy.modes) < LIGHT
    return lossy if light and lossy.bic < found.bic else _Fit(problem, found.x, found.modes, found.before)


def _beside_beyond(found: _Fit, *, fixed: bool) -> _Fit:
    """With a mode above the band where it is asked for, and fewer in it, where one of those stood for that alone."""
    best = found
    for tried in (found, *(() if fixed or found.before is None else (found.before.of(found.problem),))):
        near = tried.of(tried.problem.beyond(tried.x, tried.modes))
        near = near.of(near.problem.beyond(near.x, near.modes))
        best = near if near.bic < best.bic else best
    return best


def _damped(found: _Fit, drive: str, *, fixed: bool) -> Coupled | None:
    """Modes that damp one another, if they do; fewer of them, where one of normal modes stood for that alone."""
    best = coupled(found.problem, found.x, found.modes, drive)
    while best and not fixed and found.before and found.before.modes > 1:
        found = found.before.of(found.problem)
        fewer = coupled(found.problem, found.x, found.modes, drive)
        if fewer is None or fewer.bic >= best.bic:
            break
        best = fewer
    return best


def _beside_phases(found: _Fit, modes: Modes, bic: float) -> Modes:
    """Modes with the misfit of shapes that are not real, where these take most of what is left."""
    noise = 1.0 if found.problem.responses.sized else 0.0
    if modes.chi2_reduced < CLOSE * noise:
        return modes
    free = found.of(found.problem.free())
    taken = free.misfit - noise < (1.0 - TAKEN) * (modes.chi2_reduced - noise) and free.bic < bic
    return replace(modes, phases_misfit=free.misfit) if taken else modes


def _doubtful(found: _Fit) -> bool:
    """Whether channels may come late."""
    if not found.modes or found.misfit > CLOSE or not found.problem.responses.sized:
        return True
    return bool((np.abs(found.problem.pulls(found.x, found.modes)) > CERTAIN).any())


def _with_delays(problem: Problem, plain: _Fit, modes: int | None, *, phase: bool, drive: str | None) -> _Fit:
    """The same with delays where they are believed, or a word on a channel that moves against the force."""
    late = _finished(_searched(problem.late(), modes), fixed=modes is not None)
    if not late.modes:
        return plain
    sure = late.sure
    if sure.any() and _better(late, plain) and late.modes > phase:  # of one mode a phase and a delay are one
        plain = late.of(late.problem.seeking(np.append(late.problem.sought[0], sure)))
        against = late
    elif plain.modes:
        return plain
    else:
        against = late.of(late.problem.seeking(plain.problem.sought))
    if drive is not None:
        _expect_along(against, drive)
    return plain


def _better(late: _Fit, plain: _Fit) -> bool:
    """Whether delays describe channels better than none, and than phases of their own in each mode."""
    most = 1.0 + (1.0 - TAKEN) * (plain.misfit - 1.0)
    little = plain.modes and (late.bic >= plain.bic or (plain.problem.responses.sized and late.misfit > most))
    return not little and late.bic < late.of(late.problem.free()).bic


def _expect_along(found: _Fit, drive: str) -> None:
    """Refuse a drive that moves against the force in all modes that are found wherever it is."""
    own = found.problem.described(found.x, found.modes).A[list(found.problem.responses.channels).index(drive)]
    if (own < 0.0).all():
        raise InputError(
            f"modal: {drive} moves against the force in all {found.modes} modes: its sign, or that of the force, is "
            "reversed; must be at the place of the force, along it: turn the sign of one of the two in the file"
        )


def _expect_there(anywhere: _Fit, drive: str) -> None:
    """Refuse a drive that moves with the force in some of the modes found wherever it is, and against it in others."""
    if not anywhere.modes:
        return
    found, names = anywhere.problem.described(anywhere.x, anywhere.modes), list(anywhere.problem.responses.channels)
    sure = CERTAIN * found.A_std < np.abs(found.A)
    counts = sure & (np.abs(found.A) > PART * np.abs(found.A).max(axis=0))
    against = counts & (found.A < 0.0)
    own = names.index(drive)
    if not against[own].any() or not (counts & ~against)[own].any():
        return
    along = [name for name, some, turned in zip(names, counts, against, strict=True) if some.any() and not turned.any()]
    other = f"; {' and '.join(along)} {'does' if len(along) == 1 else 'do'}" if along else "; no other channel does"
    raise InputError(
        f"modal: {drive} moves against the force at {', '.join(f'{hz:.4g}' for hz in found.hz[against[own]])} Hz and "
        f"with it in other modes; --drive must be at the place of the force and move with it in all{other}"
    )
