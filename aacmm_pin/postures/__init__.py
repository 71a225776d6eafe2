"""Postures with which an arm reaches a point or a pose: the configuration circle, and what limits
leave of it.

Other rooms import from here; the names of ``__init__.pyi`` are loaded when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
