"""A rig that misses its records by far, as much of it as the order of candidates asks for."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.model import Model
from models.jointed import AnyRig


@dataclass
class Loud:
    chi2 = 1e9

    def __len__(self) -> int:
        return 10


def far_off(rig: AnyRig) -> Evaluation:
    return cast(Evaluation, SimpleNamespace(white=Loud(), model=Model(rig, {})))
