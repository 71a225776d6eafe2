"""The causes of error, one small class each, the conditions of records, and arms with causes.

``CAUSES`` finds a class by the name of its cause, ``register`` adds one. Other rooms import from
here. The names of ``__init__.pyi`` are loaded when they are first used: an arm without causes needs
none of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
