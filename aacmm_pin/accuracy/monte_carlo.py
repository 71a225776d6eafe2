"""Uncertainty of a point or a length by propagation of distributions (GUM Supplement 1, JCGM 101:2008).

Everything that is uncertain is drawn at once and the exact model is evaluated; nothing is linearised. The parameters of the
arm are one arm's: in each draw all readings share them, so that they largely cancel in a short length. The noise of
encoders and contacts is new in every reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array, batch
from aacmm_pin._support.progress import watched
from aacmm_pin._support.shown import Shown
from aacmm_pin._support.units import MM
from aacmm_pin.accuracy.parameter_draws import FEWEST_DRAWS, drawn_effects, parameter_errors
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import chunks
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel, displaced
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.measurements.noise import Noise

COVERAGE = 0.95
"""Probability of a coverage interval."""
AT_ONCE = 10_000
"""Draws evaluated together."""


@dataclass(frozen=True, eq=False)
class PointUncertainty(Shown):
    """A measured point as a distribution.

    Attributes:
        estimate: the point by the model at its stated values (3,) [m].
        mean: of the draws (3,) [m].
        u: standard uncertainty of each coordinate (3,) [m].
        shortest: shortest 95 % coverage interval of each coordinate (3, 2) [m].
        symmetric: probabilistically symmetric 95 % coverage interval of each coordinate (3, 2) [m].
        draws: number of draws.
        covariance: (3, 3) [m²].
    """

    estimate: Array
    mean: Array
    u: Array
    shortest: Array
    symmetric: Array
    draws: int
    covariance: Array

    def to_frame(self) -> pd.DataFrame:
        """One row a coordinate, in millimetres."""
        columns = {"estimate_mm": self.estimate, "mean_mm": self.mean, "u_mm": self.u}
        columns |= {"shortest_low_mm": self.shortest[:, 0], "shortest_high_mm": self.shortest[:, 1]}
        columns |= {"symmetric_low_mm": self.symmetric[:, 0], "symmetric_high_mm": self.symmetric[:, 1]}
        table = pd.DataFrame({name: values / MM for name, values in columns.items()})
        table.insert(0, "coordinate", ["x", "y", "z"])
        return table

    def __str__(self) -> str:
        u = ", ".join(f"{value / MM:.4g}" for value in self.u)
        return f"standard uncertainty of x, y, z {u} mm, {self.draws} draws"


@dataclass(frozen=True, eq=False)
class LengthUncertainty(Shown):
    """A measured length as a distribution; see :class:`PointUncertainty`, here single numbers and intervals (2,) [m]."""

    estimate: float
    mean: float
    u: float
    shortest: Array
    symmetric: Array
    draws: int

    def __str__(self) -> str:
        low, high = self.shortest / MM
        return (
            f"length {self.estimate / MM:.4f} mm, standard uncertainty {self.u / MM:.4g} mm, "
            f"shortest 95 % interval {low:.4f} to {high:.4f} mm, {self.draws} draws"
        )


def point_uncertainty(
    model: Arm | ErrorModel,
    q: ArrayLike,
    *,
    noise: Noise,
    rng: np.random.Generator,
    draws: int = 10_000,
    conditions: Conditions | None = None,
    progress: bool = True,
) -> PointUncertainty:
    """Distribution of the tip that one reading gives (JCGM 101:2008, 5.9 and 7; JCGM 102:2011, 7).

    Parameters that the arm file's covariance names are drawn together from a normal distribution; other parameters with
    bounds from a rectangular one, the rest from normal ones (JCGM 101:2008, 6.4). Encoders and contact are normal with the
    standard uncertainties of ``noise``; references have no part.

    Args:
        model: the arm with its errors and what is known of them.
        q: one configuration (1, nq) [rad].
        noise: of encoders and contact.
        rng: for all that is drawn.
        draws: number of draws.
        conditions: of the one record; needed by causes that depend on them. They count as exact.
        progress: show a bar in a notebook, or on stderr at a terminal.

    Raises:
        ShapeError: ``q`` is not (1, nq), noise is of another number of encoders, or ``conditions`` are not of one record.
        MissingConditionError: an effect depends on a condition that is not there.
        AacmmError: nothing is uncertain, or there are fewer than 100 draws.
    """
    model = ErrorModel.of(model)
    q = _one(q, model.arm.nq, "q")
    tips = _tips(model, q, noise, rng, draws, conditions, progress)[0]
    covariance = np.cov(tips.T)
    return PointUncertainty(
        estimate=model.predict(q, conditions)[0],
        mean=tips.mean(axis=0),
        u=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        shortest=np.stack([shortest_interval(values) for values in tips.T]),
        symmetric=np.stack([symmetric_interval(values) for values in tips.T]),
        draws=draws,
    )


def length_uncertainty(
    model: Arm | ErrorModel,
    q_a: ArrayLike,
    q_b: ArrayLike,
    *,
    noise: Noise,
    rng: np.random.Generator,
    draws: int = 10_000,
    conditions: Conditions | None = None,
    progress: bool = True,
) -> LengthUncertainty:
    """Distribution of the distance between the tips of two readings, such as the ends of a ball bar.

    Both ends are measured by the same arm: its parameters are drawn once for both, encoders and contacts for each.

    Args:
        model: the arm with its errors and what is known of them.
        q_a: one configuration (1, nq) [rad].
        q_b: another (1, nq) [rad].
        noise: of encoders and contacts.
        rng: for all that is drawn.
        draws: number of draws.
        conditions: of the two records, A then B.
        progress: show a bar in a notebook, or on stderr at a terminal.

    Raises:
        ShapeError, MissingConditionError, AacmmError: see :func:`point_uncertainty`.
    """
    model = ErrorModel.of(model)
    q = np.concatenate([_one(q_a, model.arm.nq, "q_a"), _one(q_b, model.arm.nq, "q_b")])
    a, b = _tips(model, q, noise, rng, draws, conditions, progress)
    lengths = np.linalg.norm(a - b, axis=1)
    stated = model.predict(q, conditions)
    return LengthUncertainty(
        estimate=float(np.linalg.norm(stated[0] - stated[1])),
        mean=float(lengths.mean()),
        u=float(lengths.std(ddof=1)),
        shortest=shortest_interval(lengths),
        symmetric=symmetric_interval(lengths),
        draws=draws,
    )


def symmetric_interval(values: ArrayLike) -> Array:
    """Probabilistically symmetric 95 % coverage interval of draws (m,): (2,) (JCGM 101:2008, 7.7)."""
    ordered, inside = _ordered(values)
    low = (len(ordered) - inside + 1) // 2 - 1
    return np.asarray(ordered[[low, low + inside]])


def shortest_interval(values: ArrayLike) -> Array:
    """Shortest 95 % coverage interval of draws (m,): (2,) (JCGM 101:2008, 7.7)."""
    ordered, inside = _ordered(values)
    low = int((ordered[inside:] - ordered[:-inside]).argmin())
    return np.asarray(ordered[[low, low + inside]])


def _ordered(values: ArrayLike) -> tuple[Array, int]:
    """The draws in ascending order, and how many steps among them an interval spans."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    return ordered, int(COVERAGE * len(ordered) + 0.5)


def _one(q: ArrayLike, nq: int, name: str) -> Array:
    q = batch(q, nq, name, "rad")
    if len(q) != 1:
        raise ShapeError(f"{name} has {len(q)} rows, expected 1: one configuration")
    return q


def _tips(
    model: ErrorModel,
    q: Array,
    noise: Noise,
    rng: np.random.Generator,
    draws: int,
    conditions: Conditions | None,
    progress: bool,
) -> Array:
    """Tips of the k readings ``q`` (k, nq) in each draw: (k, draws, 3) [m]."""
    arm, conditions = model.arm, Conditions(len(q)) if conditions is None else conditions
    if conditions.n != len(q):
        raise ShapeError(f"conditions are of {conditions.n} records, expected {len(q)}")
    if draws < FEWEST_DRAWS:
        raise AacmmError(
            f"draws is {draws}, expected at least {FEWEST_DRAWS}; JCGM 101:2008, 7.2 recommends 10 000 and more"
        )
    if noise.encoder.shape != (arm.nq,):
        raise ShapeError(f"noise is of {len(noise.encoder)} encoders, expected {arm.nq} for {arm.name}")
    if not (model.covariance().any() or noise.encoder.any() or noise.probe):
        raise AacmmError(
            f"{arm.name}: no parameter has an uncertainty and there is no noise; state half-widths or u in the arm file"
        )
    tips = np.empty((len(q), draws, 3))
    with watched(list(chunks(draws, AT_ONCE)), progress, "Monte Carlo", "part") as parts:
        for part in parts:
            count = len(tips[0, part])
            effects = drawn_effects(model, parameter_errors(model, rng, count))
            for k, reading in enumerate(q):
                indications = reading + noise.encoder * rng.normal(size=(count, arm.nq))
                same = conditions.take(np.full(count, k))
                tips[k, part] = displaced(arm, effects, indications, same, arm.chain.tip, False).position
                tips[k, part] += noise.probe * rng.normal(size=(count, 3))
    return tips
