"""Residuals over a joint that fall into two branches, as hysteresis leaves them where no direction
of approach is stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin.diagnosis.choice import Choice

WAVES = 3
"""Waves per turn, up to this, are taken out first: an error that is a wave is mostly near its two
extremes.
"""
FEWEST_RECORDS = 30
"""Fewer records than this do not show whether a scatter has two peaks."""
LEAST_LOG_RATIO = 7.0
"""Log likelihood by which two branches have to be likelier than one scatter."""
# Some 870 files without hysteresis: 3 above 5, the one looked at 5.004. Of 12 files with ±50 µrad
# at one of the joints, 200 touches at ten seats, noise stated: 8 above 10, always at the right
# joint; 4 below 3.5.
LEAST_LEVER = 1.0
"""A record that a joint moves by less than the noise, where it turns by 1 rad, shows nothing of its
branches.
"""
HALVES = np.append(0.0, np.geomspace(0.05, 1.5, 60))
SCATTERS = np.geomspace(0.05, 1.5, 40)
"""Half-widths and scatters that are tried, in parts of the RMS."""


@dataclass(frozen=True)
class Branches(Shown):
    """Two branches of the residuals over one joint.

    Attributes:
        joint: row of the joint.
        half_width: half of the distance between the branches [rad; m where the joint slides].
        slides: whether the joint slides.
        log_ratio: log likelihood of two branches over that of one scatter.
    """

    joint: int
    half_width: float
    slides: bool
    log_ratio: float

    @property
    def note(self) -> Note:
        """That they do."""
        code = "branches_of_slide" if self.slides else "branches"
        return Note(code, {"joint": self.joint, "half_width": self.half_width})

    def __str__(self) -> str:
        return str(self.note)


def branches_of(choice: Choice) -> Branches | None:
    """The joint over which the counted records most clearly fall into two branches; None where none
    does.
    """
    fit = choice.design.fit
    records = choice.fit.problem.measurements
    chosen = choice.counted & fit.observations.has_target
    if records.conditions.approach is not None or chosen.sum() < FEWEST_RECORDS:
        return None
    whiten = fit.noise.whitening[:, :3, :3]
    off = np.einsum("nij,nj->ni", whiten, choice.design.deviations(choice.tips)[:, :3])
    off = choice.noise.postures.whitened(off)[chosen]  # what a posture shares counts once
    columns = (whiten @ choice.design.of_angles[:, :3])[chosen]
    chain = fit.problem.model.arm.chain
    found = []
    for j, row in enumerate(chain.moving_rows()):
        size = np.linalg.norm(columns[:, :, j], axis=1)
        moved = size >= LEAST_LEVER
        if moved.sum() < FEWEST_RECORDS:
            continue
        size = size[moved]
        angle = records.q[chosen, j][moved]
        along = np.einsum("ni,ni->n", columns[moved, :, j], off[moved]) / size
        half_width, ratio = two_branches(along - _smooth(along, size, angle), size)
        found.append(Branches(int(row), half_width, bool(chain.prismatic[j]), ratio))
    sure = [one for one in found if one.log_ratio >= LEAST_LOG_RATIO]
    return max(sure, key=lambda one: one.log_ratio, default=None)


def _smooth(along: Array, size: Array, angle: Array) -> Array:
    """The part of residuals (n,) that is a smooth function of the joint's angle (n,), each ``size``
    of it (n,).
    """
    waves = np.arange(1, WAVES + 1) * angle[:, None]
    functions = np.hstack([np.ones((angle.size, 1)), np.cos(waves), np.sin(waves)])
    basis = functions * size[:, None]
    coefficients = np.linalg.lstsq(basis, along, rcond=1e-9)[0]
    return basis @ coefficients


def two_branches(along: Array, size: Array) -> tuple[float, float]:
    """Half-width h, and log likelihood of two branches over that of one scatter.

    ``along`` ~ ½ N(h size, s²) + ½ N(-h size, s²), or N(0, s² + h² size²): h and s are the
    likeliest for each.

    Args:
        along: residuals (n,).
        size: what one unit of the joint does to each (n,).
    """
    rms = np.sqrt(np.square(along).mean())
    lever = np.sqrt(np.square(size).mean())
    halves = HALVES * rms / lever
    apart = halves[:, None] * size
    twos = []
    ones = []
    for s in SCATTERS * rms:
        near, far = (-0.5 * np.square((along - off) / s) for off in (apart, -apart))
        wider = s**2 + np.square(apart)
        twos.append(np.logaddexp(near, far).sum(axis=1) - along.size * np.log(2.0 * s))
        ones.append(-0.5 * (np.square(along) / wider + np.log(wider)).sum(axis=1))
    best = int(np.argmax(np.max(twos, axis=0)))
    return float(halves[best]), float(np.max(twos) - np.max(ones))
