"""The result of a diagnosis: :class:`Diagnosis`, in sentences and as JSON (docs/reference/data_files.md)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from hbm.diagnosis.remainder import Remainder, percent
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.floored import FlooredCampaign
from models.display import Displayed
from models.jointed import AnyRig

Verdict = Literal["consistent", "cause-found", "main-cause", "unexplained"]
NAMED: tuple[Verdict, ...] = ("cause-found", "main-cause")
"""Verdicts that name a cause and have an extended rig."""

SCHEMA = 1

NOTHING_TELLS = "no experiment that was simulated would"
"""Said where none tells the cause from another one."""

BELIEF = ((0.97, "as good as certain"), (0.9, "likely"), (0.5, "more likely than not"), (0.0, "open"))
"""What a confidence is in words."""


@dataclass(frozen=True)
class Estimate:
    """A number, its standard deviation and unit; a name, such as a channel's, has neither."""

    value: float | str
    std: float = 0.0
    unit: str = "1"

    def json(self) -> dict[str, Any]:
        """As in a diagnosis file."""
        if isinstance(self.value, str):
            return {"value": self.value}
        return {"value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class Errors:
    """How far a model is from records: relative rms error, and mean square in standard deviations."""

    nrmse: float
    chi2_reduced: float

    def json(self) -> dict[str, float]:
        """As in a diagnosis file."""
        return {"nrmse": self.nrmse, "chi2_reduced": self.chi2_reduced}


@dataclass(frozen=True)
class Ranked:
    """A candidate after its fit.

    Attributes
    ----------
    label, name : str
        With and without its channel.
    parameters : dict of str to Estimate
    bic, chi2 : float
        On the records fitted.
    held_out_nrmse : float or None
        None where it was not scored on the records held out.
    """

    label: str
    name: str
    parameters: Mapping[str, Estimate]
    bic: float
    chi2: float
    held_out_nrmse: float | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis(Displayed):
    """The result of a diagnosis: what the simulation gets wrong, the cause, and the gain of the extended model.

    Attributes
    ----------
    verdict : str
        consistent; cause-found; main-cause, which is decisive but leaves much; or unexplained.
    cause : str or None
        Name of the cause, docs/reference/causes.md.
    parameters : dict of str to Estimate
    confidence : float
        How often a repetition of the measurement would end in this verdict, times how often such verdicts were right in
        blind cases, 0 to 1; docs/theory/diagnosis.md.
    not_separable : tuple of str
        Candidates that these records cannot tell from the cause.
    separate_by : str
        The measurement that would; empty where none that was simulated would.
    seconds : tuple of str
        Of two causes what these records cannot tell from the second one, with its numbers.
    room : str
        What a room does to the structure, where noise is left beside it and not without.
    remainder : Remainder
        The misfit that the model of the verdict leaves: the extended one, or the calibrated nominal.
    errors : dict
        nominal, calibrated, extended -> train, held_out -> Errors.
    held_out_records : tuple of int or str
    ranking : tuple of Ranked
    evidence : tuple of str
        A sentence per observation.
    extended : Rig, JointedRig or None
        The rig with the cause.
    nominal, calibrated, extended_fit : Evaluation or None
        The models beside the records fitted; the last without a cause is None.
    campaign : Campaign or None
        The records fitted.
    held : dict of str to Evaluation
        nominal, calibrated, extended beside the records held out.
    held_campaign : Campaign or None
        The records held out.
    tried : tuple of Evaluation
        The fits that `ranking` lists, in its order.
    noise : str
        What the standard deviations are of, in words: what does not repeat counts as noise where it is known.
    """

    verdict: Verdict
    cause: str | None
    parameters: Mapping[str, Estimate]
    confidence: float
    not_separable: tuple[str, ...]
    separate_by: str
    remainder: Remainder
    errors: Mapping[str, Mapping[str, Errors]]
    held_out_records: tuple[int | str, ...]
    ranking: tuple[Ranked, ...]
    evidence: tuple[str, ...]
    extended: AnyRig | None = field(default=None, repr=False)
    nominal: Evaluation | None = field(default=None, repr=False)
    calibrated: Evaluation | None = field(default=None, repr=False)
    extended_fit: Evaluation | None = field(default=None, repr=False)
    campaign: Campaign | None = field(default=None, repr=False)
    held: Mapping[str, Evaluation] = field(default_factory=dict, repr=False)
    held_campaign: Campaign | None = field(default=None, repr=False)
    tried: tuple[Evaluation, ...] = field(default=(), repr=False)
    noise: str = field(default="noise", repr=False)
    seconds: tuple[str, ...] = ()
    room: str = ""

    @property
    def floored(self) -> bool:
        """Whether its records are of many lines or of a backbone, not of one frequency and its harmonics."""
        return isinstance(self.campaign, FlooredCampaign)

    @property
    def gain(self) -> dict[str, float]:
        """Errors of the extended model on the records held out over those of the calibrated one; 1 without a cause."""
        before, after = (self.errors.get(name, {}).get("held_out") for name in ("calibrated", "extended"))
        if before is None or after is None:
            return {"held_out_nrmse_ratio": 1.0, "held_out_chi2_ratio": 1.0}
        return {
            "held_out_nrmse_ratio": after.nrmse / before.nrmse,
            "held_out_chi2_ratio": after.chi2_reduced / before.chi2_reduced,
        }

    def json(self) -> dict[str, Any]:
        """As a diagnosis file has it."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "cause": self.cause,
            "parameters": {name: p.json() for name, p in self.parameters.items()},
            "confidence": self.confidence,
            "not_separable": list(self.not_separable),
            "separate_by": self.separate_by,
            "remainder": self.remainder.json(),
            "errors": {
                model: {part: e.json() for part, e in parts.items()} for model, parts in self.errors.items()
            },
            "gain": self.gain,
            "held_out_records": list(self.held_out_records),
            "ranking": [_ranked(r) for r in self.ranking],
            "evidence": list(self.evidence),
        }  # fmt: skip

    def __repr__(self) -> str:
        return "\n".join([self._headline(), *(f"  {line}" for line in self.evidence), *self._advice()])

    @property
    def belief(self) -> str:
        """The confidence in words."""
        return next(words for least, words in BELIEF if self.confidence >= least)

    def _headline(self) -> str:
        left = percent(self.remainder.size)
        if self.verdict == "consistent" and not self.remainder.structured:
            return "Consistent: no discrepancy beyond noise."
        if self.verdict == "consistent" and not self.remainder.size:
            return (
                "Consistent: what remains is no larger than noise; it is not spread like noise, and no cause that was "
                "tried explains that."
            )
        if self.verdict == "consistent":
            return (
                f"Consistent to {left} of the response: more than noise, and no cause that was tried takes most of it."
            )
        if self.verdict == "unexplained" and not self.remainder.structured:
            hidden = percent(self.errors["calibrated"]["train"].nrmse)
            return f"Unexplained: the noise is {hidden} of the response; records like these agree with any model."
        if self.verdict == "unexplained":
            return (
                f"Unexplained: the simulation is off by {left} of the response beyond noise, and no cause that was "
                "tried takes most of it."
            )
        said = ", ".join(_said(name, p) for name, p in self.parameters.items())
        first = "Cause found" if self.verdict == "cause-found" else "Main cause"
        rest = {
            (True, "cause-found"): f"what remains is {left} of the response",
            (True, "main-cause"): f"the rest, {left} of the response, is unexplained",
        }.get((self.remainder.structured, self.verdict), "what remains is noise")
        named = f"{self.cause}{f' ({said})' if said else ''}{self.alternatives}"
        return f"{first}: {named}, {self.belief} ({self.confidence:.2f}); {self._gained()}; {rest}."

    def _gained(self) -> str:
        before = self.errors.get("calibrated", {}).get("held_out")
        if before is not None and before.chi2_reduced <= 1.0:
            return "records held out leave noise without it too, and say nothing of it"
        ratio = self.gain["held_out_nrmse_ratio"]
        return f"error on records held out {ratio:.3g} times that of the calibrated rig file"

    @property
    def alternatives(self) -> str:
        """What may stand in place of the cause, as it is said behind its name: the other one, or how many there are."""
        others = len(self.not_separable)
        return "" if not others else f" or {self.not_separable[0] if others == 1 else f'one of {others} others'}"

    def _advice(self) -> list[str]:
        if not self.not_separable:
            return []
        how = self.separate_by or NOTHING_TELLS
        return [f"Not told apart: {', '.join(self.not_separable)}.", f"To tell them apart: {how}"]


def _said(name: str, p: Estimate) -> str:
    if isinstance(p.value, str):
        return f"{name} {p.value}"
    return f"{name} = {p.value:.4g} +- {p.std:.2g}{'' if p.unit == '1' else f' {p.unit}'}"


def _ranked(r: Ranked) -> dict[str, Any]:
    return {
        "cause": r.label if r.label.startswith("parameter:") else r.name,
        "parameters": {name: p.json() for name, p in r.parameters.items()},
        "bic": r.bic,
        "held_out_nrmse": r.held_out_nrmse,
    }
