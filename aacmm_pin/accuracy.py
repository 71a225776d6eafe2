"""Accuracy of an arm at given configurations: covariance, accuracy volume, largest deviation, budget.

``p(κ + δ) ≈ p(κ) + S δ`` with the sensitivity S of :meth:`Arm.sensitivity`; the Monte Carlo method moves the real model
instead and is the check on the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull
from scipy.stats import chi2

from aacmm_pin import zonotope
from aacmm_pin.arm import Arm
from aacmm_pin.checks import Array, batch, vector
from aacmm_pin.configurations import ConfigurationCircle
from aacmm_pin.dh import chunks
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.parameter import Parameter, Scope
from aacmm_pin.units import DEG, MM

Method = Literal["zonotope", "jointwise", "ellipsoid", "monte-carlo"]
METHODS: tuple[Method, ...] = get_args(Method)

COVERAGE = 0.95
COVERAGE_FACTOR = float(np.sqrt(chi2.ppf(COVERAGE, 3)))
"""k = 2.80: the ellipsoid that holds 95 % of a normal distribution in three dimensions (JCGM 102:2011, table 1)."""
ALL_SCOPES: tuple[Scope, ...] = get_args(Scope)


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """What may be off in an arm: its geometric parameters and, where stated, the noise of its encoders.

    Attributes:
        arm: the arm.
        at: frame whose origin is looked at.
        parameters: the sources that have an uncertainty and whose scope was asked for.
        columns: their columns among the sensitivities to all parameters and then all joints.
    """

    arm: Arm
    at: str
    parameters: tuple[Parameter, ...]
    columns: tuple[int, ...]

    @staticmethod
    def of(arm: Arm, at: str | None, encoder_noise: Array | None, scopes: tuple[Scope, ...]) -> ErrorSources:
        """Gather the sources of ``arm``.

        Raises:
            AacmmError: no source has an uncertainty, so that every answer would be "perfect".
        """
        noise = arm.encoder_noise if encoder_noise is None else encoder_noise
        encoders = [] if noise is None else [_encoder(j, float(u)) for j, u in enumerate(noise, start=1)]
        known = [(c, p) for c, p in enumerate([*arm.parameters, *encoders]) if p.u > 0 and p.scope in scopes]
        if not known:
            raise AacmmError(
                f"{arm.name}: no parameter of scope {', '.join(scopes)} has an uncertainty; state half-widths in the arm "
                "file (uncertainty = {...}), encoder noise, or half-widths for a URDF arm"
            )
        return ErrorSources(arm, at or arm.tip, tuple(p for _, p in known), tuple(c for c, _ in known))

    @property
    def u(self) -> Array:
        """Standard uncertainties (p,) [m or rad]."""
        return np.array([p.u for p in self.parameters])

    @property
    def bounded(self) -> tuple[int, ...]:
        """Which of the parameters have stated bounds."""
        return tuple(i for i, p in enumerate(self.parameters) if p.half_width is not None)

    def sensitivity(self, q: Array) -> Array:
        """∂position/∂source for ``q`` (n, nq): (n, 3, p) [m/unit]."""
        columns = np.array(self.columns)
        geometric = len(self.arm.parameters)
        sensitivity = self.arm.sensitivity(q, self.at)[:, :, columns[columns < geometric]]
        encoders = columns[columns >= geometric] - geometric
        if not encoders.size:
            return sensitivity
        return np.concatenate([sensitivity, self.arm.jacobian(q, self.at)[:, :, encoders]], axis=2)

    def generators(self, q: Array) -> Array:
        """Half-width times sensitivity of the bounded parameters: (n, 3, b) [m].

        Raises:
            AacmmError: no parameter is bounded.
        """
        pick = list(self.bounded)
        if not pick:
            raise AacmmError(f"{self.arm.name}: no parameter has stated bounds; only the ellipsoid can be given")
        widths = np.array([self.parameters[i].half_width for i in pick], dtype=np.float64)
        return np.asarray(self.sensitivity(q)[:, :, pick] * widths)

    def covariance(self, q: Array) -> Array:
        """Covariance of the position, S U Sᵀ (JCGM 102:2011, 6.2): (n, 3, 3) [m²]."""
        scaled = self.sensitivity(q) * self.u
        return np.asarray(scaled @ scaled.transpose(0, 2, 1))


@dataclass(frozen=True, eq=False)
class AccuracyVolume:
    """Accuracy at many configurations.

    Attributes:
        sources: what may be off.
        q: configurations (n, nq) [rad].
        method: how ``volume`` was found.
        volume: accuracy volume (n,) [m³].
        covariance: covariance of the position, all sources (n, 3, 3) [m²]; with ``monte-carlo`` that of the draws.
        sampling_error: Monte Carlo only: how far half of the draws change the volume (n,) [m³].
    """

    sources: ErrorSources
    q: Array
    method: Method
    volume: Array
    covariance: Array
    sampling_error: Array | None = None

    @property
    def u(self) -> Array:
        """Standard uncertainty of the position, the root of the summed variances of its three coordinates: (n,) [m]."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))

    @cached_property
    def largest_deviation(self) -> Array:
        """Largest distance that the bounded parameters together can cause, to first order: (n,) [m]."""
        parts = [zonotope.largest_deviation(self.sources.generators(self.q[part])) for part in chunks(len(self.q))]
        return np.concatenate([np.empty(0), *parts])

    def budget(self, by: Literal["parameter", "joint", "kind"] = "parameter") -> pd.DataFrame:
        """Uncertainty budget (JCGM 100:2008, 5.1): each source's part in the mean variance over the configurations.

        Returns:
            A table, largest first: the parameter (or joint, or kind), ``u_mm`` (its root mean square contribution) and
            ``share`` (of the variance; the shares sum to 1).
        """
        variance = np.zeros(len(self.sources.parameters))
        for part in chunks(len(self.q)):
            variance += np.square(self.sources.sensitivity(self.q[part]) * self.sources.u).sum(axis=(0, 1))
        parameters = self.sources.parameters
        table = pd.DataFrame(
            {
                "parameter": [p.name for p in parameters],
                "joint": [p.joint for p in parameters],
                "kind": [p.kind for p in parameters],
                "scope": [p.scope for p in parameters],
                "variance": variance / len(self.q),
            }
        )
        if by != "parameter":
            table = pd.DataFrame(table.groupby(by, as_index=False)["variance"].sum())
        table["u_mm"] = np.sqrt(table["variance"]) / MM
        table["share"] = table["variance"] / table["variance"].sum()
        return table.drop(columns="variance").sort_values("share", ascending=False, ignore_index=True)

    def to_frame(self) -> pd.DataFrame:
        """One row for each configuration: theta1_deg …, volume_mm3, u_mm, and largest_deviation_mm where it is bounded."""
        table = {f"theta{j + 1}_deg": self.q[:, j] / DEG for j in range(self.q.shape[1])}
        table |= {"volume_mm3": self.volume / MM**3, "u_mm": self.u / MM}
        if self.sources.bounded:
            table["largest_deviation_mm"] = self.largest_deviation / MM
        return pd.DataFrame(table)

    def _repr_html_(self) -> str:
        summary = self.to_frame().filter(regex="_mm").describe().loc[["count", "min", "50%", "max"]].to_html()
        return f"<p>{self}</p>{summary}{self.budget().head(8).to_html()}"

    def __str__(self) -> str:
        volume = self.volume / MM**3
        what = f"{self.sources.arm.name} at {self.sources.at}, {self.method}, {len(self.q)} configurations"
        if not len(self.q):
            return what
        return (
            f"{what}: volume {volume.min():.3g} to {volume.max():.3g} mm³, "
            f"standard uncertainty {self.u.min() / MM:.4f} to {self.u.max() / MM:.4f} mm"
        )


def circle_accuracy(
    circle: ConfigurationCircle,
    *,
    method: Method = "zonotope",
    encoder_noise: ArrayLike | None = None,
    scopes: tuple[Scope, ...] = ALL_SCOPES,
    rng: np.random.Generator | None = None,
    draws: int = 4000,
) -> AccuracyVolume:
    """Accuracy of those configurations of a circle that are within limits, at the circle's own frame.

    See :func:`accuracy_volume` for the arguments.

    Raises:
        AacmmError: no configuration is within limits; see :func:`accuracy_volume` for the rest.
    """
    q = circle.q[circle.within_limits]
    if not len(q):
        raise AacmmError(f"{circle}; no configuration to judge")
    return accuracy_volume(
        circle.arm, q, at=circle.at, method=method, encoder_noise=encoder_noise, scopes=scopes, rng=rng, draws=draws
    )


def accuracy_volume(
    arm: Arm,
    q: ArrayLike,
    *,
    at: str | None = None,
    method: Method = "zonotope",
    encoder_noise: ArrayLike | None = None,
    scopes: tuple[Scope, ...] = ALL_SCOPES,
    rng: np.random.Generator | None = None,
    draws: int = 4000,
) -> AccuracyVolume:
    """Accuracy volume and covariance of the arm at ``q``.

    - ``zonotope``: volume of everything that the bounded parameters can do together, exact to first order.
    - ``jointwise``: eq. 14 of Xu You et al. 2019, read as the sum over the rows of each row's own zonotope. Smaller by far
      than the zonotope: rows do not add their volumes, they multiply the ways in which they combine.
    - ``ellipsoid``: 95 % coverage ellipsoid of the covariance; the only one in which unbounded noise has a part.
    - ``monte-carlo``: the real model at corners of the parameter box, convex hull; covariance from random draws.

    Args:
        arm: the arm.
        q: configurations (n, nq) [rad].
        at: frame whose origin is looked at; default the tip, ``frame5`` for the wrist.
        method: one of the four.
        encoder_noise: standard uncertainty of one reading, (nq,) or one number [rad]; default what the arm states.
        scopes: which parameters take part: shared by all records (``arm``), by a ``session``, or new each ``record``.
        rng: needed for ``monte-carlo``.
        draws: Monte Carlo draws for each configuration.

    Raises:
        ShapeError: ``q`` is not a finite (n, nq) array.
        UnknownNameError: no such method or frame.
        AacmmError: nothing has an uncertainty, noise is negative, or ``rng`` is missing.
    """
    if method not in METHODS:
        raise UnknownNameError("method", method, list(METHODS))
    q = batch(q, arm.nq, "q", "rad")
    sources = ErrorSources.of(arm, at, _noise(arm, encoder_noise), scopes)
    if method == "monte-carlo":
        if rng is None:
            raise AacmmError("method 'monte-carlo' needs rng, a numpy.random.Generator such as numpy.random.default_rng(1)")
        return _monte_carlo(sources, q, rng, draws)
    volume, covariance = np.empty(len(q)), np.empty((len(q), 3, 3))
    rule = _RULES[method]
    for part in chunks(len(q)):
        covariance[part] = sources.covariance(q[part])
        volume[part] = rule(sources, q[part], covariance[part])
    return AccuracyVolume(sources, q, method, volume, covariance)


def _noise(arm: Arm, encoder_noise: ArrayLike | None) -> Array | None:
    if encoder_noise is None:
        return None
    noise = np.asarray(encoder_noise, dtype=np.float64)
    noise = vector(np.full(arm.nq, noise) if noise.ndim == 0 else noise, arm.nq, "encoder_noise", "rad")
    if (noise < 0).any():
        raise AacmmError(f"encoder_noise is {noise.min()} rad, expected numbers that are not negative")
    return noise


def _encoder(joint: int, u: float) -> Parameter:
    return Parameter(f"encoder_noise{joint}", "encoder", joint, "rad", 0.0, None, u, "record")


def _zonotope(sources: ErrorSources, q: Array, covariance: Array) -> Array:
    return zonotope.volume(sources.generators(q))


def _jointwise(sources: ErrorSources, q: Array, covariance: Array) -> Array:
    generators = sources.generators(q)
    joints = np.array([sources.parameters[i].joint for i in sources.bounded])
    volumes = [zonotope.volume(generators[:, :, joints == joint]) for joint in np.unique(joints)]
    return np.asarray(np.sum(volumes, axis=0))


def _ellipsoid(sources: ErrorSources, q: Array, covariance: Array) -> Array:
    determinant = np.maximum(np.linalg.det(covariance), 0.0)
    return np.asarray(4.0 / 3.0 * np.pi * COVERAGE_FACTOR**3 * np.sqrt(determinant))


_RULES: dict[str, Callable[[ErrorSources, Array, Array], Array]] = {
    "zonotope": _zonotope,
    "jointwise": _jointwise,
    "ellipsoid": _ellipsoid,
}


def _monte_carlo(sources: ErrorSources, q: Array, rng: np.random.Generator, draws: int) -> AccuracyVolume:
    if draws < 100:
        raise AacmmError(f"draws is {draws}, expected at least 100")
    volume, error, covariance = np.empty(len(q)), np.empty(len(q)), np.empty((len(q), 3, 3))
    generators = sources.generators(q)
    for k in range(len(q)):
        corners = _positions_at_corners(sources, q[k : k + 1], generators[k], rng, draws)
        volume[k] = ConvexHull(corners).volume
        error[k] = volume[k] - ConvexHull(corners[: draws // 2]).volume
        covariance[k] = np.cov(_positions_at_draws(sources, q[k : k + 1], rng, draws).T)
    return AccuracyVolume(sources, q, "monte-carlo", volume, covariance, error)


def _positions_at_corners(sources: ErrorSources, q: Array, generators: Array, rng: np.random.Generator, m: int) -> Array:
    """Exact positions at the corners of the box that go farthest along random directions; any corner is possible,
    so the hull never exceeds the true set, and random interior draws would leave most of it empty.
    """
    directions = rng.normal(size=(m, 3))
    widths = np.array([sources.parameters[i].half_width for i in sources.bounded], dtype=np.float64)
    corners = np.sign(directions @ generators) * widths
    return _moved(sources, q, corners, sources.bounded)


def _positions_at_draws(sources: ErrorSources, q: Array, rng: np.random.Generator, m: int) -> Array:
    """Exact positions under draws of all sources: rectangular where bounded, normal elsewhere (JCGM 101:2008, 6.4)."""
    errors = rng.normal(size=(m, len(sources.parameters))) * sources.u
    for i in sources.bounded:
        half_width = sources.parameters[i].half_width
        errors[:, i] = rng.uniform(-1.0, 1.0, size=m) * (half_width or 0.0)
    return _moved(sources, q, errors, tuple(range(len(sources.parameters))))


def _moved(sources: ErrorSources, q: Array, errors: Array, which: tuple[int, ...]) -> Array:
    """Positions of the real model with ``errors`` (m, len(which)) in the sources ``which``."""
    geometric = len(sources.arm.parameters)
    whole = np.zeros((len(errors), geometric + sources.arm.nq))
    whole[:, [sources.columns[i] for i in which]] = errors
    return sources.arm.perturbed_positions(q + whole[:, geometric:], whole[:, :geometric], sources.at)
