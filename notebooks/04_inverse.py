# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # From accelerations to a friction loop
#
# Six accelerometers along a beam, one force sensor at the shaker, and a contact that slides by micrometres where no
# instrument fits. How much of what happens at the contact do the accelerations tell, and how surely?
#
# The measurement in `examples/measured_beam/` is the beam of notebook 02 with damping that a rig can wait for: 30
# steady states, three force levels, harmonics 0 to 9, noise at 60 dB. It was made by a simulator that shares
# nothing with this package: 48 finite elements marched in time (`tests/truth/`). It also wrote down what nobody
# could have measured, `contact.csv`, which is opened here for one purpose only: to be drawn beside the answer.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from hbm import identify, load_rig, load_spectra, place_sensors, reconstruct
from hbm.figures.inverse import plot_reconstructed_loops, plot_signals
from hbm.figures.trust import plot_energy, plot_friction_harmonics

# %matplotlib inline
plt.rcParams |= {"figure.dpi": 110}
HERE = Path("../examples/measured_beam")

rig = load_rig(HERE / "rig.toml")
spectra = load_spectra(HERE / "spectra.csv", rig)
contact = reconstruct(rig, spectra)
print(f"{len(contact)} records, {contact.slips.sum()} of them slip")
print(*contact.warnings, sep="\n")

# %% [markdown]
# `reconstruct` does not look at the friction law of the rig file. At each harmonic it finds the friction force that
# best explains all sensors, with the beam's equations as a constraint and a prior for the harmonics that the
# sensors hardly see. The warning is about what was not measured. Where a harmonic above the ninth meets a mode, a small
# force moves the beam much. The bands below are wide enough for it.
#
# Whether sensors and structure agree is the first thing to know. The misfit per degree of freedom is 1 where only
# noise is left:

# %%
reduced = contact.misfit.reduced
print(f"reduced chi2 of the records: median {np.median(reduced):.2f}, from {reduced.min():.2f} to {reduced.max():.2f}")
assert contact.misfit.consistent.all()
assert 0.9 < np.median(reduced) < 1.1

# %% [markdown]
# ## The loop, beside the truth
#
# Bands are 95 % intervals. They contain the noise of every sensor, carried through the whole chain, and the
# harmonics above the ninth, which nobody measured.

# %%
table = np.genfromtxt(HERE / "contact.csv", delimiter=",", names=True)
every = contact["friction"].samples.shape[1] // 64
truth = {
    name: np.array([table[name][table["record"] == r] for r in spectra.records])
    for name in ("friction", "slip", "normal", "slip_velocity")
}
drawn = [3, 7, 8, 9, 13, 15, 16, 18, 21, 23, 25, 27]
axes = plot_reconstructed_loops(contact, drawn, truth=truth)

# %% [markdown]
# Where the contact sticks the loop is a line, the elastic slip; its mean force is history that no accelerometer
# knows, and is left out. Where it slides the plateaus are not level: friction follows the normal reaction, which
# swings with the motion. All four signals of the record of each level that slips most:

# %%
axes = plot_signals(contact, truth=truth)

# %% [markdown]
# How far off? The relative error of a record is the rms of the difference over the rms of the truth, both without
# their mean where the contact sticks, slip always without its mean.


# %%
def without_mean(samples, rows):
    return samples - np.where(rows, samples.mean(axis=1), 0.0)[:, None]


errors, covered = {}, {}
for name in ("friction", "slip", "normal", "slip_velocity"):
    signal = contact[name]
    rows = ~contact.slips if name == "friction" else np.full(len(contact), name == "slip")
    estimate, true = without_mean(signal.samples[:, ::every], rows), without_mean(truth[name], rows)
    errors[name] = np.linalg.norm(estimate - true, axis=1) / np.linalg.norm(true, axis=1)
    covered[name] = np.mean(np.abs(estimate - true) < 1.96 * signal.std[:, ::every])
    print(
        f"{name:14s} error: median {np.median(errors[name]):.2%}, worst {errors[name].max():.1%}; "
        f"95 % band holds {covered[name]:.1%} of the truth"
    )
assert np.median(errors["friction"]) < 0.02
assert np.median(errors["slip"]) < 0.01
assert np.median(errors["normal"]) < 0.003
assert all(share > 0.9 for share in covered.values())

# %% [markdown]
# Friction to 1 %, slip to half a per cent, the reaction to 0.1 %, the slip velocity to 4 %. The worst records are those
# where the contact has just begun to slip: a plateau of a few per cent of the period is made of harmonics that were not
# measured. The bands hold more than 95 % of the truth. Here these harmonics are smaller than they might be.
#
# ## What limits it
#
# Amplitudes of the harmonics of friction, and what the sensors alone resolve of them. The second harmonic is the
# weak line: near resonance a second harmonic of friction hardly moves the beam, so that its noise floor is the highest.

# %%
axes = plot_friction_harmonics(contact)

# %%
floor = np.median(contact.resolution[:, 1:], axis=0)
print("the sensors resolve", ", ".join(f"{k}: {value:.3f} N" for k, value in enumerate(floor, start=1)))
assert floor.argmax() in (0, 1)

# %% [markdown]
# ## Energy
#
# Each loop's area is what friction takes from the beam in a period; the wear work rate is the mean of R |v|,
# equation (26). Both with error bars, and again beside the truth.

# %%
axes = plot_energy(contact)

# %%
T, u, v, R = (truth[name] for name in ("friction", "slip", "slip_velocity", "normal"))
area = -np.sum((T + np.roll(T, -1, axis=1)) / 2 * (np.roll(u, -1, axis=1) - u), axis=1)
work = np.mean(R * np.abs(v), axis=1)
energy, rate = contact.energy_per_cycle, contact.work_rate
slips = contact.slips
print(
    f"energy per cycle: off by {np.median(np.abs(energy.value / area - 1)[slips]):.2%} (median of the slipping records)"
)
print(f"work rate: off by {np.median(np.abs(rate.value / work - 1)):.2%} (median of all)")
assert np.median(np.abs(energy.value / area - 1)[slips]) < 0.02
assert np.median(np.abs(rate.value / work - 1)) < 0.02

# %% [markdown]
# ## Where six sensors belong
#
# The present positions were spread evenly. With the same noise, which places tell most of the friction force?

# %%
placement = place_sensors(rig, count=6, hz=(45.0, 60.0))
print(placement)
assert placement.gain > 1.1

# %% [markdown]
# ## Which law makes such a force?
#
# `identify` fits friction laws to the reconstructed signals, weighed by the covariance of all of them, and compares
# the laws on records that were held out. The law behind these data is `coulomb-penalty` with mu = 0.52 and a
# critical slip of 4.15 µm. Stribeck's law contains it (mu_static = mu), and cannot be told from it; Dahl's bristle
# is another shape of loop.

# %%
found = identify(rig, contact, ("coulomb-penalty", "stribeck", "dahl"))
print(found["coulomb-penalty"])
print(found.comparison)

# %%
mu, critical_slip = found["coulomb-penalty"]["mu"], found["coulomb-penalty"]["critical_slip"]
print(f"mu off by {mu.value / 0.52 - 1:+.3%}, critical slip by {critical_slip.value / 4.15e-6 - 1:+.3%}")
assert abs(mu.value / 0.52 - 1) < 0.002
assert abs(critical_slip.value / 4.15e-6 - 1) < 0.01
assert found.best.law.name == "coulomb-penalty"

# %% [markdown]
# The friction coefficient to about one part in ten thousand, from accelerations half a metre away. It is the laws'
# shape that gives this precision: the force alone is known to 1 %, but two numbers have to explain all 30 records.
