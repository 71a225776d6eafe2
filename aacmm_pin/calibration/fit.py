"""One calibration: robust start, what scatters more than stated, what is excluded, the final least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space, orth

from aacmm_pin._support.checks import Array
from aacmm_pin._support.distributions import chi2_isf, f_isf
from aacmm_pin._support.units import MM, UM
from aacmm_pin.calibration.identifiability import Undetermined
from aacmm_pin.calibration.linear_system import assemble
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.problem import OF_WIDTH, Problem
from aacmm_pin.calibration.solver import LEAST_DOF, MEDIAN, Chi2, Point, Solution, begin, deviations, solve, standing
from aacmm_pin.calibration.variance_components import (
    EFFICIENCY,
    FALSE_EXCLUSION,
    information_of_seats,
    root,
    squared_distances,
    variance_components,
)
from aacmm_pin.effects import Effect
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.observations import NOTHING_KNOWN, Observations

MOST_EXCLUDED = 0.15
"""Where more than this part of the records is excluded, they are no gross errors of single records."""
FEWEST_TOGETHER = 3
"""Fewer excluded records than this may be one mishap, whatever part of a few records they are."""
UNEQUAL = 1.5
"""Records far out scatter more, by their readings; where the noise is not stated, they are believed this much farther."""
MOST_ROUNDS = 12
NO_SCATTER = 5e-8
"""Scatter below this is none: the search for it ends just above zero, and nobody measures so well [m]."""
ONE_DIRECTION = 1e-2
"""Directions that records do not tell, found at tips and at targets, are one if the sine of their angle is less."""
STAYED = 1e-6
"""What moved by less than this part of its width along a direction that nothing tells has stayed."""
ALIKE = 1e-3
"""Scatters that change by less than this part of them are found."""
FIRST_SCATTER = 1e-4
"""What nobody stated counts as this until the records show what it is [m]."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem solved.

    Attributes:
        solution: the final least squares.
        stated: True where the stated noise was complete, so that ``chi2_stated`` judges the model.
        used: (n,) True for the records that count.
        excluded: (n,) True for outliers: records that fit too badly to be believed.
        chi2_stated: χ² against the stated noise alone; None where it was not complete.
        dof: degrees of freedom of the final fit.
        found: effects, by their keys, whose inner values (order, time constant) come from these records too, so that what is
            uncertain of them makes the other parameters uncertain; with the least u of each, by its name, where the
            derivative at the value that was found does not tell all.
    """

    solution: Solution
    stated: bool
    used: Mask
    excluded: Mask
    chi2_stated: Chi2 | None
    dof: float
    found: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """What was asked, of all records."""
        return self.solution.problem

    @property
    def noise(self) -> NoiseModel:
        """The noise with which the search ended."""
        return self.solution.noise

    @property
    def observations(self) -> Observations:
        """What the records say."""
        return self.noise.observations

    @property
    def unmodelled(self) -> float:
        """Scatter of each coordinate beyond the stated noise; 0 where the stated noise suffices [m]."""
        return self.noise.scatters.tip

    @property
    def turns(self) -> Array:
        """How far each record's orientation is from the stated one (n,) [rad]; NaN where none is stated."""
        return np.where(self.observations.oriented, np.linalg.norm(self.solution.system.off[:, 3:], axis=1), np.nan)

    @property
    def lever(self) -> float:
        """Distance over which a turn counts as much as a shift: that of their noise [m]; 0 without orientations."""
        both = self.residual_noise[self.used & self.observations.oriented]
        variances = np.diagonal(both, axis1=1, axis2=2).sum(axis=0)
        return float(np.sqrt(variances[:3].sum() / variances[3:].sum())) if len(both) else 0.0

    @property
    def tells_noise(self) -> bool:
        """Whether the noise is stated, or the records are enough to tell it."""
        return self.stated or self.dof >= LEAST_DOF

    @property
    def thinned(self) -> bool:
        """Whether so many records are excluded that something of their own may be wrong with them."""
        excluded = int(self.excluded.sum())
        return excluded >= FEWEST_TOGETHER and excluded > MOST_EXCLUDED * (excluded + int(self.used.sum()))

    @property
    def scatters(self) -> bool:
        """Whether there is scatter beyond the stated noise that is worth a word."""
        return max(self.noise.scatters) > NO_SCATTER

    @property
    def scatter_in_words(self) -> str:
        """Scatter of tips beyond the stated noise, and of turns where orientations are stated."""
        turns = f" and {self.noise.scatters.turn / UM:.3g} µrad" if self.problem.turns else ""
        return f"{self.unmodelled / MM:.4f} mm{turns}"

    @property
    def residual_noise(self) -> Array:
        """Covariance of each residual by its reading, its target and the scatter found (n, 3, 3) [m²], or (n, 6, 6)."""
        return self.noise.of_residuals

    @property
    def stated_noise(self) -> Array:
        """The same without the scatter that was found beside a noise that is stated in full."""
        return self.noise.without_scatter if self.stated else self.residual_noise

    def distance_of(self, covariance: Array) -> float:
        """RMS distance of the used records' tips and targets that residuals of such covariances (n, 3, 3) [m²] give [m].

        A seat of which no coordinates are known is where its own touches put it, which takes its part of their scatter.
        """
        variance, seat = np.trace(covariance[self.used, :3, :3], axis1=1, axis2=2), self.observations.seat[self.used]
        touches = np.bincount(seat + 1, minlength=len(self.observations.labels) + 1)[seat + 1]
        free = np.append(np.isnan(self.observations.stated[:, 0]), False)[seat]
        return float(np.sqrt((variance * np.where(free, 1.0 - 1.0 / touches, 1.0)).mean()))

    @cached_property
    def unknown(self) -> Array:
        """Directions of which these records tell nothing, in units of the scales (p, k), orthonormal.

        A direction that leaves every residual as it is tells nothing; but where tips scatter about their targets, a turn
        of the whole arm about its base, or of its target about the last joint, seems to move them a little apart, which
        would pass for knowledge. The first does not move targets apart, the second not tips: so both are asked.
        """
        point = self.solution.point
        off = np.nan_to_num(self.solution.system.deviation)
        seen = self.problem.predict(point.x, point.frame, point.prediction.tips - off)
        there = Point(point.x, point.frame, point.seats, replace(point.prediction, jacobian=seen.jacobian))
        at_targets = standing(self.problem, self.noise, there, self.solution.weights).spectrum
        spectra = (self.solution.spectrum, at_targets)
        return np.asarray(orth(np.hstack([s.directions[:, ~s.known] for s in spectra]), rcond=ONE_DIRECTION))

    @cached_property
    def undetermined(self) -> Undetermined:
        """What these records leave open, and what that moves."""
        return Undetermined(self.problem, self.solution.point, self.unknown)

    @property
    def covariance(self) -> Array:
        """Covariance of all columns, the frame's included (p, p) [units]; zero along what nothing determines."""
        p = self.problem.scales.size
        return self.with_inner[:p, :p]

    @property
    def inner_u(self) -> dict[tuple[str, str], float]:
        """Standard uncertainty of each inner value, by the effect's key and the name of the field."""
        u = np.sqrt(np.diag(self.with_inner)[self.problem.scales.size :])
        return dict(zip([(effect.key, name) for _, effect, name, _ in self.inner], u.tolist(), strict=True))

    @cached_property
    def inner(self) -> list[tuple[int, Effect, str, float]]:
        """Inner values: number and effect, field, how far off it may be."""
        inner = []
        for k, effect in enumerate(self.solution.effects):
            stated = {name: u for name, u in zip(effect.inner, effect.inner_u, strict=False) if u}
            widths = effect.inner_widths() if effect.key in self.found else stated
            inner += [(k, effect, name, width) for name, width in widths.items()]
        return inner

    @cached_property
    def with_inner(self) -> Array:
        """Covariance of all columns and, last, of the inner values."""
        inner, spectrum, problem, point = self.inner, self.solution.spectrum, self.problem, self.solution.point
        if not inner:
            return _covariance(spectrum.values, spectrum.directions, problem.scales, self.unknown)
        columns = [self._by_inner(*one) for one in inner]
        wider = replace(point.prediction, jacobian=np.concatenate([point.prediction.jacobian, np.stack(columns, 2)], axis=2))
        system = assemble(wider, self.noise, point.seats, self.solution.weights)
        scales = np.concatenate([problem.scales, [width for *_, width in inner]])
        prior = np.eye(scales.size)
        prior[: len(problem.widths), : len(problem.widths)] = problem.prior
        prior[len(problem.widths) : problem.scales.size] = 0.0  # nothing is known of the frame
        _, values, vt = np.linalg.svd(np.vstack([system.jacobian * scales, prior]), full_matrices=False)
        unknown = np.pad(self.unknown, ((0, len(inner)), (0, 0)))
        covariance = _covariance(values, vt.T, scales, unknown)
        for own, (_, effect, name, _) in enumerate(inner, start=problem.scales.size):
            variance, least = covariance[own, own], self.found.get(effect.key, {}).get(name, 0.0) ** 2
            if 0.0 < variance < least:  # and all that goes along with it
                along = covariance[own] / variance
                covariance = covariance + (least - variance) * np.outer(along, along)
        return covariance

    def _by_inner(self, number: int, effect: Effect, name: str, width: float) -> Array:
        """∂(pose)/∂(inner value) (n, 3 or 6) [m/unit] by central differences."""
        poses = []
        for step in (OF_WIDTH * width, -OF_WIDTH * width):
            effects = list(self.problem.vector.effects)
            effects[number] = replace(effects[number], **{name: getattr(effect, name) + step})
            moved = replace(self.problem, vector=replace(self.problem.vector, effects=tuple(effects)))
            poses.append(moved.poses(self.solution.point.x, self.solution.point.frame))
        return np.asarray(poses[0] - poses[1]) / (2 * OF_WIDTH * width)


def fit(problem: Problem, *, robust: bool = True, used: Mask | None = None) -> Fit:
    """Estimate what is unknown in ``problem``.

    First robustly, then without outliers (χ² of their residual, Bonferroni's bound over all records). The scatter beyond
    the stated noise is the variance component with which χ² meets its degrees of freedom, and is looked for only where the
    stated noise alone will not do.

    Args:
        problem: what is unknown.
        robust: look for outliers.
        used: the records that belong (n,), if that is known already; nothing is looked for then.

    Raises:
        AacmmError: no record says anything.
    """
    search = _Estimation(problem)
    says = search.observations.says
    if not says.any():
        raise AacmmError("no record says where the tip was: no reference coordinates, and no seat touched twice")
    point = begin(problem, search.observations)
    if used is None and robust:
        near = search.approached(point, says, robust=True)
        if redundant(near):
            noise, point, belongs = search.without_outliers(near)
            del near  # its rows are as large as those that come
            everyone = None if (belongs == says).all() else search.all_belong(point)
            return everyone or search.final(noise, point, belongs)
    used = says if used is None else used & says
    near = search.approached(point, used, robust=False)
    noise, point = near.noise, near.point
    del near
    return search.final(noise, point, used)


class _Estimation:
    """The steps of one fit: the scatter of the records, which of them belong, the parameters."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.stated = not problem.setup.unstated(problem.measurements)
        self.observations = observations_of(problem.measurements, problem.setup)

    def noise(self, point: Point, scatters: Scatters) -> NoiseModel:
        """The noise with scatters that stand in for what is not stated."""
        return NoiseModel.of(self.problem, point.x, point.frame, scatters, self.observations)

    def approached(self, point: Point, used: Mask, *, robust: bool) -> Solution:
        """A search with the scatter that the records have so far taken for noise; if robust, until it falls no more.

        From afar the noise itself would give the data so much weight that the search follows every valley of parameters
        which they hardly tell; the widths of the parameters hold it in.
        """
        tips, turns = (np.square(part).sum(axis=1) for part in np.split(deviations(self.observations, point), [3], axis=1))
        turned = turns[used & self.observations.oriented]
        tip = float(np.sqrt(np.median(tips[used]) / MEDIAN))
        scatters = Scatters(tip, float(np.sqrt(np.median(turned) / MEDIAN)) if turned.size else 0.0, tip)
        for _ in range(MOST_ROUNDS):
            noise = self.noise(point, scatters)
            solution = solve(self.problem, noise, point, used.astype(np.float64), robust=robust, roughly=True)
            if not robust:
                break
            point = solution.point
            before, scatters = scatters.tip, self.scatters_of_median(noise, point, used)
            if scatters.tip == 0.0 or scatters.tip > 0.8 * before:
                break
        return solution

    def without_outliers(self, near: Solution) -> tuple[NoiseModel, Point, Mask]:
        """The search without the records that do not belong, judged by the scatter of the better half: noise, end, and the
        others.
        """
        says = self.observations.says
        count, dof, of_each = int(says.sum()), max(near.chi2.dof, 1.0), np.maximum(self.observations.counts, 3)
        share = min(1.0, dof / int(self.observations.counts.sum()))
        scatters = self.scatters_of_median(near.noise, near.point, says, share)
        noise = self.noise(near.point, scatters)
        # A scatter that the records themselves tell is uncertain, and more records may seem far off beside it.
        chance = FALSE_EXCLUSION / count
        limit = of_each * f_isf(chance, of_each, EFFICIENCY * dof) if scatters.tip > 0 else chi2_isf(chance, of_each)
        limit = limit * (1.0 if self.stated else UNEQUAL**2)
        used = says.copy()
        solution = standing(self.problem, noise, near.point, near.weights)
        for tried in range(MOST_ROUNDS):
            belongs = says & (deleted_distances(solution) <= limit)
            if belongs.sum() < 0.5 * count or (tried and (belongs == used).all()):
                break
            used = belongs
            solution = solve(self.problem, noise, solution.point, used.astype(np.float64))
        return solution.noise, solution.point, used

    def all_belong(self, point: Point) -> Fit | None:
        """The fit of all records, if the stated noise and what is stated of the parameters explain it and each of them.

        Where records are few, a robust search fits some of them at the expense of others, which then seem to be outliers.
        """
        found = self.by_stated_noise(point, self.observations.says)[0] if self.stated else None
        if found is None:
            return None
        says = self.observations.says
        limit = chi2_isf(FALSE_EXCLUSION / int(says.sum()), np.maximum(self.observations.counts, 3))
        farthest = np.maximum(deleted_distances(found.solution), studentised_distances(found.solution))
        return found if (farthest <= limit)[says].all() else None

    def scatters_of_median(self, noise: NoiseModel, point: Point, used: Mask, share: float = 1.0) -> Scatters:
        """Scatters of tips and turns that bring their median squared distances to that of χ² with three degrees.

        Seats have that of tips. They are beyond the stated noise. What was fitted to the records has taken some away:
        ``share`` is what it left.
        """
        off, own, turned = deviations(noise.observations, point), noise.without_scatter, used & noise.observations.oriented
        tip = self._of_median(off[used, :3], own[used, :3, :3], share)
        return Scatters(tip, self._of_median(off[turned, 3:], own[turned, 3:, 3:], share) if turned.any() else 0.0, tip)

    def _of_median(self, deviation: Array, own: Array, share: float) -> float:
        def excess(variance: float) -> float:
            return float(np.median(squared_distances(deviation, own + variance * np.eye(3)))) - share * MEDIAN

        slack = MEDIAN * 6.0 / np.sqrt(len(own))  # the median of a few records scatters by itself
        if self.stated and excess(0.0) < slack:
            return 0.0
        return float(np.sqrt(root(excess, deviation)))

    def final(self, noise: NoiseModel, point: Point, used: Mask) -> Fit:
        """The final fit, with the stated noise alone or with the scatter with which χ² meets its degrees of freedom."""
        weights, judged = used.astype(np.float64), None
        if self.stated:
            found, judged = self.by_stated_noise(point, used)
            if found:
                return found
            first = self.scatters_of_median(self.noise(point, Scatters()), point, used)
            noise = self.noise(point, first._replace(tip=first.tip or FIRST_SCATTER))
        solution = solve(self.problem, noise, point, weights)
        for _ in range(MOST_ROUNDS):
            before = np.array(noise.scatters)
            noise = self.noise(solution.point, variance_components(solution, used, self.observations.unstated))
            solution = solve(self.problem, noise, solution.point, weights)
            after = np.array(noise.scatters)
            if (np.abs(after - before) <= ALIKE * after).all():
                break
        if self.stated:
            # From afar one step promises too little: judged again where the search came to rest.
            found, judged = self.by_stated_noise(solution.point, used)
            if found:
                return found
            solution = replace(solution, noise=self.noise(solution.point, noise.scatters))
        return self.fit(solution, used, judged)

    def by_stated_noise(self, point: Point, used: Mask) -> tuple[Fit | None, Chi2]:
        """The fit with the stated noise alone, if that may be right: by χ² after one more step, which spares the search."""
        alone, weights = self.noise(point, Scatters()), used.astype(np.float64)
        here = standing(self.problem, alone, point, weights)
        total, dof = here.chi2
        judged = Chi2(total - here.promise, dof)
        if not judged.acceptable:
            return None, judged
        solution = solve(self.problem, alone, point, weights)
        return self.fit(solution, used, solution.chi2), judged

    def fit(self, solution: Solution, used: Mask, judged: Chi2 | None) -> Fit:
        """The result, what nothing tells left where it was.

        Noise that is not the same in all directions would turn the arm as a whole where nothing else holds it.
        """
        found = Fit(solution, self.stated, used, self.observations.says & ~used, judged, solution.chi2.dof)
        free = found.unknown[: self.problem.widths.size].T
        if np.abs(free @ ((solution.point.x - self.problem.start) / self.problem.widths)).max(initial=0.0) < STAYED:
            return found
        end = solve(replace(self.problem, held=free), solution.noise, solution.point, solution.weights)
        back = standing(self.problem, solution.noise, end.point, solution.weights)
        return replace(
            found, solution=replace(back, steps=solution.steps + end.steps, held_up=solution.held_up or end.held_up)
        )


def _covariance(values: Array, directions: Array, scales: Array, unknown: Array) -> Array:
    """Covariance of the columns (p, p): inverse of the information across the unknown directions (p, k), zero along them.

    The information is that of singular values (p,) and directions, in columns (p, p), of the scaled system with its prior.
    """
    known = null_space(unknown.T) if unknown.size else np.eye(scales.size)
    triangle = np.linalg.qr((values[:, None] * directions.T) @ known, mode="r")
    scaled = known @ np.linalg.inv(triangle) * scales[:, None]
    return np.asarray(scaled @ scaled.T)


def deleted_distances(solution: Solution) -> Array:
    """Squared distance of each record from where the *others* put its target, over its own and that place's variance (n,).

    A record pulls an unknown point towards itself, the more the fewer the others are; and where it has been left out, its
    target is only as sure as the others of its seat make it; bars count for nothing here. Records without a target are
    infinitely far.
    """
    observations, covariance = solution.noise.observations, solution.noise.of_residuals[:, :3, :3].copy()
    off = solution.system.deviation.copy()
    touched = np.flatnonzero(observations.seat >= 0)
    if touched.size:
        seat = observations.seat[touched]
        whole, _, weighted = information_of_seats(solution)
        rest = np.linalg.inv(whole[seat] - weighted + NOTHING_KNOWN * np.eye(3))
        off[touched] += np.einsum("nij,njk,nk->ni", rest, weighted, off[touched])
        covariance[touched] += rest
    found = np.full(len(off), np.inf)
    says = observations.says
    found[says] = squared_distances(off[says], covariance[says]) + np.nan_to_num(solution.system.turn_distance[says])
    return found


def studentised_distances(solution: Solution) -> Array:
    """Squared distance of each record from its target over the variance that is left after its share in the parameters (n,).

    ``eᵀ (I - H)⁻¹ e`` with the record's whitened residual and its block of the hat matrix of the system with its prior
    (internally studentised residuals; Cook and Weisberg 1982). Records without a target are infinitely far.
    """
    system, spectrum, says = solution.system, solution.spectrum, solution.noise.observations.says
    known, wide = spectrum.known, solution.noise.of_residuals.shape[1]
    rows = wide * int(says.sum())
    directions = solution.problem.scales[:, None] * spectrum.directions[:, known] / spectrum.values[known]
    along = (system.jacobian[:rows] @ directions).reshape(-1, wide, int(known.sum()))
    left = np.eye(wide) - along @ along.transpose(0, 2, 1)
    found = np.full(len(says), np.inf)
    found[says] = squared_distances(system.residual[:rows].reshape(-1, wide), left)
    return found


def redundant(solution: Solution) -> bool:
    """Whether the records are enough to tell which of them are wrong: half of them cannot be fitted whatever they say."""
    return solution.chi2.dof >= 0.5 * solution.system.free
