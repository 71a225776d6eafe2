"""Pictures of configurations, accuracy, maps, calibrations and diagnoses, with matplotlib.

Every function ``plot_…`` draws on ``ax`` and returns it; ``ax.figure`` is the picture. Without
``ax`` a new pyplot figure is made, which a notebook shows by itself and a program should close;
axes of your own ``matplotlib.figure.Figure`` leave pyplot alone. A picture of several panels
divides the place of ``ax`` among them, and returns its figure. Lengths are in mm, volumes in mm³,
uncertainties in µm, angles in degrees.

The main picture of a result is its own ``plot`` too: ``circle.plot()``, ``accuracy.plot()``,
``found.plot()``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
