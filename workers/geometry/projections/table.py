"""Every camera model's projection, by its name."""

from typing import Final

from workers.geometry.models import ModelName
from workers.geometry.projections.brown_conrady import BROWN_CONRADY
from workers.geometry.projections.kannala_brandt import KANNALA_BRANDT
from workers.geometry.projections.pinhole import PINHOLE
from workers.geometry.projections.rational_polynomial import RATIONAL_POLYNOMIAL
from workers.geometry.projections.record import Projection

PROJECTIONS: Final[dict[ModelName, Projection]] = {
    "pinhole": PINHOLE,
    "brown_conrady": BROWN_CONRADY,
    "kannala_brandt": KANNALA_BRANDT,
    "rational_polynomial": RATIONAL_POLYNOMIAL,
}
