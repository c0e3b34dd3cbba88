"""Two plates bolted in a lap joint: finite elements of scikit-fem, contacts with friction between them.

The plates are clamped at their far ends. Two loosely tightened bolts press them together at two, four or eight points;
there they rub. The script prints what it made and draws how frequency and damping of the first bending mode change with
its amplitude. Needs scikit-fem: pip install 'casadi-hbm[fem]'.

Run: python examples/lap_joint.py lap_joint.png
"""

import sys
from functools import cache

import numpy as np
import skfem
from hbm.models import Jenkins
from hbm.models.bodies import MatrixBody
from hbm.models.jointed import JointedRig
from hbm.models.joints import Friction, Joint, PlaneFriction
from hbm.models.parts import Damping, Excitation
from scipy import sparse
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

from hbm import frequency_response, nonlinear_mode
from hbm.figures.backbone import plot_backbones

LENGTH, WIDTH, THICKNESS, LAP = 200.0, 30.0, 3.0, 100.0  # mm, of each plate and of their overlap
E, NU, DENSITY = 210e9, 0.3, 7800.0
BOLTS = (120.0, 180.0)  # mm, along the middle of the lap
PRELOAD, MU = 400.0, 0.3  # N of both bolts together
SHEAR, NORMAL = 1e8, 4e8  # N/m, of all contacts together
BOLT_TENSION, BOLT_SHEAR = 2e8, 5e6  # N/m of each bolt; in its clearance hole it hardly resists sliding
POINTS = {  # mm, places of contact
    2: [(120, 0), (180, 0)],
    4: [(x, y) for x in (120, 180) for y in (-7.5, 7.5)],
    8: [(x, y) for x in (110, 130, 170, 190) for y in (-7.5, 7.5)],
}


@cache
def plate():
    """One plate: place [mm] and direction of every degree of freedom, mass and stiffness matrix."""
    lines = np.linspace(0.0, LENGTH, 21), np.linspace(-WIDTH / 2, WIDTH / 2, 3), np.array([0.0, THICKNESS])
    mesh = skfem.MeshHex.init_tensor(*(1e-3 * line for line in lines))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    stiffness = skfem.BilinearForm(linear_elasticity(*lame_parameters(E, NU))).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: DENSITY * dot(u, v)).assemble(basis)
    directions = np.zeros(basis.N, dtype=int)
    for dofs in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
        directions[dofs] = np.arange(3)[:, None]
    return np.round(1e3 * basis.doflocs.T, 3) + 0.0, directions, mass, stiffness


def names(side, shift):
    """Names of the degrees of freedom of a plate that is shifted [mm], such as left(120,7.5,0).x."""
    places, directions, *_ = plate()
    return [f"{side}({x:g},{y:g},{z:g}).{'xyz'[d]}" for (x, y, z), d in zip(places + shift, directions, strict=True)]


def between(x, y, direction):
    """A degree of freedom on both sides of the lap."""
    return [f"{side}({x:g},{y:g},0).{direction}" for side in ("left", "right")]


def plates(contacts, closed):
    """Both plates with their bolts; where the contacts stay `closed`, their normal stiffness is in the matrices."""
    dofs = names("left", (0.0, 0.0, 0.0)) + names("right", (LENGTH - LAP, 0.0, -THICKNESS))
    number = {name: i for i, name in enumerate(dofs)}
    # a bolt acts over its washer, 3 x 3 nodes
    washers = [(x + dx, y) for x in BOLTS for dx in (-5.0, 0.0, 5.0) for y in (-7.5, 0.0, 7.5)]
    springs = [(p, d, (BOLT_TENSION if d == "z" else BOLT_SHEAR) / 9) for p in washers for d in "xyz"]
    if closed:
        springs += [(p, "z", NORMAL / contacts) for p in POINTS[contacts]]
    ends = sparse.lil_array((len(springs), len(dofs)))
    for row, (point, direction, _) in enumerate(springs):
        ends[row, [number[name] for name in between(*point, direction)]] = 1.0, -1.0
    held = ends.T @ sparse.diags_array([k for *_, k in springs]) @ ends
    mass, stiffness = (sparse.block_diag([matrix] * 2, format="csc") for matrix in plate()[2:])
    clamped = tuple(n for n in dofs if n.startswith(("left(0,", f"right({2 * LENGTH - LAP:g},")))
    return MatrixBody(mass, stiffness + held, tuple(dofs), modes=10, fixed=clamped)


def lap_joint(contacts=4, plane=False, force=1.0):
    """The rig: sliding along the plates under a constant load, or in the plane of the lap under the load there."""
    load, shear, normal = PRELOAD / contacts, SHEAR / contacts, NORMAL / contacts
    law = PlaneFriction(MU, shear, load, normal) if plane else Friction(Jenkins(MU, MU * load / shear), load)
    sides = [[between(*point, d) for d in ("xyz" if plane else "x")] for point in POINTS[contacts]]
    # the right plate lies below: moving up it presses
    joints = tuple(
        Joint(f"contact {i}", law, at=tuple(right for _, right in side), to=tuple(left for left, _ in side))
        for i, side in enumerate(sides, start=1)
    )
    damping, shaker = Damping(stiffness_proportional=4e-6), Excitation(force, at="left(100,0,3).z")
    return JointedRig(f"lap joint, {contacts} contacts", plates(contacts, not plane), damping, joints, shaker)


if __name__ == "__main__":
    rig = lap_joint()
    print(rig)
    error = rig.body.receptance_error(rig.places, rig.damping, (140.0, 155.0, 170.0))
    print(
        f"{len(rig.body.dofs)} degrees of freedom reduced to {rig.structure.n} modes, receptances right to {error:.1e}"
    )
    curves = [frequency_response(rig, (140.0, 160.0), level=level, harmonics=15) for level in (0.05, 0.2, 0.5, 1.0)]
    mode = nonlinear_mode(rig, amplitudes=(1e-5, 2e-3))
    print(mode, f"damping at most {100 * mode.damping_ratio.max():.2f} %", sep="\n")
    plot_backbones([mode], curves)[0].figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "lap_joint.png", dpi=150)
