"""What uncertainty of an arm's parameters and indications does to its tip: at a posture, on a
circle, over the workspace.

Other rooms import from here; the names of ``__init__.pyi`` are loaded when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
