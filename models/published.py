"""Published parameter sets, with their sources.

*The paper* is Hadji & Mureithi, "Validation of friction model parameters identified using the inverse
harmonic balance method", Shock and Vibration 2019: a clamped beam whose tip rests on a half
cylinder. Its Table 3 holds parameters identified at 6.5 N (`PAPER_...`). Laws that it only names have sets put together
for this beam (`ASSUMED_...`).
"""

from models.beam import Beam
from models.friction import (
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    Stribeck,
    VelocityLimited,
)
from models.parts import Channel, Contact, Damping, Excitation
from models.rig import Rig

# Table 1
PAPER_BEAM = Beam(length=0.606, width=0.03888, thickness=0.00478, youngs_modulus=210e9, density=7800.0)
PAPER_DAMPING = Damping(mass_proportional=0.06)  # alpha = 2 omega_1 zeta_1 (25), zeta_1 = 0.01 %
PAPER_RADIUS = 0.005
PAPER_NORMAL_LOAD = 83.0
PAPER_EXCITATION = Excitation(amplitude=6.5, position=0.555)

# The paper has six accelerometers and leaves their places to an earlier paper; these are ours.
PAPER_CHANNELS = (
    Channel("force", "force", 0.555),
    *(Channel(f"a{i}", "acceleration", x) for i, x in enumerate((0.1, 0.2, 0.3, 0.4, 0.5, 0.58), start=1)),
)

# Table 3, column Coulomb
PAPER_COULOMB = Coulomb(mu=0.520)
# The paper prints u_crit = F_f l_i (19) with F_f = 0.0015 and no l_i; 4.15e-6 m is Table 3's Stribeck u_crit, rounded.
PAPER_PENALTY = Jenkins(mu=0.520, critical_slip=4.15e-6)
# Hence l_i = 2.77 mm, for the other slip tolerances of sections 5 and 6. An assumption: nothing printed confirms it.
PAPER_CONTACT_LENGTH = 4.15e-6 / 0.0015
# Table 3, column Stribeck
PAPER_STRIBECK = Stribeck(mu_static=0.477, mu=0.161, stribeck_velocity=6.101e-4, critical_slip=4.146e-6, exponent=2.0)
# Section 3.2: the decay law is exponent 1. Table 3 identifies exponent 2 only; the other values are kept.
PAPER_DECAY = Stribeck(mu_static=0.477, mu=0.161, stribeck_velocity=6.101e-4, critical_slip=4.146e-6, exponent=1.0)
# Table 3, column Dahl
PAPER_DAHL = Dahl(mu=0.500, stiffness=1.003e7)
# Table 3, column LuGre. Its sigma_0 = 1.140e4 N/m contradicts its own u_crit = 4.060e-6 m: mu_s P / u_crit =
# 1.006e7 N/m, three orders larger and in line with Dahl's. The consistent value is the set to use; the printed one is
# kept beside it.
PAPER_LUGRE = LuGre(
    mu_static=0.492, mu=0.160, stribeck_velocity=7.152e-4, stiffness=1.006e7, bristle_damping=347.03, viscous=0.0
)
PAPER_LUGRE_PRINTED = LuGre(
    mu_static=0.492, mu=0.160, stribeck_velocity=7.152e-4, stiffness=1.140e4, bristle_damping=347.03, viscous=0.0
)

# The paper names the laws below and identifies none of them. What they share with an identified law is taken from
# Table 3 or section 5; the rest is assumed, and these sets show what the laws do, not what a contact is.
ASSUMED_VLFM = VelocityLimited(mu=0.520, velocity_limit=6.101e-4)  # Coulomb's mu, Stribeck's velocity
ASSUMED_KARNOPP = Karnopp(mu_static=0.520, mu=0.490, velocity_band=1e-6)  # the two mu of section 5, a narrow band
ASSUMED_FBFM = ForceBalance(mu_static=0.520, mu=0.490, velocity_band=1e-6)
ASSUMED_SDFM = SpringDamper(mu=0.520, stiffness=1.04e7, damping=347.03)  # mu P / u_crit; LuGre's sigma_1
# mu, v_s and sigma_1 of LuGre, its rest stiffness shared by three springs in series; plastic damping as presliding's
ASSUMED_HYBRID = Hybrid(
    mu_static=0.492,
    mu=0.160,
    stribeck_velocity=7.152e-4,
    stiffness=1.5e7,
    stiffness_elastic_plastic=6.1e7,
    stiffness_plastic_presliding=6.1e7,
    damping_plastic=347.03,
    damping_presliding=347.03,
)
# the penalty law's mu and stiffness, limits from 0 to twice the mean
ASSUMED_IWAN = Iwan(mu=0.520, stiffness=1.04e7, spread=1.0)

# Figure 9c: mu_s = 0.52 and F_f = 0.0015 of the best penalty case, mu_c = 0.16 of Table 3; its velocity is Table 3's.
PAPER_FIGURE_9C = Stribeck(mu_static=0.52, mu=0.16, stribeck_velocity=6.101e-4, critical_slip=4.15e-6, exponent=1.0)


def paper_rig(law: FrictionLaw = PAPER_PENALTY, name: str = "clamped-supported beam, Table 1") -> Rig:
    """Rig of the paper's Table 1 with a friction law.

    >>> (paper_rig().structure.omega_n / 6.283185307179586).round(3)
    array([ 47.842, 155.038, 323.475, 553.162, 844.098])
    """
    return Rig(
        name=name,
        body=PAPER_BEAM,
        damping=PAPER_DAMPING,
        contact=Contact(normal_load=PAPER_NORMAL_LOAD, law=law, radius=PAPER_RADIUS),
        excitation=PAPER_EXCITATION,
        channels=PAPER_CHANNELS,
    )
