"""Free run of a rig under recorded periods: python free_run.py extended.toml multisine_periods.npz REAL08 REAL10."""

import sys

import numpy as np

from hbm import load_rig
from hbm.balance.lines import LineBalance
from hbm.balance.solution import describe_joints
from hbm.fourier import sampled

LINES = 2683  # odd, up to 200 Hz; the filters of the recorder leave nothing above

rig, periods = load_rig(sys.argv[1]), np.load(sys.argv[2])
for name in sys.argv[3:]:
    v1, v2 = (periods[f"{name}_{v}"].astype(float) for v in ("v1", "v2"))
    hz, basis = float(periods["sampling_hz"]) / len(v1), sampled(LINES, 0)
    line = np.fft.rfft(v1)[: basis.H + 1] * 2 / len(v1)
    line[0] = 0.0
    balance = LineBalance(rig, basis, hz, np.concatenate([line.real, -line.imag[1:]]))
    here = balance.solved(None)
    found = describe_joints(here.problem, here.state, hz)["v2_output"].coefficients
    spectrum = np.zeros(len(v1) // 2 + 1, dtype=complex)
    spectrum[: basis.H + 1] = basis.complex(found) * len(v1) / 2
    missed = np.fft.irfft(spectrum, len(v1)) - (v2 - v2.mean())
    print(f"{name}: {1e3 * missed.std():.2f} mV (rms) off, of {1e3 * v2.std():.1f} mV")
