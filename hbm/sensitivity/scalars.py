"""Numbers that a solution depends on, with the keys of the rig file."""

from hbm.balance.solution import PeriodicSolution
from models.change import Scalar, drift_scalars, element_scalars, structure_scalars, tone_scalars
from models.friction import describe, parameters
from models.rig import Rig

FRICTION = "contact.friction."
LIMIT = "attachments.clamp_limit"
LOAD, FORCE, HZ, ALPHA = "contact.normal_load", "excitation.amplitude", "frequency_hz", "damping.mass_proportional"


def rig_scalars(rig: Rig, solution: PeriodicSolution) -> dict[str, Scalar]:
    """Numbers that a solution depends on, with the keys of the rig file; force and frequency are the solution's.

    Where a number drifts from record to record, a solution is that of record 1, on which rates have no effect.
    """
    return scalars_at(rig, solution.hz, solution.level)


def scalars_at(rig: Rig, hz: float, level: float) -> dict[str, Scalar]:
    """As :func:`rig_scalars`, at a frequency [Hz] and a force amplitude [N]."""
    law = rig.contact.law
    described = zip(law_keys(rig), parameters(law).values(), describe(type(law)).values(), strict=True)
    return {key: Scalar(value, p.unit) for key, value, p in described} | {
        LOAD: Scalar(rig.contact.normal_load, "N"),
        FORCE: Scalar(level, "N"),
        HZ: Scalar(hz, "Hz"),
        **structure_scalars(rig),
        **sensor_scalars(rig),
        **element_scalars(rig),
        **tone_scalars(rig.excitation),
        **drift_scalars(rig),
    }


def sensor_scalars(rig: Rig) -> dict[str, Scalar]:
    """Numbers of channels, such as gain and delay, with the keys of the rig file."""
    gains = {f"channels.{c.name}.gain": Scalar(c.gain, "1") for c in rig.response_channels}
    return gains | {f"channels.{c.name}.delay": Scalar(c.delay, "s") for c in rig.response_channels}


def law_keys(rig: Rig) -> list[str]:
    """Keys of the numbers of its friction law, in their order."""
    return [FRICTION + name for name in describe(type(rig.contact.law))]
