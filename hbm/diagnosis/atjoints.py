"""What is missing at joints that a rig has: beside the force of their law, on the motion that was measured.

Where forces at the ports of all joints explain the records, whatever their laws, the motion there is known however
large the misfit is. What a law makes of that motion is known too, and what is missing beside it.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from hbm.aft.joint import JointOverPeriod
from hbm.diagnosis.freeforces import Line, across, lines
from hbm.diagnosis.places import Complex
from hbm.fourier import Array, sampled
from hbm.outputerror.records import Measurement, Record
from hbm.sensitivity.jointforces import Ends
from models.causes.addedjoint import turned
from models.jointed import JointedRig
from models.jointedstructure import JointedStructure
from models.joints.joint import Joint

HARMONICS, SAMPLES = 9, 128
"""On which forces of laws are worked out, at least."""


def joints_between(rig: JointedRig, ends: Sequence[Ends]) -> Iterator[tuple[int, Joint, int, float]]:
    """Which of some ends have a joint of one port between them already, that, its port, and which way round."""
    port = 0
    for joint in rig.joints:
        for i, pair in enumerate(ends if joint.law.ports == 1 and not joint.loaded_by else ()):
            if joint.ends[0] in (pair, turned(pair)):
                yield i, joint, port, 1.0 if joint.ends[0] == pair else -1.0
        port += joint.law.ports


def missing_at(
    rig: JointedRig, data: Measurement, record: Record, joint: Joint, port: int
) -> tuple[Array, Array, Complex]:
    """What a record misses beside the law at a port, the forces at the others free; what a force there does; motion.

    Returns
    -------
    (2, c, H) array
        Real and imaginary parts, in standard deviations.
    (2, c, H, 1, 2 H) array
        By cosines, then sines of a force at the port.
    (1, H) complex array
        Amplitudes of the motion at the port.
    """
    H, s = data.H, rig.at_record(record.number).structure
    found = list(lines(rig, data, record))
    motion = np.array([_motion(line, s, port) if line.read.any() else 0.0 for line in found], dtype=complex)
    law = _force(joint, motion, 2 * np.pi * record.hz)
    missed = np.zeros((len(data.channels), H), dtype=complex)
    columns = np.zeros((len(data.channels), H, 1, 2 * H), dtype=complex)
    for k, line in enumerate(found):
        others, own = np.delete(line.by_joints, port, axis=1), line.by_joints[:, port]
        missed[:, k], seen = across(others, line.missed - own * law[k], own)
        columns[:, k, 0, k], columns[:, k, 0, H + k] = seen, -1j * seen
    return np.array([missed.real, missed.imag]), np.array([columns.real, columns.imag]), motion[None]


def _motion(line: Line, s: JointedStructure, port: int) -> complex:
    """At a port, with the forces at all that the records ask for."""
    forces = np.linalg.lstsq(line.by_joints, line.missed, rcond=None)[0]
    by = s.joints[port] @ line.through
    driven = (by @ s.excitation + s.flexibility_to_force[port]) * line.force
    return complex(driven + (by @ s.joints.T + s.flexibility[port]) @ forces)


def _force(joint: Joint, motion: Complex, omega: float) -> Complex:
    """Amplitudes (H,) of the force of a law on a motion (H,) whose mean is not known."""
    basis = sampled(max(HARMONICS, len(motion)), SAMPLES)
    u = basis.real(np.pad(motion, (1, basis.H - len(motion))))
    forces, _ = JointOverPeriod(joint.law, basis, loaded=False).forces(np.column_stack([u, u, np.zeros_like(u)]), omega)
    return np.asarray(basis.complex(basis.coefficients(forces[:, 0]))[1 : len(motion) + 1])
