"""An arm: its DH table or URDF, its kinematics, what its file states, and its poses by
Pinocchio.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
