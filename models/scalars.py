"""Numbers that a solution depends on, with the keys of the rig file."""

from models.change import tone_scalars
from models.friction import parameters
from models.friction.law import Parameter
from models.jointed import AnyRig
from models.numbers import Described
from models.rig import Rig

FRICTION = "contact.friction."
SENSORS = "channels."
"""Beginning of the keys of numbers of sensors."""

LIMIT = "attachments.clamp_limit"
LOAD, FORCE, HZ, ALPHA = "contact.normal_load", "excitation.amplitude", "frequency_hz", "damping.mass_proportional"

TONE = Parameter("1", "coefficient of a harmonic of the force", "", lower=-float("inf"))


def solution_numbers(rig: AnyRig, hz: float, level: float) -> Described:
    """Numbers that a solution at a frequency [Hz] and a force amplitude [N] depends on, by the keys of the rig file.

    Where a number drifts from record to record, a solution is that of record 1, on which rates have no effect.
    """
    tones = {key: (value, TONE) for key, (value, _) in tone_scalars(rig.excitation).items()}
    numbers = rig.numbers
    at = {FORCE: (level, numbers[FORCE][1]), HZ: (hz, Parameter("Hz", "excitation frequency", ""))}
    return numbers | tones | at


def law_keys(rig: Rig) -> list[str]:
    """Keys of the numbers of its friction law, in their order."""
    return [FRICTION + name for name in parameters(rig.contact.law)]
