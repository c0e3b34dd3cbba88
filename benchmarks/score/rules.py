"""What counts as right, and the numbers that are taken from one case."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hbm.diagnosis.order import ROOM
from hbm.outputerror.model import FAR
from hbm.outputerror.nominal import TOLERANCES

GROUPS: dict[str, tuple[str, ...]] = {
    "friction": (
        "stribeck-weakening",
        "distributed-microslip",
        "viscous-contact",
        "asymmetric-friction",
        "bristle-memory",
        "variable-normal-load",
        "contact-loss",
    ),
    "structure": (
        "clamp-rotation",
        "clamp-friction",
        "support-rotation-spring",
        "support-flexibility",
        "midplane-stretching",
        "quadratic-drag",
        "stiffness-damping",
        "added-mass",
        "added-spring",
        "attached-resonator",
        "impact-stop",
    ),
    "measurement": (
        "force-distortion",
        "sensor-gain",
        "sensor-delay",
        "sensor-position",
        "swapped-channels",
        "not-steady",
        "drift",
    ),
}
"""Causes of docs/reference/causes.md; beside these the wrong parameters, what is outside, and nulls."""

PARAMETER = "parameter:"
TELLING = {"drift": "parameter"}
"""The parameter that is part of a cause's name, beside the channels."""

NEUTRAL = {"gain": 1.0, "ratio": 1.0}
CLOCK, YOUNG, DRIVE, DRIFT = "clock", "beam.youngs_modulus", "excitation.position", "drift"

NAMING = ("cause-found", "main-cause")
"""Verdicts with a cause; the second leaves a rest unexplained."""


@dataclass(frozen=True)
class Outcome:
    """One case: what was said and what is so.

    Attributes
    ----------
    name : str
    result, answer : dict
        As in the files.
    nominal : dict
        The rig file.
    """

    name: str
    result: Mapping[str, Any]
    answer: Mapping[str, Any]
    nominal: Mapping[str, Any]

    @property
    def failed(self) -> bool:
        return "failed" in self.result

    @property
    def said(self) -> Mapping[str, Any]:
        """The diagnosis; nothing where it failed."""
        return {"verdict": "failed", "cause": None} if self.failed else self.result["diagnosis"]

    @property
    def verdict(self) -> str:
        return str(self.said["verdict"])

    @property
    def named(self) -> bool:
        return self.verdict in NAMING

    @property
    def kind(self) -> str:
        """What the case is by the verdict that would say it best: `cause-found` of every case with a cause."""
        return str(self.answer["verdict"])

    @property
    def rho(self) -> float:
        return float(self.answer["rho"])

    @property
    def right(self) -> bool:
        """Whether the verdict is right: of a cause, its name with what belongs to it, decisive alone or not.

        Outside the catalogue it is `unexplained`, or a name with a rest that is said to be more than imperfections.
        """
        if self.kind == "cause-found":
            return self.named and same_cause(self.said, self.answer)
        return self.verdict == self.kind or (self.kind == "unexplained" and self.rest_seen)

    @property
    def background(self) -> float:
        """Size of the imperfections of the true rig, relative to the response."""
        return float(self.answer.get("background", 0.0))

    @property
    def effect(self) -> float | None:
        """Size of the hidden cause by the same measure; None where the answer does not say."""
        found = self.answer.get("effect")
        return None if found is None else float(found)

    @property
    def dominance(self) -> float | None:
        """Effect over background."""
        if not self.background:
            return np.inf
        return None if self.effect is None else self.effect / self.background

    @property
    def tolerated(self) -> bool:
        """Whether the truth is a number of the rig file that is off by what calibration may move it: it is not wrong.

        By the usual tolerances: blind rig files state none. Nor is a clock, where Young's modulus, which moves all
        natural frequencies by its root, may do the same; nor what drifts by no more than a room makes it.
        """
        if self.answer["cause"] == DRIFT:
            return bool(abs(self.answer["parameters"]["rate"]) * (self.answer["records"] - 1) <= ROOM)
        if self.answer.get("drawn") == CLOCK:
            return bool(abs(self.answer["parameters"]["ratio"] ** 2 - 1.0) <= FAR * TOLERANCES[YOUNG])
        cause = str(self.answer["cause"])
        key = cause.removeprefix(PARAMETER)
        tolerance = TOLERANCES.get(key, TOLERANCES["friction"] if key.startswith("contact.friction.") else None)
        if not is_parameter(cause) or (tolerance is None and key != DRIVE):
            return False
        nominal = nominal_number(self.nominal, key)
        allowed = TOLERANCES["position"] if tolerance is None else tolerance * nominal
        return bool(abs(self.answer["parameters"]["value"] - nominal) <= FAR * allowed)

    @property
    def remainder(self) -> Mapping[str, Any]:
        """What was said to be left; nothing where the diagnosis does not say."""
        return self.said.get("remainder") or {}

    @property
    def rest_seen(self) -> bool:
        """Whether a cause is named, and beside it a structured rest larger than the imperfections of the rig."""
        return self.named and bool(self.remainder.get("structured")) and self.remainder["size"] > self.background

    @property
    def confidence(self) -> float:
        return float(self.said["confidence"])

    @property
    def covered(self) -> bool:
        """Whether the truth is the cause named or among those not told from it."""
        return self.named and (self.right or any(fits_label(x, self.answer) for x in self.said["not_separable"]))

    @property
    def set_size(self) -> int:
        """Causes named or not told from the one named."""
        return len({self.said["cause"], *self.said["not_separable"]})

    @property
    def lacks(self) -> float:
        """What the best model that was fitted leaves beyond noise, in standard deviations."""
        return float(self.result.get("lack_of_fit", np.inf))

    @property
    def explained(self) -> float | None:
        """Share of the calibrated model's excess of chi2, on records held out, that the extended one explains.

        None where there is hardly an excess.
        """
        before, after = (self.held_out(model) for model in ("calibrated", "extended"))
        if before is None or after is None or before < 1.0 + EXCESS:
            return None
        return 1.0 - (after - 1.0) / (before - 1.0)

    def held_out(self, model: str) -> float | None:
        """Mean square misfit, in standard deviations, on records held out."""
        found = self.said["errors"].get(model, {}).get("held_out", {}).get("chi2_reduced")
        return None if found is None else float(found)


EXCESS = 0.1


def same_cause(said: Mapping[str, Any], answer: Mapping[str, Any]) -> bool:
    """Whether the name agrees: of a parameter with its key, of sensors with the channel, exchanged ones in any order.

    A drift agrees with its parameter.
    """
    cause = answer["cause"]
    if said["cause"] != cause:
        return False
    found = {name: p["value"] for name, p in said["parameters"].items()}
    true = answer["parameters"]
    if cause == "swapped-channels":
        return {found.get("channel"), found.get("other")} == {true["channel"], true["other"]}
    telling = [*(["channel"] if "channel" in true else []), *([TELLING[cause]] if cause in TELLING else [])]
    return all(found.get(name) == true[name] for name in telling)


def fits_label(label: str, answer: Mapping[str, Any]) -> bool:
    """Whether a label, such as `sensor-gain a3` or `sensor-gain` alone, may mean the truth."""
    cause, *details = label.split()
    true = answer["parameters"]
    known = {str(true[name]) for name in ("channel", "other", "parameter") if name in true}
    return bool(cause == answer["cause"] and set(details) <= known)


def is_parameter(cause: str) -> bool:
    return cause.startswith(PARAMETER)


@dataclass(frozen=True)
class Estimated:
    """One parameter of a cause rightly named: its relative error, that of its change, and its pull.

    `of_change` is relative to how far the truth is from where the cause has no effect; None where that is nowhere.
    """

    what: str
    of_value: float
    of_change: float | None
    z: float | None


def estimates(outcome: Outcome) -> Iterator[Estimated]:
    """Of an outcome that is right."""
    said, answer = outcome.said["parameters"], outcome.answer
    for name, true in answer["parameters"].items():
        found = said.get(name)
        if isinstance(true, str) or found is None:
            continue
        error, start = found["value"] - true, neutral(outcome, name)
        yield Estimated(
            f"{answer['cause']} {name}",
            abs(error / true) if true else abs(error),
            None if start is None or start == true else abs(error / (true - start)),
            error / found["std"] if found.get("std") else None,
        )


def neutral(outcome: Outcome, name: str) -> float | None:
    """Value of a parameter without effect; None where the effect ends elsewhere, or nowhere in particular."""
    cause = outcome.answer["cause"]
    if is_parameter(cause):
        return nominal_number(outcome.nominal, cause.removeprefix(PARAMETER))
    if cause == "sensor-position" and name == "position":
        channel = outcome.answer["parameters"]["channel"]
        return next(float(c["position"]) for c in outcome.nominal["channels"] if c["name"] == channel)
    if name in NEUTRAL:
        return NEUTRAL[name]
    return 0.0 if name in EFFECT_AT_ZERO else None


EFFECT_AT_ZERO = (
    "coefficient",
    "spread",
    "sigma1",
    "scale",
    "beta",
    "mass",
    "stiffness",
    "axial_stiffness",
    "delay_s",
    "rate",
)
"""Or infinity, of a stiffness: the relative error is the same."""


def nominal_number(nominal: Mapping[str, Any], key: str) -> float:
    """A number of a rig file by its dotted key."""
    found: Any = nominal
    for part in key.split("."):
        found = found[part]
    return float(found)


def load_outcome(result: dict[str, Any], answer: Mapping[str, Any], rig: Path) -> Outcome:
    return Outcome(str(result["case"]), result, answer, tomllib.loads(rig.read_text()))
