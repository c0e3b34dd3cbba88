"""A branch of periodic solutions in physical terms, with what is known of its accuracy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from continuation import Branch, Point, Problem
from hbm.balance.problem import AnyBalance, State
from hbm.balance.solution import PeriodicSolution, amplitudes, describe, phases
from hbm.errors import InputError, channel_named
from hbm.fourier import Array, FourierBasis
from hbm.labelled import coefficient_columns, coefficient_names, common, dataset, frame, repeated
from hbm.response.assessment import Assessment
from hbm.response.bifurcation import Bifurcation
from hbm.response.kinks import kinks
from hbm.stability.multipliers import Stability
from models.display import Displayed
from models.jointed import AnyRig
from models.scalars import FORCE, HZ


@dataclass(frozen=True, eq=False)
class ChannelCurve:
    """One channel along a curve.

    Attributes
    ----------
    unit : str
    coefficients : (points, 2H+1) array
        Fourier coefficients a_0, a_1..a_H, b_1..b_H at every point.
    peak : (points,) array
        Largest magnitude over the period; of the zero-mean signal for `slip`, the maximum for `normal`.
    rms : (points,) array
        Root mean square over the period.
    """

    unit: str
    coefficients: Array
    peak: Array
    rms: Array

    def __repr__(self) -> str:
        """Peaks and size."""
        least, most = (f"{value:.6g}" for value in (self.peak.min(), self.peak.max()))
        unit = f" {self.unit}" if self.unit else ""
        return f"{len(self.peak)} points, peak {least} to {most}{unit}, {self.coefficients.shape[1] // 2} harmonics"

    @property
    def amplitude(self) -> Array:
        """Amplitude of harmonics 0..H, (points, H+1)."""
        return amplitudes(self.coefficients)

    @property
    def phase(self) -> Array:
        """Phase of harmonics 0..H against the force's cosine, (points, H+1) [rad], negative for a lag."""
        return phases(self.coefficients)


def expect_alike(curves: Sequence["ResponseCurve"], where: str) -> None:
    """Refuse curves that are not all traced along the same.

    Raises
    ------
    InputError
    """
    along = sorted({curve.parameter for curve in curves})
    if len(along) > 1:
        raise InputError(f"{where}: curves along {', '.join(along)}; must all be along the same")


@dataclass(frozen=True, eq=False)
class ResponseCurve(Displayed):
    """A branch of periodic solutions in physical terms.

    Attributes
    ----------
    rig : Rig or JointedRig
        Rig that was computed.
    points : tuple of PeriodicSolution
        In the order of travel.
    branch : continuation.Branch
        The branch in scaled unknowns: tangents, flags, why it ended.
    problem : HarmonicBalance or JointBalance
        Problem that the branch solves.
    assessment : Assessment or None
        Its numerical error, where it was estimated (:func:`hbm.response.accuracy.frequency_response`).
    stability : tuple of Stability, optional
        Stability of every point, where it was worked out (:func:`hbm.response.bifurcations.with_stability`).
    doubtful : (points,) bool array, optional
        Where that is not known: multipliers closer to the unit circle than their error come and go, or more harmonics
        and samples judge otherwise.
    bifurcations : tuple of Bifurcation
        Found with it, in the order of travel.
    """

    rig: AnyRig
    points: tuple[PeriodicSolution, ...]
    branch: Branch
    problem: AnyBalance
    assessment: Assessment | None = None
    stability: tuple[Stability, ...] | None = None
    doubtful: npt.NDArray[np.bool_] | None = None
    bifurcations: tuple[Bifurcation, ...] = ()

    @property
    def basis(self) -> FourierBasis:
        """Fourier basis of the curve."""
        return self.problem.basis

    @property
    def level(self) -> float:
        """Nominal force amplitude [N], along the force the largest that was asked for; of each point :attr:`force`."""
        return self.problem.level

    @property
    def parameter(self) -> str:
        """What the curve is traced along, as a key of the rig file: ``frequency_hz``, or ``excitation.amplitude``."""
        return HZ if self.problem.parameter == "frequency" else FORCE

    @property
    def unit(self) -> str:
        """Unit of that, 1 where it has none."""
        return "Hz" if self.parameter == HZ else "N"

    @property
    def suffix(self) -> str:
        """The unit as it stands behind a number, with a blank; empty where it has none."""
        return "" if self.unit == "1" else f" {self.unit}"

    @property
    def held(self) -> list[str]:
        """Frequency and force with their units, but for that which the curve is traced along."""
        said = {HZ: f"{self.points[0].hz:g} Hz", FORCE: f"{self.level:g} N"}
        return [text for key, text in said.items() if key != self.parameter]

    @cached_property
    def hz(self) -> Array:
        """Excitation frequency of every point, (points,) [Hz]."""
        return np.array([p.hz for p in self.points])

    @cached_property
    def force(self) -> Array:
        """Force amplitude of every point, (points,) [N]."""
        return np.array([p.level for p in self.points])

    @cached_property
    def channels(self) -> dict[str, ChannelCurve]:
        """Channels by name: the rig's, and drive, slip, slip_velocity, friction, normal."""
        return {name: self[name] for name in self.points[0].channels}

    @cached_property
    def _known(self) -> dict[str, ChannelCurve]:
        """Channels that were asked for."""
        return {}

    def _channel(self, name: str) -> ChannelCurve:
        signals = [p.channels[name] for p in self.points]
        return ChannelCurve(
            unit=signals[0].unit,
            coefficients=np.array([s.coefficients for s in signals]),
            peak=np.array([s.peak for s in signals]),
            rms=np.array([s.rms for s in signals]),
        )

    def __getitem__(self, name: str) -> ChannelCurve:
        """Channel by name."""
        if name not in self._known:
            channel_named(self.points[0].channels, name)
            self._known[name] = self._channel(name)
        return self._known[name]

    @property
    def peak(self) -> PeriodicSolution:
        """The point of largest drive displacement."""
        return self.points[int(np.argmax(self["drive"].peak))]

    @property
    def traced(self) -> Problem:
        """Problem that the branch solves, for continuation."""
        return self.problem

    def solution_at(self, x: Array, lam: float) -> PeriodicSolution:
        """A solution of the traced problem in physical terms."""
        return describe(self.problem, x, lam)

    def balance_at(self, x: Array, lam: float) -> tuple[AnyBalance, State]:
        """The balance of the rig at a value of the parameter, and the state of unknowns of the traced problem."""
        return self.problem, self.problem.unpack(x, lam)

    def value_at(self, lam: float) -> float:
        """Parameter of the curve there: frequency [Hz], or force [N] along a force curve."""
        return self.problem.hz_at(lam) if self.problem.parameter == "frequency" else self.problem.at(lam)[1]

    def number_at(self, lam: float) -> str:
        """What else of the rig changes along the curve, with its value there: nothing."""
        return ""

    @cached_property
    def values(self) -> Array:
        """Parameter of the curve at every point, (points,)."""
        return np.array([self.value_at(p.lam) for p in self.branch.points])

    @property
    def past_start(self) -> str:
        """Says how far the curve folds back past its start before it comes to its end; empty where it does not."""
        begin, end = float(self.values[0]), self.value_at(self.branch.settings.lam_end)
        furthest = float(self.values.min() if end > begin else self.values.max())
        if furthest == begin or self.branch.closed:
            return ""
        return f"the curve folds back past its start at {begin:.6g}{self.suffix}, to {furthest:.6g}{self.suffix}"

    @cached_property
    def stable(self) -> npt.NDArray[np.bool_] | None:
        """Whether each point is stable, (points,); None where that was not worked out."""
        return None if self.stability is None else np.array([s.stable for s in self.stability])

    @property
    def folds(self) -> list[float]:
        """Where the curve turns back, in Hz (or N along a force curve); not for a kink, :mod:`hbm.response.kinks`."""
        return [self.turn_at(p) for p in self.branch.points if p in self.folded]

    def turn_at(self, point: Point) -> float:
        """Parameter of the curve at the fold just before a point."""
        return self.value_at(point.fold_lam or point.lam)

    @cached_property
    def folded(self) -> frozenset[Point]:
        """Points of its branch just behind folds that are no kinks."""
        points = [p for p in self.branch.points if p.fold]
        narrow = kinks(points, lambda p: (p.x if p.fold_x is None else p.fold_x, self.turn_at(p)), lambda p: True)
        return frozenset(points).difference(*narrow)

    @property
    def corners(self) -> list[float]:
        """Where the curve has a kink so sharp that the step had to be fitted to it, in Hz (or N).

        Where a slip phase is born or dies the curve may have one; most such changes bend it too little.
        """
        found = (p for p in self.branch.points if p.corner)
        return [self.value_at(p.corner_lam if p.corner_lam else p.lam) for p in found]

    @property
    def lift_off(self) -> list[tuple[float, float]]:
        """Frequency ranges (or force ranges) where the tip would lift off, [(first, last), ...]."""
        return self._where([p.lift_off for p in self.points])

    @property
    def walking(self) -> list[tuple[float, float]]:
        """Frequency ranges (or force ranges) where friction pushes a free body along: no motion is periodic there."""
        return self._where([p.walks for p in self.points])

    @property
    def unsolved(self) -> list[tuple[float, float]]:
        """Ranges of what varies where a law is not solved at its samples: more of them are needed there."""
        return self._where([p.unsolved for p in self.points])

    def _where(self, flags: Sequence[bool]) -> list[tuple[float, float]]:
        """Ranges of the curve's parameter over which points have a flag, [(first, last), ...]."""
        at, edges = self.values, np.flatnonzero(np.diff([False, *flags, False]))
        return [(float(at[i:j].min()), float(at[i:j].max())) for i, j in zip(edges[::2], edges[1::2], strict=True)]

    @cached_property
    def dense(self) -> Self:
        """The curve with motions between its points, so many that lines from one to the next draw it.

        They lie on the cubics between its points (:meth:`continuation.Branch.dense`): whoever reads the curve between
        its points reads it here. Their stability is that of the point before, beyond a bifurcation of that behind.
        """
        found = self._with_motions_between()
        vars(found)["dense"] = found  # it is, and a figure asks each curve for it once more in each panel
        return found

    def _with_motions_between(self) -> Self:
        branch = self.branch.dense()
        own = {id(point): solution for point, solution in zip(self.branch.points, self.points, strict=True)}
        points = tuple(own.get(id(p)) or self.solution_at(p.x, p.lam) for p in branch.points)
        if self.stability is None or self.doubtful is None:
            return replace(self, branch=branch, points=points)
        arclengths = np.array([p.arclength for p in branch.points])
        like = self._judged_as(arclengths)
        behind = np.searchsorted(arclengths, [b.special.arclength for b in self.bifurcations])
        return replace(
            self,
            branch=branch,
            points=points,
            stability=tuple(self.stability[i] for i in like),
            doubtful=self.doubtful[like],
            bifurcations=tuple(replace(b, behind=int(i)) for b, i in zip(self.bifurcations, behind, strict=True)),
        )

    def _judged_as(self, arclengths: Array) -> npt.NDArray[np.intp]:
        """Points of the curve that tell the stability at arclengths on it."""
        at = np.array([p.arclength for p in self.branch.points])
        behind = np.searchsorted(at, arclengths)
        turns = at.copy()  # from where on a point speaks for the stretch before it
        for b in reversed(self.bifurcations):
            turns[b.behind] = b.special.arclength
        return np.asarray(behind - (arclengths < turns[behind]))

    def to_xarray(self) -> Any:
        """Coefficients (channel, point, coefficient), peaks and rms values, as an xarray.Dataset with units.

        Frequency and force of every point are the coordinates hz and level. Along another number, or the force, its
        values are the coordinate parameter; the attribute parameter is its key in the rig file.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        names, curves = list(self.channels), list(self.channels.values())
        units = [c.unit for c in curves]
        unit = common(units)
        variables = {
            "coefficients": (
                ("channel", "point", "coefficient"),
                np.stack([c.coefficients for c in curves]),
                unit,
            ),
            "peak": (("channel", "point"), np.stack([c.peak for c in curves]), unit),
            "rms": (("channel", "point"), np.stack([c.rms for c in curves]), unit),
        }
        coordinates = {
            "channel": (("channel",), names, ""),
            "unit": (("channel",), units, ""),
            "coefficient": (("coefficient",), coefficient_names(self.basis.H), ""),
            "hz": (("point",), self.hz, "Hz"),
            "level": (("point",), self.force, "N"),
            **({} if self.parameter == HZ else {"parameter": (("point",), self.values, self.unit)}),
            **({} if self.stable is None else {"stable": (("point",), self.stable, "")}),
        }
        held = {} if self.parameter == FORCE else {"level_N": float(self.level)}
        return dataset("to_xarray", variables, coordinates, rig=self.rig.name, parameter=self.parameter, **held)

    def to_dataframe(self) -> Any:
        """One row a point and channel, as a pandas.DataFrame: hz, channel, unit, peak, rms and every coefficient.

        level is the force of the point [N], parameter the number that the curve is traced along, unless that is the
        frequency.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        curves, points = self.channels, len(self.points)
        return frame(
            "to_dataframe",
            {
                "point": np.tile(np.arange(1, points + 1), len(curves)),
                "hz": np.tile(self.hz, len(curves)),
                "level": np.tile(self.force, len(curves)),
                **({} if self.parameter == HZ else {"parameter": np.tile(self.values, len(curves))}),
                "channel": repeated(list(curves), points),
                "unit": repeated([self.points[0][name].unit for name in curves], points),
                "peak": np.concatenate([c.peak for c in curves.values()]),
                "rms": np.concatenate([c.rms for c in curves.values()]),
                **coefficient_columns(np.stack([c.coefficients for c in curves.values()])),
            },
        )

    @property
    def complete(self) -> bool:
        """Whether the curve reached its end, or its start again."""
        return self.branch.complete or self.branch.closed

    def __repr__(self) -> str:
        """Say what was found."""
        top, values = self.peak, self.values
        along = "" if self.parameter == HZ else f" from {values[0]:.5g} to {values[-1]:.5g} {self.unit}"
        text = (
            f"{len(self.points)} points{along} at {self.held[0]}, H = {self.basis.H}, {self.basis.N_t} samples, "
            f"{self.problem.structure.n} modes; peak {top.channels['drive'].peak * 1e3:.4g} mm "
            f"at {values[self.points.index(top)]:.4g} {self.unit}; {len(self.folds)} folds, "
            f"{len(self.corners)} corners" + (f"; {self.past_start}" if self.past_start else "")
        )
        for low, high in self.unsolved:
            text += f"; no solution from {low:.5g} to {high:.5g}{self.suffix}, laws are not solved at their samples"
        return text if self.complete else f"{text}; partial: {self.branch.message}"
