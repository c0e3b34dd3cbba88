"""What may be wrong with an experiment: causes of docs/reference/causes.md and some of no catalogue, of any strength.

A maker looks at the scene, draws what is not strength (a place, a channel, a sign) and returns a `Hidden`: a strength
in whose first order the residual grows, the true rig of that strength, and the answer.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.truth.beam import modes_of
from tests.truth.effects import (
    AddedMass,
    AddedSpring,
    AttachedResonator,
    AxialPumping,
    BreathingCrack,
    ClampFriction,
    ClampRotation,
    Effect,
    ImpactStop,
    MidplaneStretching,
    PointForce,
    QuadraticDrag,
    SpringPot,
    Stinger,
    SupportFlexibility,
    SupportRotationSpring,
)
from tests.truth.laws import Coulomb, Iwan, Law, LuGre, Parallel, PlaceDependent, Stribeck, Viscous
from tests.truth.rig import Sensor, Tone, TrueRig
from tests.truth.simulate import Record, Truth, taken_early

Array = np.ndarray
Rigs = TrueRig | list[TrueRig]


class Unfit(ValueError):
    """A draw that makes no experiment: too few usable records, no slip, no second channel to exchange."""


@dataclass(frozen=True)
class Hidden:
    """One hidden cause.

    `typical` is a guess of the strength whose residual is 100 long; `lower`, `upper` bound the strength, and equal
    bounds fix it. `rigs(strength)` is what to simulate, `records` under what (None: those asked for), `afterwards`
    what happens to the truth on its way to the file. `cause` is None outside the catalogue; `what` says it in words.
    `mild` is the simpler cause that it is where what sets in at a threshold never does.
    """

    cause: str | None
    what: str
    typical: float
    rigs: Callable[[float], Rigs]
    parameters: Callable[[float], Mapping[str, object]]
    lower: float = 0.0
    upper: float = np.inf
    records: Callable[[float], Sequence[Record]] | None = None
    afterwards: Callable[[Truth, float], Truth] = lambda truth, _: truth
    simulated: bool = True  # False: the rig moves as without the cause, only the instruments err
    marched: bool = False  # what happens afterwards takes as long as a simulation
    mild: "Hidden | None" = None


@dataclass(frozen=True)
class Scene:
    """The rig as it is without the cause, its records, how it moves under them, and a maker's dice."""

    rig: TrueRig
    records: tuple[Record, ...]
    truth: Truth
    rng: np.random.Generator

    moved: Array = field(init=False)
    omega: float = field(init=False)
    force: float = field(init=False)
    slip: float = field(init=False)
    slip_speed: float = field(init=False)
    swing: float = field(init=False)
    felt: float = field(init=False)

    def __post_init__(self) -> None:
        """What the highest peak looks like: fundamentals at the sensors, amplitudes at the contact."""
        t, keep = self.truth, self.truth.usable
        keep = keep if keep.any() else np.ones(len(self.records), bool)
        omega = 2 * np.pi * np.array([r.hz for r in self.records])
        moved = np.abs(np.fft.rfft(t.acceleration)[..., 1] * 2 / t.steps) / omega[:, None] ** 2
        most = int((moved.max(axis=1) * keep).argmax())
        found = {
            "moved": moved[most],
            "omega": float(omega[most]),
            "force": self.records[most].force,
            "slip": float(np.ptp(t.u[most]) / 2),
            "slip_speed": float(np.abs(t.v[most]).max()),
            "swing": float(np.ptp(t.R[most]) / 2),
            "felt": float(np.abs(t.acceleration).max()),
        }
        for name, number in found.items():
            object.__setattr__(self, name, number)

    def deflection(self, x: float) -> float:
        """Amplitude at x on the highest peak [m], between the sensors."""
        places = [s.position for s in self.rig.sensors]
        order = np.argsort(places)
        xs = np.array([0.0, *np.array(places)[order], self.rig.length])
        return float(np.interp(x, xs, np.array([0.0, *self.moved[order], 0.0])))

    @property
    def largest(self) -> float:
        return float(self.moved.max())

    def clamp_moment(self) -> float:
        """Amplitude of the clamp's moment there, by the first mode [N m]."""
        fe = self.rig.bare()
        _, V = modes_of(fe, 1)
        place = self.rig.sensors[int(self.moved.argmax())].position
        return float(abs((fe.K[1] @ V)[0] / (fe.row(place) @ V)[0]) * self.largest)

    @property
    def small(self) -> float:
        """A force whose residual is about 100 long [N]."""
        return 1.2e-3 * self.force

    @property
    def work(self) -> float:
        return self.small * self.largest

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))

    def place(self) -> float:
        return float(self.rig.length * self.rng.uniform(0.25, 0.85))

    @property
    def coulomb(self) -> tuple[float, float, float]:
        """mu, critical slip, and the contact's stiffness."""
        law = self.rig.law
        slip = law.critical_slip if isinstance(law, Coulomb) else law.mu * self.rig.normal_load / law.stiffness
        return law.mu, slip, law.mu * self.rig.normal_load / slip

    def sensor(self) -> Sensor:
        return self.rig.sensors[int(self.rng.integers(len(self.rig.sensors)))]

    def with_sensor(self, old: Sensor, new: Sensor) -> TrueRig:
        return replace(self.rig, sensors=tuple(new if s == old else s for s in self.rig.sensors))

    def effect(
        self,
        cause: str | None,
        typical: float,
        make: Callable[[float], Effect],
        what: str = "",
        upper: float = np.inf,
        whole: type[Effect] | tuple[()] = (),
    ) -> Hidden:
        """A cause that is an effect whose fields are its parameters.

        It comes on top of the imperfections of the rig but those of the kind of which it is the `whole`.
        """
        kept = tuple(e for e in self.rig.effects if not isinstance(e, whole))

        def fields_of(s: float) -> Mapping[str, object]:
            return {k: v for k, v in vars(make(s)).items() if not callable(v)}

        def rigs(s: float) -> TrueRig:
            return replace(self.rig, effects=(*kept, make(s)))

        return Hidden(cause, what or str(cause), typical, rigs, fields_of, upper=upper)

    def compliance(self, kind: type[Effect]) -> float:
        """Of a clamp or a support as it is: a hidden cause makes it softer."""
        return sum(1 / e.stiffness for e in self.rig.effects if isinstance(e, kind))

    def law(
        self,
        cause: str | None,
        typical: float,
        make: Callable[[float], Law],
        parameters: Callable[[float], Mapping[str, object]],
        upper: float = np.inf,
        what: str = "",
    ) -> Hidden:
        return Hidden(
            cause, what or str(cause), typical, lambda s: replace(self.rig, law=make(s)), parameters, upper=upper
        )


Maker = Callable[[Scene], Hidden]


def stribeck(scene: Scene) -> Hidden:
    mu, slip, _ = scene.coulomb
    v_s = float(np.exp(scene.rng.uniform(np.log(0.3), np.log(2.0)))) * scene.slip_speed

    def parameters(s: float) -> Mapping[str, object]:
        return {"mu_static": mu, "mu": mu * (1 - s), "stribeck_velocity": v_s}

    def make(s: float) -> Law:
        return Stribeck(mu, mu * (1 - s), v_s, slip)

    return scene.law("stribeck-weakening", 0.01, make, parameters, upper=0.7)


def microslip(scene: Scene) -> Hidden:
    mu, _, stiffness = scene.coulomb
    return scene.law(
        "distributed-microslip", 0.03, lambda s: Iwan(mu, stiffness, s), lambda s: {"spread": s}, upper=1.0
    )


def viscous(scene: Scene) -> Hidden:
    typical = scene.work / (scene.slip * scene.slip_speed)
    law = scene.rig.law
    return scene.law("viscous-contact", typical, lambda s: Parallel((law, Viscous(s))), lambda s: {"coefficient": s})


def asymmetric(scene: Scene) -> Hidden:
    mu, slip, _ = scene.coulomb
    sign = scene.sign()

    def ratio(s: float) -> float:
        return float(np.exp(sign * s))

    return scene.law(
        "asymmetric-friction",
        0.002,
        lambda s: Coulomb(mu, slip, ratio(s)),
        lambda s: {"ratio": ratio(s)},
        upper=0.8,
    )


def bristle(scene: Scene) -> Hidden:
    mu, _, stiffness = scene.coulomb

    def make(s: float) -> Law:
        return LuGre(mu, mu, 1e-3, stiffness, s)

    return scene.law("bristle-memory", scene.work / (scene.slip * scene.slip_speed) * 2, make, lambda s: {"sigma1": s})


def varying_load(scene: Scene) -> Hidden:
    fixed = bool(scene.rng.random() < 0.5)

    def rigs(s: float) -> TrueRig:
        return replace(scene.rig, variable_normal_load=s)

    low = 1.0 if fixed else 0.0
    return Hidden("variable-normal-load", "R(t) varies", 0.012, rigs, lambda s: {"scale": s}, low, 1.0)


def clamp_rotation(scene: Scene) -> Hidden:
    soft = scene.work / scene.clamp_moment() ** 2
    here = scene.compliance(ClampRotation)
    return scene.effect("clamp-rotation", soft, lambda s: ClampRotation(1 / (here + s)), whole=ClampRotation)


def clamp_friction(scene: Scene) -> Hidden:
    moment = scene.clamp_moment()
    limit = float(scene.rng.uniform(0.3, 0.8)) * moment
    # what slides at the clamp moves modes that 16 leave out: once 45 noise units of a record about the second mode;
    # on a background, where every record has a rig of its own, 64 would take three minutes
    scene = replace(scene, rig=replace(scene.rig, modes=32 if scene.rig.newmark else 64))
    here, typical = scene.compliance(ClampRotation), scene.work / moment**2
    slips = scene.effect("clamp-friction", typical, lambda s: ClampFriction(limit, 1 / (here + s)), whole=ClampRotation)
    return replace(slips, mild=clamp_rotation(scene))


def support_rotation(scene: Scene) -> Hidden:
    rotation = scene.slip / scene.rig.arm
    return scene.effect("support-rotation-spring", scene.work / rotation**2, lambda s: SupportRotationSpring(s))


def support_flexibility(scene: Scene) -> Hidden:
    here, typical = scene.compliance(SupportFlexibility), scene.work / scene.swing**2
    return scene.effect(
        "support-flexibility", typical, lambda s: SupportFlexibility(1 / (here + s)), whole=SupportFlexibility
    )


def midplane(scene: Scene) -> Hidden:
    tension = 2 * scene.small * scene.rig.length / (np.pi**2 * scene.largest)
    stiffness = tension * 4 * scene.rig.length / (np.pi * scene.largest) ** 2
    return scene.effect("midplane-stretching", stiffness, lambda s: MidplaneStretching(s))


def drag(scene: Scene) -> Hidden:
    speed = scene.omega * scene.largest
    return scene.effect("quadratic-drag", 2 * scene.small / (scene.rig.length * speed**2), lambda s: QuadraticDrag(s))


def stiffness_damping(scene: Scene) -> Hidden:
    mass = scene.rig.density * scene.rig.area * scene.rig.length / 2
    typical = scene.small / (mass * scene.omega**3 * scene.largest)
    return Hidden("stiffness-damping", "beta", typical, lambda s: replace(scene.rig, beta=s), lambda s: {"beta": s})


def added_mass(scene: Scene) -> Hidden:
    x = scene.place()
    typical = scene.small / (scene.omega**2 * scene.deflection(x))
    return scene.effect("added-mass", typical, lambda s: AddedMass(s, x))


def added_spring(scene: Scene) -> Hidden:
    x = scene.place()
    return scene.effect("added-spring", scene.small / scene.deflection(x), lambda s: AddedSpring(s, x))


def resonator(scene: Scene) -> Hidden:
    """Anywhere in the first band or up to 15 % beside it."""
    x = scene.place()
    near = [r.hz for r in scene.records if r.hz < 1.6 * min(r.hz for r in scene.records)]
    hz = float(scene.rng.uniform(0.85 * min(near), 1.15 * max(near)))
    far = abs((scene.omega / (2 * np.pi * hz)) ** 2 - 1)
    typical = scene.small / (scene.omega**2 * scene.deflection(x)) * max(far, 0.1)
    return scene.effect("attached-resonator", typical, lambda s: AttachedResonator(s, hz, x))


def impact_stop(scene: Scene) -> Hidden:
    x = scene.place()
    most = scene.deflection(x)
    gap = float(scene.rng.uniform(0.3, 0.85)) * most
    return scene.effect("impact-stop", 3 * scene.small / (most - gap), lambda s: ImpactStop(gap, s, x))


def distortion(scene: Scene) -> Hidden:
    harmonic, phase = int(scene.rng.integers(2, 4)), float(scene.rng.uniform(0, 2 * np.pi))

    def rigs(s: float) -> TrueRig:
        return replace(scene.rig, distortion=(Tone(harmonic, s, phase),))

    return Hidden("force-distortion", f"harmonic {harmonic} of the force", 1e-3, rigs, lambda s: {}, upper=0.2)


def gain(scene: Scene) -> Hidden:
    sensor, sign = scene.sensor(), scene.sign()
    return Hidden(
        "sensor-gain",
        "a gain",
        0.015,
        lambda s: scene.with_sensor(sensor, replace(sensor, gain=sensor.gain * (1 + sign * s))),
        lambda s: {"channel": sensor.name, "gain": 1 + sign * s},
        upper=0.5,
        simulated=False,
    )


def polarity(scene: Scene) -> Hidden:
    sensor = scene.sensor()
    return Hidden(
        "sensor-gain",
        "a polarity",
        1.0,
        lambda s: scene.with_sensor(sensor, replace(sensor, gain=-sensor.gain)),
        lambda s: {"channel": sensor.name, "gain": -1.0},
        1.0,
        1.0,
        simulated=False,
    )


def delay(scene: Scene) -> Hidden:
    sensor, sign = scene.sensor(), scene.sign()
    return Hidden(
        "sensor-delay",
        "a delay",
        1e-5,
        lambda s: scene.with_sensor(sensor, replace(sensor, delay=sensor.delay + sign * s)),
        lambda s: {"channel": sensor.name, "delay_s": sign * s},
        upper=1e-3,
        simulated=False,
    )


def sensor_place(scene: Scene) -> Hidden:
    """Towards the middle of the beam, so that it stays on it."""
    sensor = scene.sensor()
    sign = -1.0 if sensor.position > scene.rig.length / 2 else 1.0
    upper = 0.3 * scene.rig.length
    return Hidden(
        "sensor-position",
        "a place",
        0.002,
        lambda s: scene.with_sensor(sensor, replace(sensor, position=sensor.position + sign * s)),
        lambda s: {"channel": sensor.name, "position": sensor.position + sign * s},
        upper=upper,
    )


def swapped(scene: Scene) -> Hidden:
    if len(scene.rig.sensors) < 2:
        raise Unfit("one sensor has none to be exchanged with")
    a, b = scene.rng.choice(len(scene.rig.sensors), 2, replace=False)
    first, second = scene.rig.sensors[int(a)], scene.rig.sensors[int(b)]
    names = {first.name: second.name, second.name: first.name}
    sensors = tuple(replace(s, name=names.get(s.name, s.name)) for s in scene.rig.sensors)
    pair = sorted(names)
    return Hidden(
        "swapped-channels",
        "two channels",
        1.0,
        lambda s: replace(scene.rig, sensors=sensors),
        lambda s: {"channel": pair[0], "other": pair[-1]},
        1.0,
        1.0,
        simulated=False,
    )


def changed(rig: TrueRig, key: str, factor: float) -> TrueRig:
    """The rig with one number of its file multiplied; the stinger goes where the drive is."""
    if key == "excitation.position":
        place = rig.drive * factor
        moved = (replace(e, position=place) if isinstance(e, Stinger) else e for e in rig.effects)
        return replace(rig, drive=place, effects=tuple(moved))
    direct = {
        "beam.youngs_modulus": "youngs_modulus",
        "damping.mass_proportional": "alpha",
        "contact.radius": "radius",
        "contact.normal_load": "normal_load",
    }
    if key in direct:
        return replace(rig, **{direct[key]: getattr(rig, direct[key]) * factor})
    name = key.removeprefix("contact.friction.")
    return replace(rig, law=replace(rig.law, **{name: getattr(rig.law, name) * factor}))


def value(rig: TrueRig, key: str) -> float:
    name = key.rpartition(".")[2]
    if "friction" in key:
        return float(getattr(rig.law, name))
    return float(getattr(rig, {"mass_proportional": "alpha", "position": "drive"}.get(name, name)))


KEYS = {
    "beam.youngs_modulus": 3e-4,
    "damping.mass_proportional": 0.03,
    "contact.radius": 9e-4,
    "contact.normal_load": 3e-3,
    "contact.friction.mu": 5e-3,
    "contact.friction.critical_slip": 5e-3,
    "excitation.position": 1e-3,
}


def wrong(key: str) -> Maker:
    """A nominal number that is wrong, either way."""

    def make(scene: Scene) -> Hidden:
        sign = scene.sign()
        if key == "excitation.position" and scene.rig.drive > 0.85 * scene.rig.length:
            sign = -1.0
        return Hidden(
            f"parameter:{key}",
            key,
            KEYS[key],
            lambda s: changed(scene.rig, key, float(np.exp(sign * s))),
            lambda s: {"value": value(scene.rig, key) * float(np.exp(sign * s))},
            upper=0.1 if key == "excitation.position" else 1.0,
        )

    return make


def not_steady(scene: Scene) -> Hidden:
    """The force had been raised a while ago, not long beside the time that a transient takes."""
    lasting = scene.rng.uniform(0.3, 1.0) * 2 / scene.rig.alpha
    wait = int(np.clip(lasting * min(r.hz for r in scene.records), 32, 100))
    periods = int(scene.rng.integers(10, 40))
    return Hidden(
        "not-steady",
        f"records of {periods} periods, {wait} periods after the force was raised",
        0.5,
        lambda s: scene.rig,
        lambda s: {"decay_rate": scene.rig.alpha / 2},
        upper=1.0,
        afterwards=lambda truth, s: taken_early(truth, s, wait, periods),
        simulated=False,
        marched=True,
    )


def drift(scene: Scene) -> Hidden:
    """value = nominal (1 + rate (record - 1)); records in the order of their numbers."""
    keys = [key for key in KEYS if key not in ("excitation.position", "contact.radius")]
    keys = [key for key in keys if hasattr(scene.rig.law, "critical_slip") or "critical" not in key]
    key, sign, n = str(scene.rng.choice(keys)), scene.sign(), len(scene.records)

    def rigs(s: float) -> Rigs:
        return [changed(scene.rig, key, 1 + sign * s * i) for i in range(n)]

    return Hidden(
        "drift",
        f"{key} from record to record",
        2 * KEYS[key] / n,
        rigs,
        lambda s: {"parameter": key, "rate": sign * s},
        upper=0.6 / n,
    )


def magnet(scene: Scene) -> Hidden:
    x, sign = scene.rig.length / 2, scene.sign()
    return scene.effect(
        None,
        scene.small / scene.deflection(x) ** 3,
        lambda s: PointForce(x, lambda y, rate, phase: -sign * s * y**3),
        f"a magnet at midspan: {'hardening' if sign > 0 else 'softening'} cubic spring",
    )


def second_rub(scene: Scene) -> Hidden:
    x = scene.place()
    slow = 0.02 * scene.omega * scene.deflection(x)
    return scene.effect(
        None,
        scene.small,
        lambda s: PointForce(x, lambda y, rate, phase: -s * np.tanh(rate / slow)),
        f"a second dry contact at {x:.3f} m",
    )


def root_damping(scene: Scene) -> Hidden:
    x = scene.place()
    speed = scene.omega * scene.deflection(x)
    return scene.effect(
        None,
        scene.small / np.sqrt(speed),
        lambda s: PointForce(x, lambda y, rate, phase: -s * rate / (rate**2 + (0.01 * speed) ** 2) ** 0.25),
        f"damping with the root of the speed at {x:.3f} m",
    )


def pumping(scene: Scene) -> Hidden:
    typical = 2 * scene.small * scene.rig.length / (np.pi**2 * scene.largest)
    sign = scene.sign()
    return scene.effect(None, typical, lambda s: AxialPumping(sign * s), "an axial force at twice the frequency")


def place_dependent(scene: Scene) -> Hidden:
    mu, slip, _ = scene.coulomb
    sign = scene.sign()
    return scene.law(
        None,
        0.002,
        lambda s: PlaceDependent(mu, slip, sign * s),
        lambda s: {"slope": sign * s},
        upper=0.1,
        what="friction that depends on the place of the contact",
    )


def crack(scene: Scene) -> Hidden:
    x, opens, half = scene.place(), scene.sign(), 0.01 * scene.rig.length
    bent = scene.largest * (np.pi / scene.rig.length) ** 2 * 2 * half
    typical = scene.work / (scene.rig.bending / (2 * half) * bent**2)
    return scene.effect(
        None,
        typical,
        lambda s: BreathingCrack(s, x, half, scene.rig.bending, opens),
        f"a breathing crack at {x:.3f} m",
        upper=0.6,
    )


def spring_pot(scene: Scene) -> Hidden:
    x = scene.place()
    slowest = 30.0 / scene.omega
    return scene.effect(
        None,
        scene.small / scene.deflection(x) / 10,
        lambda s: SpringPot(s, x, slowest),
        f"a damper of fractional order at {x:.3f} m",
    )


def clock(scene: Scene) -> Hidden:
    """The file says hz, the shaker ran at hz (1 + s)."""
    sign = scene.sign()

    def records(s: float) -> list[Record]:
        return [replace(r, hz=r.hz * (1 + sign * s)) for r in scene.records]

    def afterwards(truth: Truth, s: float) -> Truth:
        return replace(truth, records=tuple(replace(r, hz=r.hz / (1 + sign * s)) for r in truth.records))

    return Hidden(
        None,
        "the clock of the generator differs from that of the recorder",
        2e-4,
        lambda s: scene.rig,
        lambda s: {"ratio": 1 + sign * s},
        upper=0.05,
        records=records,
        afterwards=afterwards,
    )


def bent_sensor(scene: Scene) -> Hidden:
    """One accelerometer reads a (1 + s |a| / largest): compressed or expanded."""
    sensor, sign = scene.sensor(), scene.sign()
    j = scene.rig.sensors.index(sensor)

    def afterwards(truth: Truth, s: float) -> Truth:
        read = truth.acceleration.copy()
        read[:, j] *= 1 + sign * s * np.abs(read[:, j]) / scene.felt
        return replace(truth, acceleration=read)

    return Hidden(
        None,
        f"{sensor.name} is not linear",
        0.02,
        lambda s: scene.rig,
        lambda s: {"channel": sensor.name, "curvature": sign * s},
        upper=0.9,
        afterwards=afterwards,
        simulated=False,
    )


CATALOGUE: dict[str, Maker] = {
    "stribeck-weakening": stribeck,
    "distributed-microslip": microslip,
    "viscous-contact": viscous,
    "asymmetric-friction": asymmetric,
    "bristle-memory": bristle,
    "variable-normal-load": varying_load,
    "clamp-rotation": clamp_rotation,
    "clamp-friction": clamp_friction,
    "support-rotation-spring": support_rotation,
    "support-flexibility": support_flexibility,
    "midplane-stretching": midplane,
    "quadratic-drag": drag,
    "stiffness-damping": stiffness_damping,
    "added-mass": added_mass,
    "added-spring": added_spring,
    "attached-resonator": resonator,
    "impact-stop": impact_stop,
    "force-distortion": distortion,
    "sensor-gain": gain,
    "sensor-delay": delay,
    "sensor-position": sensor_place,
    "swapped-channels": swapped,
    "not-steady": not_steady,
    "drift": drift,
    **{f"parameter:{key}": wrong(key) for key in KEYS},
}
POLARITY: dict[str, Maker] = {"polarity": polarity}
OUTSIDE: dict[str, Maker] = {
    "magnet": magnet,
    "second-rub": second_rub,
    "root-damping": root_damping,
    "axial-pumping": pumping,
    "place-dependent-friction": place_dependent,
    "breathing-crack": crack,
    "spring-pot": spring_pot,
    "clock": clock,
    "bent-sensor": bent_sensor,
}
MAKERS: dict[str, Maker] = CATALOGUE | POLARITY | OUTSIDE
