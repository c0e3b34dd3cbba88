"""Causes in what the channels read."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import ClassVar, Self

from scipy.constants import g

from models.causes.cause import EITHER, Cause, Unknown
from models.jointed import AnyRig, JointedRig
from models.numbers import OF_FORCE

FORCES = (-1e4, 1e4)
"""What a force channel may read of the force."""

UNITS = (g, 1.0 / g, 1e3, 1e-3, 2.0**0.5, 0.5**0.5)
"""What it reads of it in another unit, or as an rms value; or where all responses are in one."""


DELAYS = (-1e-2, -1e-3, 1e-3, 1e-2)
"""Delays from which one is looked for [s]."""


@dataclass(frozen=True)
class OfChannel(Cause):
    """A number of one channel of motion that is wrong.

    Attributes
    ----------
    number : str
        Its key among those of the channel.
    channel : str
    """

    number: ClassVar[str]

    channel: str

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator[Self]:
        """Offer one for each channel of motion."""
        yield from (cls(c.name) for c in rig.response_channels)

    @property
    def label(self) -> str:
        """Name and channel."""
        return f"{self.name} {self.channel}"

    @property
    def key(self) -> str:
        """Key of the number in the rig file."""
        return f"channels.{self.channel}.{self.number}"

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Set the number."""
        (value,) = values.values()
        return rig.with_number(self.key, value)


@dataclass(frozen=True)
class SensorGain(OfChannel):
    """A channel that reads a multiple of the truth; -1 is a wrong polarity."""

    number: ClassVar[str] = "gain"
    name: ClassVar[str] = "sensor-gain"
    meaning: ClassVar[str] = "one channel reads gain times the truth"
    looks_like: ClassVar[str] = "one channel only, the same factor everywhere"
    confused_with: ClassVar[str] = "anything that few sensors see"
    check: ClassVar[str] = (
        "exchange this sensor and another one and repeat one record: the error must move with the sensor; of the "
        "force, shake a known mass alone: the channel must read the gain times mass times acceleration"
    )
    rigs: ClassVar[tuple[type, ...]] = EITHER

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator[Self]:
        """Offer one for each channel of motion, and for the force."""
        yield from super().candidates(rig)
        if not rig.excitation.force_gain and rig.excitation.channel_gain is None:
            yield from (cls(c.name) for c in rig.channels if c.quantity == "force")

    def of_force(self, rig: AnyRig) -> bool:
        """Whether its channel is that of the force."""
        return rig.force_among((self.channel,)) is not None

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The gain."""
        if self.of_force(rig):
            return (Unknown("gain", "1", OF_FORCE, *FORCES, 1.0, (1.0, -1.0, *UNITS)),)
        now = rig.number(self.key)
        return (Unknown("gain", "1", self.key, -100.0, 100.0, now, (now, -now)),)

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Set the gain."""
        if not self.of_force(rig):
            return super().extend(rig, values)
        return replace(rig, excitation=replace(rig.excitation, channel_gain=values["gain"]))


@dataclass(frozen=True)
class SensorDelay(OfChannel):
    """A channel that lags."""

    number: ClassVar[str] = "delay"
    name: ClassVar[str] = "sensor-delay"
    meaning: ClassVar[str] = "one channel lags"
    looks_like: ClassVar[str] = "one channel only, a phase that grows with the frequency"
    confused_with: ClassVar[str] = "anything that few sensors see"
    check: ClassVar[str] = (
        "exchange this sensor and another one, amplifier and filter included, and repeat one record: the lag must "
        "move along"
    )
    rigs: ClassVar[tuple[type, ...]] = EITHER

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The delay; starts with none more, and with those that amplifiers, filters and second recorders have."""
        now = rig.number(self.key)
        return (Unknown("delay_s", "s", self.key, -1.0, 1.0, now, (now, *(now + late for late in DELAYS))),)


@dataclass(frozen=True)
class SensorPosition(OfChannel):
    """A sensor that sits elsewhere."""

    number: ClassVar[str] = "position"
    name: ClassVar[str] = "sensor-position"
    meaning: ClassVar[str] = "one sensor sits elsewhere than its position says"
    looks_like: ClassVar[str] = "one channel only, a factor that differs between modes"
    confused_with: ClassVar[str] = "sensor-gain where one mode is measured"
    check: ClassVar[str] = "measure where the sensor sits"

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator[Self]:
        """Offer one for each channel of motion of a beam."""
        if rig.beam is not None:
            yield from super().candidates(rig)

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The position; starts where it should be, and along the beam."""
        assert rig.beam is not None
        now, L = rig.number(self.key), float(rig.beam.length)
        elsewhere = (share * L for share in (0.15, 0.35, 0.55, 0.75, 0.95) if abs(share * L - now) > 0.05 * L)
        return (Unknown("position", "m", self.key, 1e-6 * L, L, now, (now, *elsewhere)),)


@dataclass(frozen=True)
class SwappedChannels(Cause):
    """Two channels of one quantity that are exchanged: each name stands for the sensor of the other.

    Attributes
    ----------
    channel, other : str
    """

    name: ClassVar[str] = "swapped-channels"
    meaning: ClassVar[str] = "two channels are exchanged"
    looks_like: ClassVar[str] = "two channels only, each as it should be for the other"
    confused_with: ClassVar[str] = "sensor-position"
    check: ClassVar[str] = (
        "tap the beam beside one of the two sensors: the channel that answers first and most is its own"
    )
    rigs: ClassVar[tuple[type, ...]] = EITHER

    channel: str
    other: str

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator["SwappedChannels"]:
        """Offer one for each pair of channels of one quantity."""
        for a, b in combinations(rig.response_channels, 2):
            if a.quantity == b.quantity:
                yield cls(a.name, b.name)

    @property
    def label(self) -> str:
        """Name and channels, in the order of their names."""
        return " ".join([self.name, *sorted((self.channel, self.other))])

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """None."""
        return ()

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Exchange their sensors."""
        names = [c.name for c in rig.channels]
        i, j = names.index(self.channel), names.index(self.other)
        channels = list(rig.channels)
        channels[i], channels[j] = replace(channels[j], name=names[i]), replace(channels[i], name=names[j])
        exchanged = replace(rig, channels=tuple(channels))
        if isinstance(exchanged, JointedRig) or exchanged.modal is None:
            return exchanged
        shapes = list(exchanged.modal.shapes)
        shapes[i], shapes[j] = shapes[j], shapes[i]
        return replace(exchanged, body=replace(exchanged.modal, shapes=tuple(shapes)))
