"""The whole residual as one CasADi function: for exact sensitivities, for other solvers, and for C code.

:class:`hbm.balance.problem.HarmonicBalance` evaluates the same equations faster, with the linear modes eliminated; this
one is what CasADi can differentiate, map over threads and generate.
"""

import casadi as ca
import numpy as np

from hbm.aft.force import LawOverPeriod
from hbm.aft.joint import JointOverPeriod
from hbm.aft.jointstep import joint_functions
from hbm.aft.period import law_functions
from hbm.balance.jointed import JointBalance
from hbm.balance.problem import AnyBalance, HarmonicBalance
from models.joints.law import numbers


def residual_function(problem: AnyBalance) -> ca.Function:
    """Scaled residual of a rig as a CasADi function.

    Parameters
    ----------
    problem : HarmonicBalance or JointBalance
        Rig, basis, and what the continuation parameter is.

    Returns
    -------
    casadi.Function
        `(x, lam, p) -> residual`: x (size,), lam the scaled continuation parameter, p the law's parameters in the
        order of :func:`models.friction.parameters`, with joints those of all of them in turn
        (:func:`models.joints.numbers`). It marches the law over two periods from its virgin state, which
        closes every loop that forgets within one.

    Raises
    ------
    ValueError
        If the rig has nonlinear elements, or a clamp that slips.

    Examples
    --------
    >>> from hbm.models.published import paper_rig
    >>> from hbm.fourier import FourierBasis
    >>> function = residual_function(HarmonicBalance(paper_rig(), FourierBasis(3, 32)))
    >>> function.name_in()
    ['x', 'lam', 'p']
    """
    if isinstance(problem, JointBalance):
        return _of_joints(problem)
    if problem.elements is not None or problem.clamp is not None:
        raise ValueError(f"{problem.rig.name}: has nonlinear elements; the symbolic residual knows friction only")
    basis, s = problem.basis, problem.structure
    size, n = basis.size, s.n
    x, lam = ca.MX.sym("x", problem.size), ca.MX.sym("lam")
    p = ca.MX.sym("p", len(problem.environment.parameters))
    Q = ca.reshape(x[: size * n], n, size).T * problem.q_ref
    T = x[size * n :] * problem.F_ref
    Omega, F = problem.at(lam)
    signals, slope = _contact_signals(problem, Q, T, Omega, F)
    law = ca.mtimes(basis.analysis, _force_over_period(problem, signals, Omega, p))
    balance = _modal_balance(problem, Q, T, Omega, F, slope)
    residual = ca.vertcat(ca.vec(balance.T) / problem.modal_force_ref, (T - law) / problem.F_ref)
    return ca.Function("residual", [x, lam, p], [residual], ["x", "lam", "p"], ["residual"])


def _derivative(problem: AnyBalance) -> ca.DM:
    return ca.sparsify(ca.DM(problem.basis.derivative(np.eye(problem.basis.size))))


def _force(problem: AnyBalance, value: ca.MX) -> ca.MX:
    """Coefficients of what follows the excitation, value for its fundamental."""
    return ca.sparsify(ca.DM(problem.force_shape)) * value


def _contact_signals(problem: HarmonicBalance, Q: ca.MX, T: ca.MX, Omega: ca.MX, F: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Coefficients (2H+1, 4) of u, v, rho, eta, and samples (N, n) of du/dq on an alias-free grid."""
    basis, s, r = problem.basis, problem.structure, problem.structure.reaction
    fine, D = basis.exact_products, _derivative(problem)
    Gq = ca.mtimes(Q, s.shortening)
    q_fine, Gq_fine = ca.mtimes(fine.synthesis, Q), ca.mtimes(fine.synthesis, Gq)
    shortening = ca.mtimes(fine.analysis, ca.sum2(q_fine * Gq_fine)) / 2
    u = ca.mtimes(Q, s.slip_row) - shortening + _force(problem, s.residual.slip_by_force * F)
    u -= problem.dynamic_lagrangian * T
    squared = ca.DM(basis.k**2) * Omega**2
    rho = Omega * ca.mtimes(D, ca.mtimes(Q, r.damping)) - squared * ca.mtimes(Q, r.inertia)
    rho += ca.mtimes(Q, r.stiffness) + _force(problem, -r.force_share * F)
    mean = ca.DM(np.eye(basis.size)[0])
    eta = ca.mtimes(Q, r.stretch) - r.friction_lever * mean
    signals = ca.horzcat(u, Omega * ca.mtimes(D, u), rho + problem.environment.load * mean, eta)
    return signals, ca.repmat(ca.DM(s.slip_row).T, fine.N_t, 1) - Gq_fine


def _force_over_period(problem: HarmonicBalance, signals: ca.MX, Omega: ca.MX, p: ca.MX) -> ca.MX:
    """Friction force at the samples of the second period from the virgin state, (N_t,)."""
    basis, environment = problem.basis, problem.environment
    functions = law_functions(problem.rig.contact.law, basis.N_t, LawOverPeriod.choices[-1])
    samples = ca.mtimes(basis.synthesis, signals).T
    inputs = ca.vertcat(environment.compliance, environment.load, 2 * np.pi / (Omega * basis.N_t))
    period = functions.sample.mapaccum("period", basis.N_t)
    before = ca.horzcat(samples[:, -1], samples[:, :-1])
    repeated = before, samples, ca.repmat(inputs, 1, basis.N_t), ca.repmat(p, 1, basis.N_t)
    carried, _ = period(ca.DM.zeros(functions.sample.size1_in(0), 1), *repeated)
    _, force = period(carried[:, -1], *repeated)
    return force.T


def _modal_balance(problem: HarmonicBalance, Q: ca.MX, T: ca.MX, Omega: ca.MX, F: ca.MX, slope: ca.MX) -> ca.MX:
    """Inertia, damping and stiffness minus friction and excitation, (2H+1, n)."""
    basis, s = problem.basis, problem.structure
    fine = basis.exact_products
    stiffness = ca.repmat(ca.DM(s.omega_n**2).T, basis.size, 1)
    inertia = ca.repmat(ca.DM(basis.k**2), 1, s.n) * Omega**2
    damping = Omega * ca.mtimes(_derivative(problem), Q) * ca.repmat(ca.DM(s.damping).T, basis.size, 1)
    friction = ca.mtimes(fine.analysis, slope * ca.repmat(ca.mtimes(fine.synthesis, T), 1, s.n))
    excitation = ca.mtimes(_force(problem, F), ca.DM(s.excitation).T)
    return (stiffness - inertia) * Q + damping - friction - excitation


def _of_joints(problem: JointBalance) -> ca.Function:
    """The residual of a rig with joints."""
    basis, s, rig = problem.basis, problem.structure, problem.rig
    size, n, m = basis.size, s.n, rig.ports
    x, lam = ca.MX.sym("x", problem.size), ca.MX.sym("lam")
    counts = [len(numbers(j.law)) for j in rig.joints]
    p = ca.MX.sym("p", sum(counts))
    Q = ca.reshape(x[: size * n], n, size).T * problem.q_ref
    f = ca.reshape(x[size * n :], m, size).T * ca.repmat(ca.DM(problem.f_ref).T, size, 1)
    Omega, F = problem.at(lam)
    D, force, k2 = _derivative(problem), _force(problem, F), ca.DM(basis.k**2) * Omega**2
    free = ca.mtimes(Q, s.joints.T) + ca.mtimes(force, ca.DM(s.flexibility_to_force).T)
    u = free + ca.mtimes(f, problem.flexibility.T)
    v = Omega * ca.mtimes(D, free + ca.mtimes(f, problem.flexibility_of_rate.T))
    load = Omega * ca.mtimes(D, ca.mtimes(Q, s.loads_damping.T)) + ca.mtimes(f, s.loads_by_joints.T)
    load += ca.mtimes(force, ca.DM(s.loads_by_force).T) - ca.repmat(k2, 1, len(rig.joints)) * ca.mtimes(
        Q, s.loads_inertia.T
    )
    laws = []
    for j, (at, own) in enumerate(zip(problem.slices, ca.vertsplit(p, np.cumsum([0, *counts]).tolist()), strict=True)):
        functions = joint_functions(rig.joints[j].law, basis.N_t, JointOverPeriod.choices[-1])
        signals = ca.mtimes(basis.synthesis, ca.horzcat(u[:, at], v[:, at], load[:, j])).T
        environment = ca.vertcat(2 * np.pi / (Omega * basis.N_t), problem.joints[j].compliance)
        carried = functions.march(ca.DM.zeros(functions.march.size1_in(0), 1), signals, environment, own)
        found = functions.period(carried, signals, environment, own)[0]
        laws.append(ca.mtimes(basis.analysis, ca.reshape(found, at.stop - at.start, basis.N_t).T))
    balance = (ca.repmat(ca.DM(s.omega_n**2).T, size, 1) - ca.repmat(k2, 1, n)) * Q
    balance += Omega * ca.mtimes(ca.mtimes(D, Q), s.damping.T) - ca.mtimes(f, s.joints)
    balance -= ca.mtimes(force, ca.DM(s.excitation).T)
    if len(problem.rigid):
        held = np.zeros((n, n))
        held[np.ix_(problem.rigid, problem.rigid)] = problem.adrift
        balance += ca.mtimes(ca.sparsify(ca.DM(np.diag(np.eye(size)[0]))), ca.mtimes(Q, held.T))
    gap = (f - ca.horzcat(*laws)) / ca.repmat(ca.DM(problem.f_ref).T, size, 1)
    residual = ca.vertcat(ca.vec(balance.T) / problem.modal_force_ref, ca.vec(gap.T))
    return ca.Function("residual", [x, lam, p], [residual], ["x", "lam", "p"], ["residual"])
