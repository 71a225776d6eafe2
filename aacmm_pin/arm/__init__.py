"""An arm: its DH table or URDF, its chain, what its file states, and its poses by Pinocchio."""

from aacmm_pin.arm.arm import Arm

__all__ = ["Arm"]
