"""An independent simulator of the rig: finite elements, marched in time to the periodic steady state.

It knows the truth beside the spectra it makes, and nothing of `hbm`, `continuation`, `models` and CasADi. Conventions:
docs/theory/equations.md; files: docs/reference/data_files.md.

    rig = table_1(Coulomb(mu=0.52, critical_slip=4.15e-6))             # TrueRig: structure, contact, law
    true = replace(rig, effects=(AddedMass(0.005, 0.3),))              # what the nominal model lacks
    rng = np.random.default_rng(1)
    records = scattered([(level, hz) for level in (2.5, 6.5) for hz in (48, 50, 52)], rng)
    truth = simulate_records(true, records)                            # Truth: T, R, u, v, accelerations
    spectra = measure(truth, snr_db=60, rng=rng)                       # Spectra: with noise
    write_spectra("spectra.csv", spectra)
    write_rig("rig.toml", rig)
"""

from tests.truth.effects import (
    AddedMass,
    AddedSpring,
    AttachedResonator,
    AxialPumping,
    ClampFriction,
    ClampRotation,
    ContactLoss,
    Effect,
    ImpactStop,
    MidplaneStretching,
    PointForce,
    QuadraticDrag,
    SupportFlexibility,
    SupportRotationSpring,
)
from tests.truth.laws import Coulomb, Dahl, Iwan, LuGre, NoFriction, Parallel, Stribeck, Viscous
from tests.truth.measure import Spectra, measure, write_contact, write_rig, write_spectra
from tests.truth.rig import Sensor, Tone, TrueRig, table_1
from tests.truth.shooting import Settings
from tests.truth.simulate import Record, Truth, scattered, simulate_records

__all__ = [
    "AddedMass",
    "AddedSpring",
    "AttachedResonator",
    "AxialPumping",
    "ClampFriction",
    "ClampRotation",
    "ContactLoss",
    "Coulomb",
    "Dahl",
    "Effect",
    "ImpactStop",
    "Iwan",
    "LuGre",
    "MidplaneStretching",
    "NoFriction",
    "Parallel",
    "PointForce",
    "QuadraticDrag",
    "Record",
    "Sensor",
    "Settings",
    "Spectra",
    "Stribeck",
    "SupportFlexibility",
    "SupportRotationSpring",
    "Tone",
    "TrueRig",
    "Truth",
    "Viscous",
    "measure",
    "scattered",
    "simulate_records",
    "table_1",
    "write_contact",
    "write_rig",
    "write_spectra",
]
