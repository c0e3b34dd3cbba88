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
# # Where does a rubbing beam resonate?
#
# A steel beam of 606 mm is clamped at one end. Its other end rests on a flat support through a half cylinder of 5 mm
# radius, pressed down by 83 N; a shaker pushes it with 6.5 N. Bending rotates the tip, rotation rubs the half
# cylinder over the support by a few micrometres, and this friction decides where the beam resonates.
#
# A. Hadji and N. Mureithi (*Shock and Vibration*, 2019) measured a first resonance of 50 Hz, and computed 52.8 Hz
# (Coulomb, Lagrange multipliers), 53 Hz (Coulomb, penalty) and 51.6 Hz (friction that decays with velocity) with
# Abaqus (their Table 4). Here is the same beam, with their parameters, by harmonic balance.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from hbm import force_response, frequency_response, linear_modes, load_rig, simulate, steady_state, trace_frequency
from hbm.figures import plot_frequency_response, plot_loop
from hbm.integration.integrate import steady_state as shoot
from models import Damping

plt.rcParams |= {
    "figure.dpi": 110,
    "figure.constrained_layout.use": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "font.size": 9,
}
BLUE, ORANGE = "#33638d", "#d95f02"
DASHED = {"color": "0.1", "linewidth": 0.9, "linestyle": (0, (4, 2))}

rig = load_rig("../examples/paper_beam.toml")
modes = linear_modes(rig)
print("sliding:", modes.sliding_hz.round(3), "Hz")
print("stuck:  ", modes.stuck_hz.round(3), "Hz")
assert np.allclose(modes.sliding_hz[:2], [47.842, 155.038], atol=1e-3)
assert abs(modes.stuck_hz[0] - 56.004) < 1e-3

# %% [markdown]
# ## Two linear limits
#
# A tip that slides freely gives 47.84 Hz, a tip that sticks 56.00 Hz. Friction must put the resonance between the two.
#
# The upper limit needs care. The friction force acts as a moment on the tip, and a moment at a pin is just what pinned
# modes are bad at: the tip rotates too little, so the contact looks too stiff. Five modes alone give 57.73 Hz, fifty
# still 56.88 Hz. The rotation that is missing can be written down exactly, $L/4EI - \sum_i \phi_i'(L)^2/\omega_i^2$
# per unit moment. As a spring in series with the contact, and with the axial strain of the beam beside it, it makes
# five modes as good as fifty.

# %%
numbers = np.array([2, 3, 5, 8, 12, 20, 30, 50])


def stuck_hz(modes: int, residual: bool) -> float:
    """First natural frequency with a stuck tip [Hz]."""
    contact = replace(rig.contact, residual_compliance=residual)
    return float(linear_modes(replace(rig, contact=contact).with_modes(modes)).stuck_hz[0])


without, with_residual = (np.array([stuck_hz(int(n), on) for n in numbers]) for on in (False, True))
five, fifty = list(numbers).index(5), list(numbers).index(50)
print(f"without: {without[five]:.3f} Hz with 5 modes, {without[fifty]:.3f} Hz with 50")
print(f"with:    {with_residual[five]:.3f} Hz with 5 modes, {with_residual[fifty]:.3f} Hz with 50")
assert np.allclose(without[[five, fifty]], [57.73, 56.88], atol=5e-3)
assert abs(with_residual[five] - with_residual[fifty]) < 1e-3

fig, ax = plt.subplots(figsize=(6.3, 2.3))
ax.semilogx(numbers, without, "o-", color=ORANGE, markersize=4, label="modes alone")
ax.semilogx(numbers, with_residual, "o-", color=BLUE, markersize=4, label="with residual compliance")
ax.set(xlabel="Modes", ylabel="Stuck frequency [Hz]", xticks=numbers, xticklabels=numbers, ylim=(55.5, 61))
ax.minorticks_off()
ax.legend()
plt.show()

# %% [markdown]
# ## The response at 6.5 N
#
# `frequency_response` chooses the number of harmonics, traces the curve, and then solves some of its points again with
# more harmonics, more samples and twice the modes. What moves is the numerical error: bars in the figure.

# %%
curve = frequency_response(rig, (44.0, 60.0))
error = curve.assessment.error
print(curve)
print(f"error: {error}")
drive = curve["drive"].peak * 1e3  # mm
drawn = curve.dense  # with what lies between the points that were solved
share = drawn["drive"].amplitude[:, 3] / drawn["drive"].amplitude[:, 1]
print(f"third harmonic: up to {share.max():.0%} of the first, at {drawn.hz[share.argmax()]:.2f} Hz")
assert curve.complete and error.at_peak.total < 0.02
assert abs(curve.peak.hz - 48.83) < 0.03 and abs(drive.max() - 0.271) < 0.004
assert 0.4 < share.max() < 0.6 and 159 < 3 * drawn.hz[share.argmax()] < 162

fig, (top, bottom) = plt.subplots(2, 1, figsize=(6.3, 4.0), sharex=True, height_ratios=(2.2, 1))
plot_frequency_response(curve, top, label=False)
for probe in error.probes:
    at = int(np.argmin(abs(curve.hz - probe.hz)))
    top.errorbar(probe.hz, drive[at], probe.total * drive.max(), color=ORANGE, capsize=2, linewidth=1)
top.set(xlabel="", xlim=(44, 60))
bottom.plot(drawn.hz, share, color=BLUE)
for hz, ha in ((modes.sliding_hz[1] / 3, "right"), (modes.stuck_hz[1] / 3, "left")):
    bottom.axvline(hz, **DASHED)
    bottom.text(hz, 0.42, " mode 2 / 3, " + ("sliding " if ha == "right" else "stuck "), ha=ha, fontsize=8)
bottom.set(xlabel="Excitation frequency [Hz]", ylabel="Harmonic 3\nover harmonic 1", ylim=(0, 0.55))
plt.show()

# %% [markdown]
# The beam peaks at 48.83 Hz with 0.271 mm. The left flank folds, and the right one carries several lesser peaks up to
# 57 Hz. One of them has a simple cause: three times the excitation meets the second mode, which lies
# between 155 Hz (sliding) and 164 Hz (stuck). At 53.4 Hz the third harmonic reaches half of the first. Three times
# 53.4 is 160 Hz, and about 160 Hz is what the paper calls the second natural frequency.
#
# ## From stuck to sliding
#
# How does the resonance travel from one linear limit to the other? The compliance, displacement over force, shows it.
# A weak force leaves the tip stuck. A stronger one makes it slide for part of the period, which first damps the
# resonance and then lowers it.

# %%
levels = (1.0, 2.0, 3.0, 4.0, 5.0)
family = [*(trace_frequency(rig, (44.0, 60.0), level=F, harmonics=13) for F in levels), curve]
for c in family:
    print(f"{c.level:.1f} N: peak at {c.peak.hz:.2f} Hz, {c.peak.channels['drive'].peak / c.level * 1e6:.1f} um/N")
travel = [c.peak.hz for c in family]
assert travel == sorted(travel, reverse=True) and all(c.complete for c in family)
assert abs(travel[0] - 55.55) < 0.05 and modes.sliding_hz[0] < travel[-1] and travel[0] < modes.stuck_hz[0]
compliance = [c.peak.channels["drive"].peak / c.level * 1e6 for c in family]
assert abs(min(compliance) - 17.8) < 0.3 and abs(compliance[0] - 44.6) < 0.3 and abs(compliance[-1] - 41.8) < 0.6

# %% [markdown]
# At 1 N the peak is at 55.55 Hz, at 6.5 N at 48.83 Hz. The height tells more: 44.6 µm/N at 1 N, 17.8 µm/N at 4 N
# and 41.8 µm/N at 6.5 N. Friction is a good damper in the middle only, and at 6.5 N it is about to lose.
#
# When it loses can be computed by hand. In full slip the friction force is a square wave of height $\mu P$, so its
# first harmonic is $4\mu P/\pi$ however large the motion is. At the sliding resonance next to nothing else resists the
# shaker, and the motion runs away beyond
#
# $$ F^* = \frac{4}{\pi}\,\mu P\,\frac{h\,\phi_1'(L)}{\phi_1(X_f)} = 8.10\ \mathrm{N}. $$
#
# With the normal reaction held at $P$, `force_response` at 47.84 Hz stands upright at 8.1 N: within 2 % of the force
# the motion grows fivefold. But the reaction is not constant:

# %%
s = rig.structure
F_star = 4 / np.pi * rig.contact.law.mu * rig.contact.normal_load * abs(s.slip_row[0] / s.excitation[0])
steady_load = replace(rig, contact=replace(rig.contact, load_variation=0.0))
held, free = (force_response(r, float(modes.sliding_hz[0]), (4.0, 9.0), harmonics=9) for r in (steady_load, rig))
growth = np.diff(np.log(held["drive"].peak)) / np.diff(held.force)
upright = float(held.force[growth.argmax()])
fivefold = np.interp([0.3e-3, 1.5e-3], held["drive"].peak, held.force)
print(f"F* = {F_star:.2f} N; upright at {upright:.2f} N with R = P, first fold at {free.folds[0]:.2f} N with R(t)")
print(f"with R(t), the large motion goes on down to {min(free.folds):.2f} N")
assert abs(F_star - 8.10) < 5e-3 and abs(upright - F_star) < 0.03
assert np.ptp(fivefold) < 0.02 * F_star
assert abs(free.folds[0] - 7.75) < 0.04 and abs(min(free.folds) - 3.43) < 0.05

fig, (left, right) = plt.subplots(1, 2, figsize=(6.3, 3.0), width_ratios=(1.5, 1))
for c, shade in zip(family, np.linspace(0.75, 0.05, len(family)), strict=True):
    left.semilogy(
        c.dense.hz, c.dense["drive"].peak / c.level * 1e6, color=plt.cm.viridis(shade), label=f"{c.level:g} N"
    )
for hz, text in ((modes.sliding_hz[0], "sliding"), (modes.stuck_hz[0], "stuck")):
    left.axvline(hz, **DASHED)
    left.text(hz, 57, f" {text}", fontsize=8, va="top")
left.set(xlabel="Excitation frequency [Hz]", ylabel="Displacement over force [µm/N]", xlim=(44, 60), ylim=(4, 60))
left.set(yticks=(5, 10, 20, 50), yticklabels=(5, 10, 20, 50))
left.minorticks_off()
left.legend(fontsize=8, loc="lower right", ncols=2)
for c, color, text in ((held, ORANGE, "$R = P$"), (free, BLUE, "$R(t)$")):
    c = c.dense
    y = c["drive"].peak * 1e3
    lifted = np.array([p.lift_off for p in c.points])
    right.plot(c.force, np.where(lifted, np.nan, y), color=color, label=text)
    right.plot(c.force, np.where(lifted, y, np.nan), ":", color=color, label="lift-off" if lifted.any() else None)
right.axvline(F_star, **DASHED)
right.text(F_star, 4.6, "$F^*$ ", ha="right", va="top")
right.set(xlabel="Force at 47.84 Hz [N]", ylabel="Displacement [mm]", xlim=(3, 9), ylim=(0, 4.6))
right.legend(fontsize=8, loc="upper left")
plt.show()

# %% [markdown]
# With the true reaction, friction loses at 7.75 N already, and the curve folds back to 3.4 N before it rises again. On
# the upper branch the tip lifts off in every period, which this model does not follow: it says that at 6.5 N a
# second, violent motion may exist, not what it looks like. And 6.5 N is only a sixth below the jump. Whoever works here
# must expect the amplitude to depend strongly on $\mu$.
#
# ## The contact

# %%
fig, axes = plt.subplots(1, 3, figsize=(6.3, 2.4), sharey=True)
for ax, hz in zip(axes, (46.0, curve.peak.hz, 54.5), strict=True):
    point = curve.points[int(np.argmin(abs(curve.hz - hz)))]
    plot_loop(point, ax, mu=rig.contact.law.mu, color=BLUE)
    ax.set_title(f"{point.hz:.1f} Hz", fontsize=9)
    ax.margins(x=0.12)
for ax in axes[1:]:
    ax.set_ylabel("")
plt.show()

least = np.array([p.channels["normal"].samples.min() for p in drawn.points])
most = drawn["normal"].peak
print(f"normal reaction between {least.min():.1f} and {most.max():.1f} N; static 83 N")
assert abs(least.min() - 62.8) < 0.7 and abs(most.max() - 103.0) < 0.7 and not curve.lift_off
fig, ax = plt.subplots(figsize=(6.3, 2.3))
ax.fill_between(drawn.hz, least, most, color=BLUE, alpha=0.2, linewidth=0)
ax.plot(drawn.hz, most, drawn.hz, least, color=BLUE, linewidth=1)
ax.axhline(rig.contact.normal_load, **DASHED)
ax.set(xlabel="Excitation frequency [Hz]", ylabel="Normal reaction [N]", xlim=(44, 60))
plt.show()

# %% [markdown]
# Below the resonance the tip sticks: the loop is a line and nothing is lost. At the peak the tip slides by
# some 40 µm each way, and at 54.5 Hz the loop has steps, where the higher modes halt the slip or hurry it. The limits
# $\pm\mu R$ are not horizontal, because bending presses and relieves the support. The reaction stays between 63 and
# 103 N, far from lift-off.
#
# ## The same beam in the time domain
#
# Harmonic balance assumes that the motion is periodic. A time integration does not, and it shares neither the Fourier
# series nor the continuation. It needs a transient that ends, so the damping is raised to $\alpha$ = 0.6 1/s here.
# Shooting solves for the state that one period maps onto itself, and a march from rest simply waits for 12 s.

# %%
damped = replace(rig, damping=Damping(mass_proportional=0.6))
worst = {}
for hz in (46.0, 50.0, 54.0):
    balance = steady_state(damped, hz, harmonics=31, samples=1024).channels
    history = shoot(damped, hz).history
    for name in ("drive", "slip", "friction", "normal"):
        a, b = balance[name].coefficients[1:], history.coefficients(name, 31)[1:]  # a stuck tip keeps any mean
        worst[hz, name] = float(np.linalg.norm(a - b) / np.linalg.norm(a))
    print(f"{hz} Hz:", ", ".join(f"{name} {worst[hz, name]:.1e}" for name in ("drive", "slip", "friction", "normal")))
assert max(worst.values()) < 2e-3 and max(worst[hz, "drive"] for hz in (46.0, 50.0, 54.0)) < 2e-4

rest = simulate(damped, 50.0, duration=12.0, last_periods=2)
arrived = float(np.ptp(rest.channels["drive"].values)) / 2
expected = float(np.ptp(steady_state(damped, 50.0, harmonics=31).channels["drive"].samples)) / 2
print(f"50 Hz, from rest: {arrived * 1e3:.4f} mm after 12 s; harmonic balance {expected * 1e3:.4f} mm")
assert rest.steadiness < 1e-6 and abs(arrived / expected - 1) < 2e-3

# %% [markdown]
# Displacements agree to 0.02 %, the contact's signals to 0.2 %.
#
# ## Conclusion
#
# In one number: a beam measured at **50 Hz** has its steady resonance at **48.83 Hz** with the penalty law of the
# paper, 2.3 % lower, where Abaqus has 53 Hz after 1.2 s from rest. The closeness deserves caution: at 6.5 N the beam
# sits just below a jump, where small changes in friction, load or lever matter, several peaks lie between 45 and 57 Hz,
# and some inputs are ours, since they are not printed: the critical slip (its length scale), the damping of mode 6
# and above. Notebook 03 repeats those 1.2 s, with all laws of the paper, and judges them by its criteria.
