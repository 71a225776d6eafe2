"""A measuring arm with a hidden fault, for blind tests of diagnosis: own kinematics, own physics,
no line of the package.

:func:`blind.plant.draw` makes a measurement file from a seed, and says afterwards what was hidden
in it.
"""

import sys
from pathlib import Path

if __name__ != "blind":  # ``python -m tests.blind.study`` from the repository's root
    sys.path.insert(0, str(Path(__file__).parents[1]))

from blind.plant import Draw, Sample, draw
from blind.truth import Hidden

__all__ = ["Draw", "Hidden", "Sample", "draw"]
