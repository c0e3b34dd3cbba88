"""The diagnosis is asked: spectra of the plane model as the measurement, the beam of Table 1 as the rig."""

from dataclasses import replace

from hbm import diagnose, synthesize
from hbm.diagnosis.verdict import Diagnosis
from models import Channel, Rig
from models.jointed import JointedRig
from models.published import PAPER_PENALTY, paper_rig

from .budget import steady_peak
from .rigs import SENSORS, Variant, plane_model, plane_rig

LEVELS = (4.0, 5.0, 6.5)
AROUND = (0.93, 0.95, 0.965, 0.98, 0.99, 1.0, 1.01, 1.02, 1.035, 1.05)
"""Frequencies over that of the peak; farther from it not every steady state of one node of contact is stable."""

SNR = 60.0  # dB


def measured_rig(variant: Variant) -> JointedRig:
    """The plane model with accelerometers where the paper has them."""
    model = plane_model(variant)
    channels = tuple(Channel(name, "acceleration", at=f"{model.at(x)}.y") for name, x in SENSORS.items())
    return replace(plane_rig(variant), channels=(Channel("force", "force"), *channels))


def nominal_rig() -> Rig:
    """Table 1 with the same accelerometers."""
    channels = tuple(Channel(name, "acceleration", x) for name, x in SENSORS.items())
    return replace(paper_rig(PAPER_PENALTY), channels=(Channel("force", "force"), *channels))


def asked(variant: Variant) -> Diagnosis:
    """What the diagnosis says of the beam of Table 1."""
    peak = steady_peak(plane_rig(variant))[0]
    made = synthesize(measured_rig(variant), LEVELS, [peak * x for x in AROUND], snr=SNR, seed=28, harmonics=5)
    return diagnose(nominal_rig(), made.spectra)
