"""What records say: known coordinates, the same point again, a known distance."""

from aacmm_pin.observations.known_length import KnownLength, Length
from aacmm_pin.observations.known_point import KnownPoint
from aacmm_pin.observations.observation import Observation
from aacmm_pin.observations.same_point import SamePoint

__all__ = ["KnownLength", "KnownPoint", "Length", "Observation", "SamePoint"]
