"""Which joint bends the backbone of a decay: python backbone.py rig.toml decay.csv (the table of `hbm decay`)."""

import sys

import numpy as np
from hbm.models.causes.joints import JointMicroslip, JointSlip, LocalDahl, QuadraticDamping
from scipy.optimize import minimize

from hbm import load_rig
from hbm.modes.decaying import over_channel, predicted

rig, table = load_rig(sys.argv[1]), np.genfromtxt(sys.argv[2], delimiter=",", names=True)
amplitude, held = table["amplitude"], np.arange(len(table)) % 3 == 1  # a third is never used to fit
measured = np.array([table["frequency_hz"], table["damping_ratio"]])
scale = np.array([[5e-4], [0.1]]) * measured.mean(axis=1, keepdims=True)
low, high, w = amplitude.min(), amplitude.max(), 2 * np.pi * measured[0].mean()


def left(x, cause):
    """What a joint leaves, the linear mode at its best."""
    values = {n.name: n.of(0.01 * high, high / w**2, w) * np.exp(v) for n, v in zip(cause.numbers, x, strict=True)}
    mode = over_channel(cause.extend(rig, values), 1, rig.channels[1].name, (low, high))
    bent = (measured - np.array(predicted(mode, rig.channels[1].name, amplitude))) / scale
    return bent - bent[:, ~held].mean(axis=1, keepdims=True)


for c in (kind("tip") for kind in (QuadraticDamping, LocalDahl, JointSlip, JointMicroslip)):
    x = minimize(lambda x, c: np.mean(left(x, c)[:, ~held] ** 2), [0] * len(c.numbers), c, "Nelder-Mead").x
    off = np.abs(left(x, c)[:, held]).max(axis=1) * [0.05, 10]
    print(f"{c.label}: held out within {off[0]:.3f} % of the frequency, {off[1]:.1f} % of the damping")
