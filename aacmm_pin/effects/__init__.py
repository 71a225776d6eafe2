"""Causes of error, conditions of records, and arms with causes.

In Python, a cause of error at one place is an :class:`Effect`.

``CAUSES`` maps the name of a cause to its class, and ``register`` adds a class.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
