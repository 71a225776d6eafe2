"""Records of an arm: read from a file or simulated, and what they say of where the tip was."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
