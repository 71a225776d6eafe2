"""Pictures of postures, accuracy, maps, calibrations and diagnoses with matplotlib.

Every function ``plot_…`` draws on ``ax`` and returns it; ``ax.figure`` is the picture. Without
``ax``, it makes a new pyplot figure, which a notebook shows and a program should close; axes of
your own ``matplotlib.figure.Figure`` do not use pyplot. A picture with several panels divides the
area of ``ax`` and returns the figure. Units are mm, mm³, µm for uncertainties, and degrees.

The method ``plot`` of a result, such as ``circle.plot()``, draws the main picture.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
