"""Types of the numbers of a rig file: what their bounds and :mod:`models.plausible` accept."""

from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from models.plausible import impossible

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


def possible(quantity: str) -> AfterValidator:
    """Refusal of a number that nothing real has, by :data:`models.plausible.RANGES`."""

    def check(value: float) -> float:
        if (accepted := impossible(quantity, value)) is not None:
            raise PydanticCustomError("impossible", "{accepted}", {"accepted": accepted})
        return value

    return AfterValidator(check)


Length = Annotated[Positive, possible("length")]
Width = Annotated[Positive, possible("width")]
Thickness = Annotated[Positive, possible("thickness")]
Modulus = Annotated[Positive, possible("youngs_modulus")]
Density = Annotated[Positive, possible("density")]
Frequency = Annotated[Positive, possible("frequencies_hz")]
Shape = Annotated[float, possible("shape")]
Ratio = Annotated[NonNegative, possible("damping_ratio")]
Alpha = Annotated[NonNegative, possible("mass_proportional")]
Beta = Annotated[NonNegative, possible("stiffness_proportional")]
Load = Annotated[Positive, possible("normal_load")]
Radius = Annotated[NonNegative, possible("radius")]
Force = Annotated[Positive, possible("amplitude")]
