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
# # The paper's plane model
#
# Hadji and Mureithi mesh their beam and the half cylinder under its tip with plane elements and let Abaqus march it
# in time. One frequency takes 90 minutes there and one curve 30 hours (section 4.2). Their simulated resonances lie
# at 52.8, 53.0 and 51.6 Hz (Table 4). The beam of Table 1, as one line with one point of contact, has its resonance
# at 48.8 Hz. Why?
#
# This notebook builds the plane model, solves it in seconds, and adds up where the 4 Hz come from.

# %%
import time

import matplotlib.pyplot as plt
import numpy as np

from hbm import steady_state, trace_frequency
from models import Damping, Excitation
from models.jointed import JointedRig
from models.plane import HalfCylinder, PlaneBeam
from models.published import PAPER_BEAM, PAPER_DAMPING, PAPER_EXCITATION, PAPER_NORMAL_LOAD, PAPER_PENALTY, paper_rig

# %matplotlib inline
plt.rcParams |= {"figure.dpi": 110}
RADIUS, TIP = 0.005, PAPER_BEAM.length
ACROSS = {"thickness": PAPER_BEAM.thickness, "width": PAPER_BEAM.width}
STEEL = {"youngs_modulus": PAPER_BEAM.youngs_modulus, "density": PAPER_BEAM.density}
H = 9

# %% [markdown]
# ## Elements that bend, and elements that do not
#
# Figures 5 and 6 of the paper compare the elements of Table 2 on a cantilever. Thirty elements along the beam and two
# over its thickness, the deflection of the end over that of beam theory:

# %%
theory = TIP**3 / (3 * PAPER_BEAM.bending_stiffness)
deflection = {}
for element in ("CPS3", "CPS4", "CPS4R", "CPS4I", "CPS6", "CPS8", "CPS8R"):
    model = PlaneBeam(TIP, **ACROSS, **STEEL, element=element, columns=30, rows=2).model(modes=2)
    still = model.body.ported([f"{model.at(TIP)}.y"], Damping()).receptance(0.0)
    deflection[element] = float(still.real[0, 0]) / theory
    print(f"{element:6s} {deflection[element]:.4f}")

assert all(abs(deflection[e] - 1) < 0.005 for e in ("CPS4I", "CPS6", "CPS8", "CPS8R"))
assert deflection["CPS3"] < deflection["CPS4"] < 0.2

# %% [markdown]
# A bilinear element cannot bend: a long one locks in shear, and triangles are worse. With one point of integration
# (CPS4R) it does not lock, but two of them over the thickness are two bars: 1 - 1/4 of the stiffness is left. The
# paper chooses CPS4I, whose incompatible modes bend, and so do we. All of this is as the paper says.
#
# ## The mesh and the contact at rest
#
# The half cylinder is two quarter cylinders, as in Figure 4b. Nodes lie 8 micrometres apart where it touches.


# %%
def plane(state, flush):
    """Plane model of the beam; `flush`: the half cylinder ends with the beam, else its middle is at the length."""
    contact = TIP - RADIUS if flush else TIP
    return PlaneBeam(
        contact + RADIUS,
        **ACROSS,
        **STEEL,
        cylinder=HalfCylinder(contact, RADIUS),
        state=state,
        stations=(PAPER_EXCITATION.position,),
    ).model(modes=15)


model = plane("plane-strain", flush=True)
print(model)
corners = model.mesh.p[:, model.mesh.t]
figure, (whole, tip) = plt.subplots(1, 2, figsize=(9.5, 3.6), layout="constrained")
for ax, scale in ((whole, 1e3), (tip, 1e6)):
    ax.fill(*(scale * (corners - np.array([0.601, -0.00739])[:, None, None])), fc="none", ec="0.3", lw=0.4)
whole.set(xlim=(-12, 6), ylim=(-0.5, 10.5), xlabel="x [mm]", ylabel="y [mm]", aspect="equal", title="tip of the beam")
tip.set(xlim=(-60, 60), ylim=(-3, 77), xlabel="x [µm]", ylabel="y [µm]", aspect="equal", title="where it touches")
plt.show()

# %% [markdown]
# Nine nodes may touch the rigid support, each with an elastic contact and the friction of the penalty formulation.
# Under 83 N at rest all of them do. Half cylinder and rigid support alone would touch over 7.6 micrometres on either
# side (Hertz, 1881); the elastic contact, 1e9 N/m in all, spreads the load further. A contact ten times as stiff moves
# the resonance by 0.06 Hz.

# %%
NODES, STIFFNESS = 9, 1e9
at_rest = model.resting(NODES, PAPER_NORMAL_LOAD, STIFFNESS / NODES)
for x, force in zip(8.0 * (np.arange(NODES) - NODES // 2), at_rest, strict=True):
    print(f"{x:+4.0f} µm  {force:6.2f} N")
assert abs(np.maximum(at_rest, 0).sum() - PAPER_NORMAL_LOAD) < 0.1

# %% [markdown]
# ## A curve in seconds
#
# The model has thousands of degrees of freedom. It is reduced to 15 modes, and the static response of all others at
# the nodes of contact. What is left is an ordinary rig with joints.


# %%
def rig(model, nodes=NODES):
    """The plane model as a rig: contact with friction at some nodes, shaken at 555 mm."""
    joints = model.joints(PAPER_PENALTY, nodes, PAPER_NORMAL_LOAD, STIFFNESS / nodes)
    drive = Excitation(PAPER_EXCITATION.amplitude, at=f"{model.at(PAPER_EXCITATION.position)}.y")
    return JointedRig("plane beam", model.body, PAPER_DAMPING, joints, drive, ())


curves = {"beam theory": trace_frequency(paper_rig(PAPER_PENALTY), (40.0, 65.0), harmonics=H)}
for flush in (False, True):
    for state in ("plane-stress", "plane-strain"):
        begin = time.perf_counter()
        name = f"{state}, contact at {601 if flush else 606} mm"
        curves[name] = trace_frequency(rig(plane(state, flush)), (40.0, 65.0), harmonics=H)
        assert time.perf_counter() - begin < 60  # 2 to 3 s on one core that is otherwise idle; in Abaqus 30 hours
for name, curve in curves.items():
    print(f"{name:34s} {curve.peak.hz:6.2f} Hz  {1e3 * curve.peak['drive'].peak:.3f} mm")

# %%
figure, ax = plt.subplots(figsize=(7.5, 4.0), layout="constrained")
for name, curve in curves.items():
    color = "0.2" if name == "beam theory" else "tab:blue" if "stress" in name else "tab:red"
    style = "--" if "601" in name else "-"
    ax.plot(curve.dense.hz, 1e3 * curve.dense["drive"].peak, style, lw=1.2, color=color, label=name)
for hz, words in ((50.0, "experiment"), (53.0, "Abaqus, penalty")):
    ax.axvline(hz, color="0.6", lw=0.8, ls=":")
    ax.annotate(words, (hz, 0.98), xycoords=("data", "axes fraction"), rotation=90, va="top", ha="right", fontsize=8)
ax.set(xlabel="frequency [Hz]", ylabel="drive displacement [mm]", xlim=(42, 62), ylim=(0, None))
ax.legend(frameon=False, fontsize=8)
plt.show()

# %% [markdown]
# The heading of the paper's Table 2 says plane strain. The elements it lists are Abaqus' elements for plane stress.
# And Table 1 does not say whether the 606 mm end at the middle of the half cylinder or at its end. Two open choices
# span 4 Hz:

# %%
peak = {name: curve.peak.hz for name, curve in curves.items()}
start = peak["plane-stress, contact at 606 mm"]
strain = peak["plane-strain, contact at 606 mm"] - start
flush = peak["plane-stress, contact at 601 mm"] - start
both = peak["plane-strain, contact at 601 mm"] - start
print(f"plane strain {strain:+.2f} Hz, contact 5 mm nearer {flush:+.2f} Hz, both {both:+.2f} Hz")
stiffer = start * (1 / np.sqrt(1 - 0.3**2) - 1)
print(f"E / (1 - nu^2) alone raises {start:.2f} Hz by {stiffer:.2f} Hz")
assert abs(strain - stiffer) < 0.3
assert abs(peak["plane-strain, contact at 601 mm"] - 53.0) < 0.5

# %% [markdown]
# A beam 39 mm wide and 4.8 mm thick bends about as a beam: plane stress. In plane strain it is 4.8 % too stiff in
# frequency. With both choices the steady resonance is within half a hertz of what Abaqus says, and with neither within
# 1.4 Hz of the experiment. The likely reason for the paper's 3 Hz is therefore not friction: it is the plane
# model. Transients, steps in time, contact stiffness and the clamp explain less, term by term:
# `docs/validation/plane.md`.
#
# ## What the tip does
#
# At resonance the half cylinder rolls and slides. Pressure on the nodes over one period, and friction over slip:

# %%
best = rig(model)
top = steady_state(best, peak["plane-strain, contact at 601 mm"], harmonics=15)
normal = np.array(
    [np.maximum(rest, 0) - top[f"{j.name}.force.2"].samples for j, rest in zip(best.joints, at_rest, strict=True)]
)
friction = sum(top[f"{j.name}.force.1"].samples for j in best.joints)
phase = np.linspace(0, 1, normal.shape[1], endpoint=False)
figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
pressure = left.pcolormesh(phase, 8.0 * (np.arange(NODES) - NODES // 2), normal, cmap="viridis", shading="nearest")
figure.colorbar(pressure, ax=left, label="normal force [N]")
left.set(xlabel="time [periods]", ylabel="node [µm]", title="pressure moves as it rolls")
middle.plot(phase, normal.sum(axis=0), label="normal")
middle.plot(phase, friction, label="friction")
middle.set(xlabel="time [periods]", ylabel="force [N]", title="all nodes together")
middle.legend(frameon=False, fontsize=8)
slip = 1e6 * top[f"{best.joints[NODES // 2].name}.motion.1"].samples
right.plot(np.append(slip, slip[0]), np.append(friction, friction[0]))
right.set(xlabel="motion of the middle node [µm]", ylabel="friction [N]", title="friction loop")
plt.show()

# %% [markdown]
# The contact travels over the nodes as the half cylinder rolls, and the outer ones open. The tip loads and unloads its
# support by a fifth of the load. No accelerometer sees any of this: it is why the inverse of notebook 04 is needed.

# %%
total = normal.sum(axis=0)
print(f"normal force from {total.min():.1f} to {total.max():.1f} N; friction up to {np.abs(friction).max():.1f} N")
assert np.all(np.abs(friction) <= PAPER_PENALTY.mu * total + 1e-6)
assert normal.min() >= -1e-9
