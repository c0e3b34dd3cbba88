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
# # What is wrong with the simulation?
#
# A simulation and a measurement disagree. Calibrating the numbers of the rig file makes them agree better, and
# teaches nothing: Young's modulus will stand for an elastic clamp, the friction coefficient for a wrong load.
# `diagnose` asks another question: which single effect that the model lacks explains the records, and predicts
# those it has not seen? It may also answer that nothing is wrong, that nothing it knows explains them, or that
# the measurement cannot tell two causes apart, and then which further one would.
#
# Both measurements here were made by a simulator that shares nothing with this package, finite elements marched in
# time (`tests/truth/`), so that the answers are known.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from hbm import diagnose, discrepancy, load_rig, load_spectra, trace_frequency
from hbm.figures import diagnosis as figures
from hbm.figures.compared import compared
from hbm.figures.gain import plot_gain
from hbm.figures.misfitmap import plot_misfit_map
from hbm.figures.missingforce import plot_missing_force
from models.causes.parameter import WrongParameter

# %matplotlib inline
plt.rcParams |= {"figure.dpi": 110}
EXAMPLES = Path("../examples")

rig = load_rig(EXAMPLES / "diagnosed_beam" / "rig.toml")
spectra = load_spectra(EXAMPLES / "diagnosed_beam" / "spectra.csv", rig)
found = diagnose(rig, spectra)
print(f"{len(spectra)} records, three force levels; held out: {len(found.held_out_records)}")

# %% [markdown]
# That was all of it: the rig file as it is, its numbers calibrated within their tolerances, and every cause of the
# catalogue, at each place and sensor, compared. What follows looks at the steps.
#
# ## Where the misfit is
#
# Twenty steady states of the beam of notebook 04, first and second mode, six accelerometers, harmonics 1 to 9,
# noise at 60 dB. Misfit in standard deviations, by channel and harmonic and by record:

# %%
levels = dict(zip(spectra.records.tolist(), spectra.level.tolist(), strict=True))
models = compared(found, levels)
axes = plot_misfit_map(models, found.campaign.data.channels)

# %% [markdown]
# The nominal model misses the lower harmonics of the records in which the contact slips most. Calibration, which may
# move two dozen numbers, hides nearly all of it on the records that it was fitted to.

# %%
errors = {name: {part: e.chi2_reduced for part, e in parts.items()} for name, parts in found.errors.items()}
for name, parts in errors.items():
    print(f"{name:10s} noise variances: {parts['train']:5.2f} fitted, {parts['held_out']:5.2f} held out")
assert errors["nominal"]["train"] > 5.0
assert errors["calibrated"]["train"] < 1.3 < errors["calibrated"]["held_out"]

# %% [markdown]
# Held-out records tell: nothing that was tuned may be believed for fitting what it was tuned to. The held-out records
# are one whole force level and a band of frequencies of the others.
#
# ## Which force is missing
#
# Before any cause is named: at each place in turn an unknown force, two numbers per record and harmonic, is put on
# the nominal model. At which place does it explain the misfit?

# %%
missing = discrepancy(found.nominal, found.campaign)
print(*missing.sentences(), sep="\n")
axes = plot_missing_force(missing)

# %%
assert missing.places[0].place.name == "the contact"
assert missing.places[0].share > 0.99
assert {1, 3} <= set(missing.best.harmonics)

# %% [markdown]
# Tenths of a newton at the contact, mostly in odd harmonics, partly in phase with the motion and partly in quadrature
# to it: friction is not what the rig file says. No law was assumed and no name is given. So small a force is placed
# poorly, as the sentences admit; this is all that the balance of forces says by itself.
#
# ## Which cause makes such a force
#
# Each candidate's first small effect, the exact derivative of the steady states to its parameter, is compared with the
# misfit (a score test: one linear solve each). The best are fitted for good.

# %%
print(*(line for line in found.evidence if line.startswith(("Score", "Looks", found.cause))), sep="\n")
for r in found.ranking:
    print(f"{r.label:24s} chi2 {r.chi2:8.1f}  BIC {r.bic:8.1f}")

# %%
ratio, TRUE_RATIO = found.parameters["ratio"], 1.3
print(found)
print(f"ratio {ratio.value:.4f} +- {ratio.std:.4f}; the truth: {TRUE_RATIO}, {ratio.value / TRUE_RATIO - 1:+.2%}")
assert (found.verdict, found.cause) == ("cause-found", "asymmetric-friction")
assert found.not_separable == ()
assert abs(ratio.value - TRUE_RATIO) < 3 * ratio.std
assert abs(ratio.value / TRUE_RATIO - 1) < 0.01

# %% [markdown]
# The half cylinder rubs harder one way than the other. The search prefers the plainest story: this one number added
# to the rig file *as it is* does better than all calibrated numbers together, so that nothing is calibrated.
#
# ## The gain, on records that no fit has seen

# %%
axes = plot_gain(found)

# %%
gain = found.gain
print(f"held-out error {gain['held_out_nrmse_ratio']:.2f}, misfit {gain['held_out_chi2_ratio']:.2f} of the calibrated")
assert gain["held_out_nrmse_ratio"] < 0.8
assert abs(errors["extended"]["held_out"] - 1.0) < 0.15

# %% [markdown]
# The misfit of the extended model on them is 1: noise. `found.extended` is a rig like any other (the command writes it
# as `extended.toml`). Its frequency response beside the data, fundamental and third harmonic of the accelerometer at
# 500 mm, where the contact slips:

# %%
channel, level = "a5", 6.5
curves = {"nominal": rig, "extended": found.extended}
curves = {name: trace_frequency(r, (47.5, 52.5), level=level, harmonics=21) for name, r in curves.items()}
here = (spectra.level == level) & (spectra.hz > 47.5) & (spectra.hz < 52.5)
measured, std = np.abs(spectra.complex(channel)[here]), spectra.std[here, spectra.index(channel)]
fig, axes = plt.subplots(1, 2, figsize=(6.3, 2.7), layout="constrained")
for k, ax in zip((1, 3), axes, strict=True):
    for name, curve in curves.items():
        ax.plot(curve.dense.hz, curve.dense[channel].amplitude[:, k], color=figures.COLORS[name], label=name)
    ax.errorbar(spectra.hz[here], measured[:, k], 1.96 * std[:, k], fmt="o", ms=3.5, color="0.2", label="measured")
    ax.set(xlabel="Frequency [Hz]", title=f"Harmonic {k}")
axes[0].set_ylabel(f"Acceleration {channel} [m/s²]")
axes[1].legend(frameon=False, fontsize=8)
plt.show()

# %% [markdown]
# Friction that gives way earlier in one direction takes the top off the resonance; both harmonics follow. (The shaker
# missed its level by some 2 % in each record. Everything above takes the measured force; these curves the level.)
#
# ## A measurement that cannot tell
#
# The same beam measured poorly: one level, two accelerometers, the fundamental alone, six records. In truth the
# friction coefficient is 0.48 where the rig file says 0.52. To keep this notebook short only numbers of the rig file
# are tried; the whole catalogue ends in the same verdict.

# %%
rig = load_rig(EXAMPLES / "undecided_beam" / "rig.toml")
poor = diagnose(rig, load_spectra(EXAMPLES / "undecided_beam" / "spectra.csv", rig), causes=[WrongParameter])
print(poor)

# %%
MU, LOAD = "parameter:contact.friction.mu", "parameter:contact.normal_load"
assert poor.verdict == "cause-found"
assert {poor.cause, *poor.not_separable} == {MU, LOAD}
assert "second mode" in poor.separate_by
assert poor.confidence < 0.8
values = {r.label: r.parameters["value"].value for r in poor.ranking}
assert abs(values[MU] - 0.479) < 0.001 and abs(values[LOAD] - 76.5) < 0.1

# %% [markdown]
# Friction knows the load through the product mu P alone, and so nearly do these records: a coefficient of 0.479 and
# a load of 76.5 N explain them equally. Whoever is named first is named by chance, as the confidence says, and both
# are on the list. What would tell them apart is computed: both fitted models are simulated at every experiment that
# comes to mind, and what the rival could still do to follow is taken off.
#
# `further.csv` has the same records, and three more where the answer says, about the second mode, with harmonics 1 to
# 9. The two causes are compared again, and the load is tried alone.

# %%
more = load_spectra(EXAMPLES / "undecided_beam" / "further.csv", rig)
settled = diagnose(rig, more, causes=[WrongParameter("contact.friction.mu"), WrongParameter("contact.normal_load")])
mu = settled.parameters["value"]
print(str(settled).splitlines()[0])
load_alone = diagnose(rig, more, causes=[WrongParameter("contact.normal_load")])
tried = {r.label: r for r in (*load_alone.ranking, *settled.ranking)}
for name in (MU, LOAD):
    print(f"{name:34s} chi2 {tried[name].chi2:8.1f}  {tried[name].parameters['value'].value:.4g}")
for name in ("calibrated", "extended"):
    e = settled.errors[name]["held_out"]
    print(f"{name} on the record held out: error {e.nrmse:.2%}, {e.chi2_reduced:.2f} noise variances")

# %%
assert settled.cause == MU and settled.not_separable == ()
assert abs(mu.value - 0.48) < 3 * mu.std
assert settled.confidence > 0.9
assert load_alone.verdict == "unexplained" and tried[LOAD].chi2 > 5 * tried[MU].chi2
assert max(settled.errors[name]["held_out"].chi2_reduced for name in ("calibrated", "extended")) < 1.0

# %% [markdown]
# In the second mode the reaction swings twice as far about the load, and friction follows that swing by the coefficient
# alone, not by the product: three records settle what six could not. The load leaves seven times as much as mu, and mu
# leaves noise. The error on the record held out tells nothing here. It is below noise with either model, as calibration
# may move mu too: a ratio of two such errors is left to chance. What `diagnose` compares, how it decides and what it
# cannot know: `docs/theory/diagnosis.md`.
