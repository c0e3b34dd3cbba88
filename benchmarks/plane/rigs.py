"""The paper's beam on its half cylinder as a plane model, with everything that the budget varies as a parameter."""

from dataclasses import dataclass, replace
from functools import cache

from models import Channel, Excitation, FrictionLaw
from models.jointed import JointedRig
from models.plane import HalfCylinder, PlaneBeam, PlaneModel
from models.plane.elements import State
from models.published import PAPER_BEAM, PAPER_DAMPING, PAPER_EXCITATION, PAPER_NORMAL_LOAD, PAPER_PENALTY

RADIUS = 0.005
TIP = PAPER_BEAM.length  # m, end of the beam in Table 1
SENSORS = {"a1": 0.12, "a2": 0.25, "a3": 0.38, "a4": 0.46, "a5": 0.555}  # m
CONTACT_STIFFNESS = 1e9  # N/m of all nodes together, far above that of the beam


@dataclass(frozen=True)
class Variant:
    """What the paper leaves open about its plane model.

    Attributes
    ----------
    state : str
        Table 2 is headed plane strain; the elements it lists are Abaqus' plane stress.
    flush : bool
        Whether the half cylinder ends with the beam, or has its middle at the end of the length of Table 1.
    nodes : int
        Nodes of contact.
    stiffness : float
        Normal stiffness of all of them together [N/m].
    element : str
    columns : int
        Elements up to the half cylinder.
    rows : int
        Elements over the thickness.
    """

    state: State = "plane-stress"
    flush: bool = False
    nodes: int = 1
    stiffness: float = CONTACT_STIFFNESS
    element: str = "CPS4I"
    columns: int = 120
    rows: int = 4

    def but(self, **changed: object) -> "Variant":
        """The same with something changed."""
        return replace(self, **changed)  # type: ignore[arg-type]


@cache
def plane_model(variant: Variant, modes: int = 15) -> PlaneModel:
    """Mesh, matrices and reduction."""
    contact = TIP - RADIUS if variant.flush else TIP
    return PlaneBeam(
        length=contact + RADIUS,
        thickness=PAPER_BEAM.thickness,
        width=PAPER_BEAM.width,
        youngs_modulus=PAPER_BEAM.youngs_modulus,
        density=PAPER_BEAM.density,
        cylinder=HalfCylinder(contact, RADIUS),
        element=variant.element,
        state=variant.state,
        columns=variant.columns,
        rows=variant.rows,
        stations=tuple(SENSORS.values()),
    ).model(modes)


def plane_rig(variant: Variant, law: FrictionLaw = PAPER_PENALTY, modes: int = 15) -> JointedRig:
    """Rig of the reduced model, shaken as the paper's."""
    model = plane_model(variant, modes)
    joints = model.joints(law, variant.nodes, PAPER_NORMAL_LOAD, variant.stiffness / variant.nodes)
    drive = f"{model.at(PAPER_EXCITATION.position)}.y"
    channels = (Channel("a3", "acceleration", at=f"{model.at(SENSORS['a3'])}.y"),)
    excitation = Excitation(PAPER_EXCITATION.amplitude, at=drive)
    return JointedRig("the paper's beam, plane", model.body, PAPER_DAMPING, joints, excitation, channels)
