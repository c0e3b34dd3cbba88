"""Starting points of fits: physical scales of the contact from the reconstruction, and starts spread around them."""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.identification.coordinates import Coordinate, Coordinates, Linear, Ratio, coordinate_of
from hbm.inverse.reconstruction import Reconstruction
from hbm.rigfiles.lawchoice import known_law
from hbm.rigfiles.laws import find_law
from models.friction import FrictionLaw, Parameter, describe, idle, parameters, settings

MOST_STARTS = 8
"""Starts besides the first, at most."""

LIGHT = 0.05
"""|T| / R is read where the reaction is more than this fraction of the load."""

RELIABLE = {"1": 0.3, "m": 1.0, "N/m": 1.0}
"""Logarithmic spread of starts of parameters whose scale the records show; a law of these alone has one start."""

VAGUE = 3.0
"""Logarithmic spread of the others."""

SEED = 20261121


@dataclass(frozen=True)
class Scales:
    """Physical scales of a contact.

    Friction coefficient, stiffness [N/m], load [N]; median, least and largest peak of slip speed over the records that
    slip [m/s]; Omega [rad/s]. Where none slips, the largest |T| / R that was seen; else 0.
    """

    mu: float
    stiffness: float
    load: float
    speed: float
    slowest: float
    fastest: float
    Omega: float
    sticks_at: float = 0.0

    def of(self, name: str, known: Parameter) -> float | None:
        """Scale of a parameter by its unit, None where nothing is known."""
        if known.unit == "1":
            return self.mu if name.startswith("mu") else None
        by_unit = {
            "N/m": self.stiffness,
            "m": self.mu * self.load / self.stiffness,
            "m/s": self.speed / 3.0,
            "N s/m": 0.01 * self.stiffness / self.Omega,
        }
        return by_unit.get(known.unit)


def scales_of(reconstruction: Reconstruction) -> Scales:
    """Scales of the contact of reconstructed records.

    The friction coefficient is the largest |T| / R of the records that slip; the stiffness the slope of T over the
    displacement of the contact in those that do not, else that of mu P over a tenth of the largest slip.
    """
    r, slips = reconstruction, reconstruction.slips
    T, R = r["friction"].samples, r["normal"].samples
    load = r.rig.contact.normal_load
    ratio = np.where(R > LIGHT * load, np.abs(T) / np.maximum(R, LIGHT * load), 0.0).max(axis=1)
    mu = float(np.median(ratio[slips])) if slips.any() else 1.2 * float(ratio.max())
    chosen = slips if slips.any() else np.ones(len(r), dtype=bool)
    speeds = np.abs(r["slip_velocity"].samples).max(axis=1)[chosen]
    Omega = 2 * np.pi * float(np.median(r.spectra.hz))
    return Scales(
        mu,
        _stiffness(r, mu, load),
        load,
        float(np.median(speeds)),
        float(speeds.min()),
        float(speeds.max()),
        Omega,
        0.0 if slips.any() else float(ratio.max()),
    )


def _stiffness(r: Reconstruction, mu: float, load: float) -> float:
    stuck = ~r.slips if not r.slips.all() else np.ones(len(r), dtype=bool)
    T, u = r["friction"].complex[stuck, 1:], r["slip"].complex[stuck, 1:]
    weight = 1.0 / np.maximum(r["friction"].coefficient_std[stuck, 1:], np.finfo(float).tiny) ** 2
    compliance = -float(np.sum(weight * (T.conj() * u).real) / np.sum(weight * np.abs(T) ** 2))
    largest = float(np.ptp(r["slip"].samples, axis=1).max()) / 2
    return 1.0 / compliance if compliance > 0.0 else mu * load / (0.1 * largest)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law to be fitted: a member of its class with its settings, coordinates, and the first start.

    Attributes
    ----------
    law : FrictionLaw
        With the parameters of the first start.
    label : str
        Name that the caller gave it.
    coordinates : Coordinates
    x : (n,) array
        First start.
    """

    law: FrictionLaw
    label: str
    coordinates: Coordinates
    x: Array

    def starts(self) -> Array:
        """Further starts around the first, (m, n); none where the records show the scale of every parameter."""
        free = self.coordinates.free
        if all(_spread(self.coordinates.parameters[name], c) <= max(RELIABLE.values()) for name, c in free.items()):
            return np.zeros((0, len(self.x)))
        from scipy.stats import qmc  # it takes long, and few starts are drawn

        low, high = self.coordinates.bounds
        spread = np.array([_spread(self.coordinates.parameters[name], c) for name, c in free.items()])
        draws = qmc.LatinHypercube(len(self.x), rng=np.random.default_rng(SEED)).random(MOST_STARTS)
        low, high = np.maximum(low, self.x - spread), np.minimum(high, self.x + spread)
        return np.asarray(low + draws * (high - low))

    def at(self, x: Array) -> FrictionLaw:
        """The law with the parameters at coordinates."""
        values = dict(zip(self.coordinates.parameters, self.coordinates.values(x).tolist(), strict=True))
        return replace(self.law, **values)  # type: ignore[type-var]


def _spread(known: Parameter, coordinate: Coordinate) -> float:
    """Spread of the other starts around the first."""
    if isinstance(coordinate, Ratio):
        return 0.5
    if isinstance(coordinate, Linear):
        return float(coordinate.high - coordinate.low) if np.isfinite(coordinate.high) else VAGUE
    return RELIABLE.get(known.unit, VAGUE)


def candidate(law: str | type | FrictionLaw, rig_law: FrictionLaw, scales: Scales, hold: Iterable[str]) -> Candidate:
    """Prepare a law for identification.

    Parameters
    ----------
    law : str, law class, or law
        Name in :data:`models.LAWS` or ``file.py:Class``; a law with parameters starts there.
    rig_law : FrictionLaw
        The rig's law: a law of its class takes over its settings.
    scales : Scales
    hold : iterable of str
        Parameters that are not fitted, wherever a law has them, or of one law, ``stribeck.exponent``.

    Raises
    ------
    InputError
        If the law is unknown, has nothing to fit, or nothing is known to start from.
    """
    label = law if isinstance(law, str) else str(getattr(law, "name", law))
    law_type, given = _law_type(law)
    template = given or (rig_law if type(rig_law) is law_type else None)
    known = template or _known(law_type)
    described = {name: p for name, p in describe(law_type).items() if known is None or name not in idle(known)}
    free = [name for name in described if not {name, f"{law_type.name}.{name}"} & set(hold)]
    if not free:
        raise InputError(f"identify: law {label} has no parameter to fit; take another")
    first = {name: _first(name, p, scales, given, known, law_type) for name, p in described.items()}
    made = _settings(law_type, known)
    coordinates = Coordinates(
        described,
        {
            name: coordinate_of(
                name, described[name], _size(described[name], first[name], scales.of(name, described[name]))
            )
            for name in free
        },
        {name: first[name] for name in described if name not in free},
    )
    return Candidate(law_type(**first, **made), label, coordinates, coordinates.of(first))


def _law_type(law: str | type | FrictionLaw) -> tuple[Any, FrictionLaw | None]:
    if isinstance(law, str):
        try:
            return find_law(law, Path()), None
        except InputError as refused:
            raise InputError(f'identify: law "{law}"; {refused}') from None
    return (law, None) if isinstance(law, type) else (type(law), law)


def _known(law_type: type) -> FrictionLaw | None:
    found = known_law(law_type)
    return None if found is None else found.law


def _first(
    name: str, p: Parameter, scales: Scales, given: FrictionLaw | None, known: FrictionLaw | None, law_type: Any
) -> float:
    """First value of a parameter: as given, else by its unit, else by what is known about it."""
    if given is not None:
        return float(parameters(given)[name])
    scale = scales.of(name, p)
    if scale is not None:
        return scale * (1.1 if p.at_least is not None else 1.0)
    if known is not None:
        return float(parameters(known)[name])
    default = {f.name: f.default for f in fields(law_type)}[name]
    if default is MISSING:
        raise InputError(
            f"identify: nothing is known of parameter {name} of law {law_type.name}; pass the law with its parameters "
            "to start from"
        )
    return float(default)


def _size(p: Parameter, first: float, scale: float | None) -> float:
    """Scale of the coordinate of a parameter, > 0."""
    if first != 0.0:
        return abs(first)
    if scale is not None:
        return scale
    return p.upper if np.isfinite(p.upper) and p.upper > 0.0 else 1.0


def _settings(law_type: type, known: FrictionLaw | None) -> Mapping[str, Any]:
    return {} if known is None else {name: getattr(known, name) for name in settings(law_type)}
