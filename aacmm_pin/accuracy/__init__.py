"""Uncertainty of the tip from those of parameters and readings: in postures, over lengths, over the
workspace.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
