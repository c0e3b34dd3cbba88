"""Results of an identification: parameters of laws with uncertainties, how well laws fit, and which is best."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import special

from hbm.fourier import Array
from hbm.inverse.sensing import Complex
from models.friction import FrictionLaw

FITS = 1e-3
"""A law fails where a chi2 as large is less probable than this by noise alone."""

FLOORED = 0.5
"""A floor for numerics is told where noise alone makes less than this of a reduced chi2 of 1."""

CORRELATED = 0.3
"""Correlations are printed from this size up."""


@dataclass(frozen=True)
class FittedParameter:
    """One parameter of a law.

    Attributes
    ----------
    name, unit : str
    value, std : float
        Standard deviation 0 where it was held.
    held : bool
        Not fitted.
    undetermined : str
        Why the records do not determine it; empty where they do.
    """

    name: str
    unit: str
    value: float
    std: float
    held: bool = False
    undetermined: str = ""

    def __repr__(self) -> str:
        """Value, standard deviation and unit, followed by warnings."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.held:
            return f"{self.value:.6g}{unit} (held)"
        relative = f" ({self.std / abs(self.value):.2%})" if self.std < 10.0 * abs(self.value) else ""
        note = f"  not determined: {self.undetermined}" if self.undetermined else ""
        return f"{self.value:.6g} +/- {self.std:.2g}{unit}{relative}{note}"


@dataclass(frozen=True, eq=False)
class FittedParameters(Mapping[str, FittedParameter]):
    """Parameters of a law by name, and how their errors go together.

    Attributes
    ----------
    entries : tuple of FittedParameter, (p,)
    covariance : (p, p) array
        Zero for those held.
    """

    entries: tuple[FittedParameter, ...]
    covariance: Array

    def __getitem__(self, name: str) -> FittedParameter:
        """Parameter by name."""
        for entry in self.entries:
            if entry.name == name:
                return entry
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        """Names, in the law's order."""
        return (entry.name for entry in self.entries)

    def __len__(self) -> int:
        """Number of parameters."""
        return len(self.entries)

    @property
    def free(self) -> int:
        """How many were fitted."""
        return sum(not entry.held for entry in self.entries)

    @property
    def correlation(self) -> Array:
        """Correlation matrix, (p, p); zero for those held."""
        std = np.sqrt(np.diag(self.covariance))
        scale = np.where(std > 0.0, std, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))

    def __repr__(self) -> str:
        """List the parameters, then the correlations that matter."""
        width = max(len(name) for name in self)
        lines = ["[[Parameters]]", *(f"    {e.name + ':':<{width + 1}}  {e}" for e in self.entries)]
        names, C = list(self), self.correlation
        pairs = sorted(
            ((C[i, j], names[i], names[j]) for i in range(len(C)) for j in range(i)), key=lambda pair: -abs(pair[0])
        )
        strong = [f"    C({b}, {a}) = {c:+.4f}" for c, a, b in pairs if abs(c) > CORRELATED]
        return "\n".join([*lines, *([f"[[Correlations]] (from {CORRELATED:g} up)", *strong] if strong else [])])


@dataclass(frozen=True)
class Quality:
    """Quality of a fit on the data it was fitted to.

    Attributes
    ----------
    chi2 : float
        Sum of squared residuals in standard deviations.
    informed : float
        Number of coefficients that the measurement decides.
    free : int
        Parameters fitted.
    evaluations : int
        Periods of the law, or steady states, that were computed.
    by_noise : float
        The reduced chi2 that noise alone makes: below 1 where standard deviations hold a floor for what numerics leave.
    """

    chi2: float
    informed: float
    free: int
    evaluations: int
    by_noise: float = 1.0

    @property
    def dof(self) -> float:
        """Degrees of freedom."""
        return max(self.informed - self.free, 1.0)

    @property
    def chi2_reduced(self) -> float:
        """chi2 per degree of freedom."""
        return self.chi2 / self.dof

    @property
    def floor(self) -> str:
        """What a floor for numerics does to the reduced chi2, in words; empty where it does little."""
        if self.by_noise > FLOORED:
            return ""
        return f"noise alone makes {self.by_noise:.2g}, standard deviations hold a floor for numerics"

    @property
    def probability(self) -> float:
        """Probability that noise alone makes so large a chi2."""
        return float(special.chdtrc(self.dof, self.chi2))

    @property
    def fits(self) -> bool:
        """Whether noise alone explains the residuals."""
        return self.probability > FITS

    @property
    def inflation(self) -> float:
        """Factor on standard deviations: more than 1 where the fit fails."""
        return 1.0 if self.fits else float(np.sqrt(self.chi2_reduced))

    @property
    def bic(self) -> float:
        """Bayesian information criterion, chi2 + free ln(informed)."""
        return self.chi2 + self.free * float(np.log(max(self.informed, 1.0)))

    def __repr__(self) -> str:
        """List the numbers; say where the fit fails."""
        lines = [
            "[[Fit Statistics]]",
            f"    # evaluations     = {self.evaluations}",
            f"    # data points     = {self.informed:.0f} (decided by the measurement)",
            f"    # variables       = {self.free}",
            f"    chi-square        = {self.chi2:.5g}",
            f"    reduced chi-square = {self.chi2_reduced:.4g}",
            f"    Bayesian info crit = {self.bic:.5g}",
        ]
        if self.floor:
            lines.append(f"    {self.floor}")
        if not self.fits:
            lines.append(
                f"    FAILS: chi2 is improbable by noise alone (p = {self.probability:.1g}); standard deviations are "
                f"multiplied by {self.inflation:.3g}"
            )
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A law on records that its parameters have not seen.

    Attributes
    ----------
    records : (m,) int array
        Their numbers.
    chi2, informed : (m,) arrays
        Misfit of each record, and the number of its coefficients that the measurement decides.
    relative_error : float
        ||T - predicted|| / ||T|| over all of them, harmonics 1..H.
    how : str
        How they were held out, in words.
    """

    records: npt.NDArray[np.int64]
    chi2: Array
    informed: Array
    relative_error: float
    how: str

    @property
    def chi2_reduced(self) -> float:
        """chi2 per coefficient that the measurement decides."""
        return float(self.chi2.sum() / max(self.informed.sum(), 1.0))

    def __repr__(self) -> str:
        """Summary in one line."""
        return (
            f"held out ({self.how}): chi2 {self.chi2.sum():.5g}, {self.chi2_reduced:.4g} per coefficient; "
            f"error {self.relative_error:.2%}"
        )


@dataclass(frozen=True, eq=False)
class Loops:
    """Measured and fitted loops of r records at 256 phases, 0..1 of a period.

    Attributes
    ----------
    slip, friction : (r, 256) arrays
        Reconstructed [m], [N].
    fitted_slip, fitted_friction : (r, 256) arrays
        Signals by the law; as many harmonics as were measured, and the law's own mean.
    """

    slip: Array
    friction: Array
    fitted_slip: Array
    fitted_friction: Array


@dataclass(frozen=True, eq=False)
class LawFit:
    """A friction law fitted to reconstructed contact signals; arrays over the r records it was fitted to.

    Attributes
    ----------
    name : str
        Name that it was asked for by.
    law : FrictionLaw
        With the fitted values.
    parameters : FittedParameters
    quality : Quality
    records : (r,) int array
    chi2 : (r,) array
        Misfit of each record.
    residual : (r, H) complex array
        Reconstructed less predicted friction, harmonics 1..H [N].
    predicted : (r, H+1) complex array
        Friction of the law [N].
    range_error : (r,) array
        The paper's objective (24) of each record: squared difference of the ranges of reconstructed and predicted
        friction, of as many harmonics [N2].
    loops : Loops
    held_out : HeldOut or None
    notes : tuple of str
        Warnings, a line each.
    """

    name: str
    law: FrictionLaw
    parameters: FittedParameters
    quality: Quality
    records: npt.NDArray[np.int64]
    chi2: Array
    residual: Complex
    predicted: Complex
    range_error: Array
    loops: Loops
    held_out: HeldOut | None = None
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> FittedParameter:
        """Parameter by name."""
        return self.parameters[name]

    @property
    def objective(self) -> float:
        """Mean of the paper's objective (24) over records [N2]."""
        return float(self.range_error.mean())

    def __repr__(self) -> str:
        """Report in the manner of lmfit."""
        records = f"{len(self.records)} record{'s' * (len(self.records) > 1)}"
        lines = [f"[[Law]] {self.name}, {records}", str(self.quality)]
        lines.append(f"    objective (24)     = {self.objective:.4g} N2 per record")
        if self.held_out is not None:
            lines.append(f"    {self.held_out}")
        return "\n".join([*lines, str(self.parameters), *(f"    note: {note}" for note in self.notes)])
