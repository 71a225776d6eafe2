"""Residuals of a joint in two branches, as hysteresis leaves them if no direction of approach is
stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin.diagnosis.choice import Choice

HARMONICS = 3
"""Harmonics of the joint's angle that are subtracted first: a periodic error is mostly near its two
extremes and would pass for two branches.
"""
FEWEST_RECORDS = 30
"""Fewer records than this do not show whether a scatter has two peaks."""
LEAST_LOG_RATIO = 7.0
"""Least log likelihood ratio of two branches over one scatter."""
# Some 870 files without hysteresis: 3 above 5, the one looked at 5.004. Of 12 files with ±50 µrad
# at one of the joints, 200 touches at ten seats, noise stated: 8 above 10, always at the right
# joint; 4 below 3.5.
LEAST_LEVER = 1.0
"""A record shows nothing of a joint's branches if 1 rad of the joint moves the tip by less than so
many standard deviations of the noise.
"""
HALF_WIDTHS = np.append(0.0, np.geomspace(0.05, 1.5, 60))
"""Half-widths that are tried, in parts of the RMS residual over the RMS lever."""
SCATTERS = np.geomspace(0.05, 1.5, 40)
"""Scatters that are tried, in parts of the RMS residual."""


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
        """Note that the residuals of this joint fall into two branches."""
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
    usable = choice.counted & fit.observations.has_target
    if usable.sum() < FEWEST_RECORDS:
        return None
    whiten = fit.noise.whitening[:, :3, :3]
    deviations = choice.design.deviations(choice.tips)
    # The error that records of one posture share counts once.
    deviations = choice.noise.independent(deviations)[:, :3]
    residuals = np.einsum("nij,nj->ni", whiten, deviations)[usable]
    columns = (whiten @ choice.design.of_angles[:, :3])[usable]
    chain = fit.problem.model.arm.chain
    found = []
    for j, row in enumerate(chain.moving_rows()):
        levers = np.linalg.norm(columns[:, :, j], axis=1)
        moved = levers >= LEAST_LEVER
        if moved.sum() < FEWEST_RECORDS:
            continue
        levers = levers[moved]
        angle = records.q[usable, j][moved]
        along = np.einsum("ni,ni->n", columns[moved, :, j], residuals[moved]) / levers
        rough = along - _smooth(along, levers, angle)
        half_width, log_ratio = two_branches(rough, levers)
        found.append(Branches(int(row), half_width, bool(chain.prismatic[j]), log_ratio))
    clear = [branches for branches in found if branches.log_ratio >= LEAST_LOG_RATIO]
    return max(clear, key=lambda branches: branches.log_ratio, default=None)


def _smooth(along: Array, levers: Array, angle: Array) -> Array:
    """The part of residuals (n,) that is a smooth function of the joint's ``angle`` (n,) times
    ``levers`` (n,).
    """
    waves = np.arange(1, HARMONICS + 1) * angle[:, None]
    functions = np.hstack([np.ones((angle.size, 1)), np.cos(waves), np.sin(waves)])
    basis = functions * levers[:, None]
    coefficients = np.linalg.lstsq(basis, along, rcond=1e-9)[0]
    return basis @ coefficients


def two_branches(along: Array, levers: Array) -> tuple[float, float]:
    """Half-width h, and log likelihood of two branches over that of one scatter.

    ``along`` ~ ½ N(h l, s²) + ½ N(-h l, s²), or N(0, s² + h² l²), with levers l: h and s are the
    likeliest for each.

    Args:
        along: residuals (n,).
        levers: residual that one unit of the joint causes in each record (n,).
    """
    rms = np.sqrt(np.square(along).mean())
    rms_lever = np.sqrt(np.square(levers).mean())
    half_widths = HALF_WIDTHS * rms / rms_lever
    offsets = half_widths[:, None] * levers
    two_branch = []
    one_scatter = []
    for s in SCATTERS * rms:
        upper = -0.5 * np.square((along - offsets) / s)
        lower = -0.5 * np.square((along + offsets) / s)
        variance = s**2 + np.square(offsets)
        either = np.logaddexp(upper, lower).sum(axis=1)
        two_branch.append(either - along.size * np.log(2.0 * s))
        squares = np.square(along) / variance + np.log(variance)
        one_scatter.append(-0.5 * squares.sum(axis=1))
    best = int(np.argmax(np.max(two_branch, axis=0)))
    return float(half_widths[best]), float(np.max(two_branch) - np.max(one_scatter))
