"""Units at the doors of the package: multiply on the way in, divide on the way out. Inside everything is SI."""

from __future__ import annotations

import math

MM = 1e-3
"""One millimetre in metres."""
UM = 1e-6
"""One micrometre in metres."""
MM3 = MM**3
"""One cubic millimetre in cubic metres."""
DEG = math.pi / 180.0
"""One degree in radians."""
ARCSEC = DEG / 3600.0
"""One second of arc in radians."""
