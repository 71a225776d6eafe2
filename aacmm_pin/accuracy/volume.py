"""Accuracy in given postures: covariance, accuracy volume, worst-case deviation, budget.

To first order ``p(κ + δ) ≈ p(κ) + S δ`` with the sensitivity S; the Monte Carlo method uses the
exact model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, Index, batch, chunks, whole
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy import zonotope
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources, omission
from aacmm_pin.arm import COVERAGE_FACTOR, rigid_motions
from aacmm_pin.effects import Conditions, ErrorModel, GivenModel, loaded
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError, UnsupportedArmError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from aacmm_pin._support.workers import Workers
    from aacmm_pin.postures import PosturesAtPoint

Method = Literal["zonotope", "jointwise", "ellipsoid", "monte-carlo"]
METHODS: tuple[Method, ...] = get_args(Method)

COVERED = (0.954, 0.993)
"""Coverage of U = 2 u of a position, for normal errors in one direction, and isotropic ones."""
ELLIPSOID_COVERAGE_FACTOR = 2.7954834829151074
"""Of the 95 % ellipsoid in three dimensions (JCGM 102:2011, table 1)."""
POSTURES_AT_ONCE = 16_384
"""In one task, for both compiled loops. With 2048, 200 000 postures of SINO6 take 1.0 s, not
0.3 s.
"""
DRAWN_AT_ONCE = 4
"""In one task of ``monte-carlo``."""
MANY = 50_000
"""More postures show a progress bar."""


@dataclass(frozen=True, eq=False)
class AccuracyVolume(Shown):
    """The accuracy of an arm in many postures.

    Attributes:
        sources: parameters with an uncertainty.
        q: postures ``(n, nq)`` [rad].
        method: of ``volume``.
        volume: accuracy volume ``(n,)`` [m³].
        covariance: of the position ``(n, 3, 3)`` [m²]; for ``monte-carlo`` of the draws.
        conditions: of the n postures, or one record for all; None if not stated.
    """

    sources: ErrorSources
    q: Array
    method: Method
    volume: Array
    covariance: Array
    conditions: Conditions | None = None

    @property
    def u(self) -> Array:
        """The standard uncertainty of the position ``(n,)`` [m]: root sum of squares of x, y
        and z.
        """
        return _u(self.covariance)

    @cached_property
    def u_aligned(self) -> Array:
        """The standard uncertainty if the base is aligned to all postures, ``(n,)`` [m].

        The alignment removes the best rigid motion of the base (least squares) from the effect of
        each parameter. Noise of readings stays; with one or two postures, nearly nothing else.
        """
        positions = self.sources.arm.positions(self.q, self.sources.at)
        of_base = rigid_motions(positions)
        parts = _parts(self.q, self.conditions)
        sensitivity = np.concatenate([self.sources.sensitivity(*part) for part in parts])
        lasting = self.sources.lasting
        effects = sensitivity[:, :, lasting].reshape(positions.size, -1)
        base_motions, *_ = np.linalg.lstsq(of_base.reshape(-1, 6), effects)
        sensitivity[:, :, lasting] -= of_base @ base_motions
        return _u(self.sources.covariance_of(sensitivity))

    @property
    def not_included(self) -> tuple[str, ...]:
        """Labels of causes that the accuracy does not include."""
        return self.sources.not_included

    @cached_property
    def largest_deviation(self) -> Array:
        """The worst-case deviation ``(n,)`` [m]: the largest distance that all bounded parameters
        together cause, to first order.
        """
        deviations = [np.empty(0)]
        for q, conditions in _parts(self.q, self.conditions):
            generators = self.sources.generators(self.sources.sensitivity(q, conditions))
            deviations.append(zonotope.largest_deviation(generators))
        return np.concatenate(deviations)

    def budget(self, by: Literal["parameter", "joint", "kind"] = "parameter") -> pd.DataFrame:
        """Return the uncertainty budget: shares in the mean variance over the postures.

        Source: JCGM 100:2008, 5.1. The share of a parameter is ``tr(S_k (Σ Sᵀ)_k) / tr(S Σ Sᵀ)``.
        Correlated parameters share their common variance equally; a share may be negative.

        Returns:
            A table, largest share first. The first column names the row (``<NA>`` for the joint of
                a cause of the whole arm), ``u_mm`` is its RMS contribution alone, ``share`` sums to
                1.
        """
        count = len(self.sources.parameters)
        products = np.zeros((count, count))
        for q, conditions in _parts(self.q, self.conditions):
            sensitivity = self.sources.sensitivity(q, conditions)
            contributions = (sensitivity * self.sources.u).reshape(-1, count)
            products += contributions.T @ contributions
        return self.sources.budget(products / max(len(self.q), 1), by)

    def to_frame(self) -> pd.DataFrame:
        """Return a table of postures: ``theta1_deg`` …, ``volume_mm3``, ``u_mm``, and
        ``largest_deviation_mm`` if a parameter is bounded.
        """
        import pandas as pd

        table = {f"theta{j + 1}_deg": self.q[:, j] / DEG for j in range(self.q.shape[1])}
        table |= {"volume_mm3": self.volume / MM**3, "u_mm": self.u / MM}
        if self.sources.bounded:
            table["largest_deviation_mm"] = self.largest_deviation / MM
        return pd.DataFrame(table)

    def plot(
        self,
        by: Literal["parameter", "joint", "kind"] = "parameter",
        most: int = 12,
        ax: Axes | None = None,
    ) -> Axes:
        """Plot the budget as bars; see :func:`aacmm_pin.report.plots.plot_budget`."""
        return cast("Axes", report().plots.plot_budget(self, by, ax, most))

    def __str__(self) -> str:
        volume = self.volume / MM**3
        at = f"{self.sources.arm.name} at {self.sources.at}"
        without = omission(self.not_included)
        if not len(self.q):
            return f"{at} has no posture{without}"
        sizes = f"an accuracy volume of {volume.min():.3g} to {volume.max():.3g} mm³"
        over = f"in {len(self.q)} postures (method {self.method})"
        return f"{at} has {expanded(self.u)} and {sizes} {over}{without}"


def _u(covariance: Array) -> Array:
    variance = np.trace(covariance, axis1=1, axis2=2)
    return np.asarray(np.sqrt(variance))


def expanded(u: Array) -> str:
    """The least and largest of uncertainties [m], expanded, as text."""
    mm = COVERAGE_FACTOR * u / MM
    return f"U (k = {COVERAGE_FACTOR:g}) = {mm.min():.4f} to {mm.max():.4f} mm"


def paired(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> Index:
    """Numbers in the circle of the postures of ``accuracy``, (n,)."""
    inside = np.flatnonzero(circle.within_limits)
    if not np.array_equal(accuracy.q, circle.q[inside]):
        raise ShapeError(
            f"accuracy has {len(accuracy.q)} postures; expected {len(inside)}, the postures of the "
            "circle within limits; use "
            "accuracy_volume(arm, circle.q[circle.within_limits], at=circle.at)"
        )
    return inside


def circle_accuracy(
    circle: PosturesAtPoint, model: GivenModel | None = None, **options: Any
) -> AccuracyVolume:
    """Compute the accuracy of a circle's postures within limits, at its frame.

    Args:
        circle: from :func:`configuration_circle`.
        model: arm, perhaps with causes of error; default the circle's.
        options: of :func:`accuracy_volume` except ``at``; ``conditions`` of one record, or of each
            posture within limits.

    Raises:
        AacmmError: no posture within limits; see :func:`accuracy_volume` for others.
    """
    q = usable_postures(circle)
    return accuracy_volume(circle.arm if model is None else model, q, at=circle.at, **options)


def usable_postures(postures: PosturesAtPoint) -> Array:
    """The postures within limits, (n, nq) [rad]."""
    q = postures.q[postures.within_limits]
    if not len(q):
        raise AacmmError(f"{postures}; expected at least one posture within limits")
    return q


def accuracy_volume(
    model: GivenModel,
    q: ArrayLike,
    *,
    conditions: Conditions | None = None,
    at: str | None = None,
    method: Method = "zonotope",
    encoder_noise: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
    draws: int = 4000,
    workers: Workers = 1,
) -> AccuracyVolume:
    """Compute the accuracy volume and the covariance of the position of an arm at ``q``.

    The methods are:

    - ``zonotope``: volume of all displacements that the bounded parameters together can cause,
      exact to first order.
    - ``jointwise``: sum of the zonotopes of the DH rows (eq. 14 of Xu You et al. 2019); causes of
      the whole arm count as one more row. It is much smaller than the zonotope, which combines
      rows.
    - ``ellipsoid``: 95 % coverage ellipsoid of the covariance; only it includes unbounded noise.
    - ``monte-carlo``: convex hull of the exact positions at corners of the parameter box; the
      covariance is from random draws.

    Parameters of causes, and of a calibration, count as bounded by ± k u with k = 2. Correlated
    ones (``[covariance]`` of the arm file) enter the covariance as S Σ Sᵀ, and the volumes by the
    principal axes of their correlation. Errors of references do not count.

    Args:
        model: arm, perhaps with causes of error.
        q: postures ``(n, nq)`` [rad].
        conditions: of n records, or one for all postures. ``not_included`` lists causes ignored for
            want of a condition.
        at: frame whose origin is the point; default the tip; ``frame5`` is the wrist.
        encoder_noise: standard uncertainty of one reading, ``(nq,)`` or one number [rad]; default
            of the arm file.
        rng: required for ``monte-carlo``.
        draws: for each posture; only for ``monte-carlo``.
        workers: processes, or a ``concurrent.futures.Executor``; results do not depend on it.

    Raises:
        ShapeError: no finite ``(n, nq)`` array, or another number of ``conditions``.
        UnknownNameError: unknown method or frame.
        UnsupportedArmError: correlations of different rows with ``jointwise``.
        AacmmError: no uncertainty, negative noise, or no ``rng``.
    """
    if method not in METHODS:
        raise UnknownNameError("method", method, list(METHODS))
    from aacmm_pin._support.progress import bar
    from aacmm_pin._support.workers import results

    model = loaded(model)
    arm = ErrorModel.arm_of(model)
    drawn = method == "monte-carlo"
    q = batch(q, arm.nq, "q", "rad")
    if conditions is not None and conditions.n not in (1, len(q)):
        raise ShapeError(
            f"conditions have {conditions.n} records; expected {len(q)}, as many as q, or 1"
        )
    sources = ErrorSources.of(model, at, encoder_noise, q, conditions)
    work: Callable[[Any], tuple[Array, ...]] = partial(_first_order, sources, method)
    size = POSTURES_AT_ONCE
    parts = cast("Iterator[tuple[Any, ...]]", _parts(q, conditions))
    volume = np.empty(len(q))
    covariance = np.empty((len(q), 3, 3))
    if drawn:
        from aacmm_pin.accuracy.parameter_draws import FEWEST_DRAWS, exact_volume

        if rng is None:
            raise AacmmError(
                "rng is missing; expected a random generator for the method 'monte-carlo', such as "
                "numpy.random.default_rng(1)"
            )
        size = DRAWN_AT_ONCE
        work = partial(exact_volume, sources, whole(draws, FEWEST_DRAWS, "draws"))
        parts = ((*part, rng.spawn(len(part[0]))) for part in _parts(q, conditions, size))
    task = "Monte Carlo" if drawn else "accuracy"
    posture_bar = bar(drawn or len(q) > MANY, task, "posture", total=len(q))
    with posture_bar as progress, results(work, parts, workers) as numbered_results:
        for number, arrays in numbered_results:
            rows = slice(number * size, (number + 1) * size)
            volume[rows], covariance[rows] = arrays
            progress.update(len(arrays[0]))
    return AccuracyVolume(sources, q, method, volume, covariance, conditions)


def _parts(
    q: Array, conditions: Conditions | None, size: int = POSTURES_AT_ONCE
) -> Iterator[tuple[Array, Conditions | None]]:
    """Postures with their conditions; a single record holds for all."""
    for rows in chunks(len(q), size):
        postures = q[rows]
        if conditions is None:
            yield postures, None
            continue
        records = rows if conditions.n == len(q) else np.zeros(len(postures), dtype=np.intp)
        yield postures, conditions.take(records)


def _first_order(
    sources: ErrorSources, method: Method, part: tuple[Array, Conditions | None]
) -> tuple[Array, Array]:
    """Volume (n,) [m³] and covariance (n, 3, 3) [m²]."""
    sensitivity = sources.sensitivity(*part)
    covariance = sources.covariance_of(sensitivity)
    if method == "ellipsoid":
        determinant = np.maximum(np.linalg.det(covariance), 0.0)
        of_sphere = 4.0 / 3.0 * np.pi * ELLIPSOID_COVERAGE_FACTOR**3
        return of_sphere * np.sqrt(determinant), covariance
    generators = sources.generators(sensitivity)
    if method == "zonotope":
        return zonotope.volume(generators), covariance
    bounded = [sources.parameters[i] for i in sources.bounded]
    joints = np.array([p.joint or 0 for p in bounded])
    if sources.correlation is not None:
        correlated = sources.correlation[np.ix_(sources.bounded, sources.bounded)] != 0
        across_rows = np.argwhere(correlated & (joints[:, None] != joints))
        if len(across_rows):
            first, second = (bounded[i].name for i in across_rows[0])
            raise UnsupportedArmError(
                f"{sources.arm.name}: {first} and {second} of different rows are correlated; "
                "expected independent rows for the method 'jointwise'; use 'zonotope' or "
                "'ellipsoid'"
            )
    volumes = [zonotope.volume(generators[:, :, joints == joint]) for joint in np.unique(joints)]
    return np.sum(volumes, axis=0), covariance
