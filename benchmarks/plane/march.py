"""The full plane model in time: Hilber-Hughes-Taylor's method on all degrees of freedom, as Abaqus/Standard has it.

A second path to the motion of the reduced model: nothing is reduced, and friction and contact are written here once
more, so that only the matrices are shared.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from models.published import PAPER_DAMPING, PAPER_EXCITATION, PAPER_NORMAL_LOAD

from .rigs import Variant, plane_model

ABAQUS_ALPHA = -0.05
DAMPING = replace(PAPER_DAMPING, stiffness_proportional=4e-6, high_mode_ratio=0.0)
"""Modes beyond the fifth need some, or what stick and slip excite in them never dies out: 1 % at 1 kHz."""

ROUNDS = 50
CLOSED = 1e-9  # N, how far a force may be from its law


@dataclass(frozen=True)
class Contact:
    """Elastic contact with elastic dry friction at some nodes, forces (n,) per slip and per approach."""

    mu: float
    tangential: np.ndarray  # N/m
    normal: float  # N/m
    at_rest: np.ndarray  # N, negative where open

    def forces(self, z, u, w):
        """Tangential and normal force (over that at rest) on the body, and their derivatives to u and w."""
        N = np.maximum(self.at_rest + self.normal * w, 0.0)
        N_w = np.where(N > 0.0, self.normal, 0.0)
        trial = self.tangential * (z - u)
        slips = np.abs(trial) > self.mu * N
        T = np.where(slips, self.mu * N * np.sign(trial), trial)
        T_u = np.where(slips, 0.0, -self.tangential)
        T_w = np.where(slips, self.mu * N_w * np.sign(trial), 0.0)
        return T, np.maximum(self.at_rest, 0.0) - N, T_u, T_w, -N_w


def march(variant: Variant, mu: float, critical_slip: float, hz: float, duration: float, dt: float, alpha: float):
    """Displacement of the drive point under the paper's force from rest, (steps,) [m]; Newmark's method for alpha 0."""
    model = plane_model(variant)
    free = np.flatnonzero(model.matrices.places[0] > 1e-9)
    M, K = (m[free][:, free].tocsc() for m in (model.matrices.mass, model.matrices.stiffness))
    C = DAMPING.mass_proportional * M + DAMPING.stiffness_proportional * K
    numbers = {name: i for i, name in enumerate(np.array(model.body.dofs)[free])}
    nodes = model.contacts(variant.nodes)
    n = len(nodes)
    ports = [(numbers[f"{a}.x"], 1.0) for a in nodes] + [(numbers[f"{a}.y"], -1.0) for a in nodes]
    rows, signs = zip(*ports, strict=True)
    B = sparse.csc_matrix((signs, (rows, range(2 * n))), shape=(len(free), 2 * n))
    drive = np.zeros(len(free))
    drive[numbers[f"{model.at(PAPER_EXCITATION.position)}.y"]] = 1.0
    kn = variant.stiffness / n
    rest = model.resting(n, PAPER_NORMAL_LOAD, kn)
    share = PAPER_NORMAL_LOAD / (rest > 0.0).sum()
    contact = Contact(mu, np.full(n, mu * share / critical_slip), kn, rest)

    beta, gamma = (1 - alpha) ** 2 / 4, 0.5 - alpha
    factors = splu((M + (1 + alpha) * (gamma * dt * C + beta * dt**2 * K)).tocsc())
    by_force = (1 + alpha) * factors.solve(B.toarray())
    G = beta * dt**2 * (B.T @ by_force)
    d, v = np.zeros(len(free)), np.zeros(len(free))
    z, f = np.zeros(n), np.zeros(2 * n)
    F = PAPER_EXCITATION.amplitude * np.cos(2 * np.pi * hz * dt * np.arange(round(duration / dt) + 1))
    a = splu(M).solve(drive * F[0])
    before = drive * F[0]  # force, less what damps and what restores
    seen = [0.0]
    for force in F[1:]:
        d_, v_ = d + dt * v + dt**2 * (0.5 - beta) * a, v + dt * (1 - gamma) * a
        loads = drive * force - C @ v_ - K @ d_
        a = factors.solve((1 + alpha) * loads - alpha * before)
        u = B.T @ (d_ + beta * dt**2 * a)
        f, z = _settled(contact, z, u, G, f)
        a = a + by_force @ f
        d, v = d_ + beta * dt**2 * a, v_ + gamma * dt * a
        before = drive * force - C @ v - K @ d + B @ f
        seen.append(drive @ d)
    return np.array(seen)


def _settled(contact: Contact, z, u, G, f):
    """Forces that obey the contact at the end of a step, by Newton's method, and the anchors that they drag along."""
    n = len(z)
    for _ in range(ROUNDS):
        at = u + G @ f
        T, N, T_u, T_w, N_w = contact.forces(z, at[:n], at[n:])
        residual = f - np.concatenate([T, N])
        if np.abs(residual).max() < CLOSED:
            return f, at[:n] + T / contact.tangential
        slope = np.block([[np.diag(T_u), np.diag(T_w)], [np.zeros((n, n)), np.diag(N_w)]])
        f = f - np.linalg.solve(np.eye(2 * n) - slope @ G, residual)
    raise ArithmeticError(f"contact does not settle in {ROUNDS} rounds; take shorter steps")
