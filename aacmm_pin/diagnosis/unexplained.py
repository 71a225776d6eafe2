"""What no cause of the library explains: the discrepancy, what it depends on, its size, and groups
that do not fit in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown, report, two_digits
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.shared_exclusions import Shared, round_excluded, shared_by
from aacmm_pin.diagnosis.background import Background
from aacmm_pin.diagnosis.branches import Branches, branches_of
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.cross_validation import Gain
from aacmm_pin.diagnosis.nonlinear_parameters import noise_is_known
from aacmm_pin.diagnosis.odd_groups import OddGroup, odd_groups
from aacmm_pin.diagnosis.significance import family_wise_p_value, p_value_of_structure
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

BACKGROUND = "background"
"""Name of the part of the discrepancy that is too diffuse to be named."""


@dataclass(frozen=True)
class DiscrepancySize(Shown):
    """A part of what no cause explains.

    Attributes:
        covariate: what it depends on, or ``background``.
        rms: root mean square displacement of the tips by what recalibration leaves of it [m].
        u: standard uncertainty of that displacement, root mean square over the records [m].
        probability: that it is there.
    """

    covariate: str
    rms: float
    u: float
    probability: float


@dataclass(frozen=True)
class ScatteredReadings(Shown):
    """Readings of a joint that scatter more than stated.

    Attributes:
        joint: row of the joint.
        scatter: standard deviation beyond the stated noise [rad; m where the joint slides].
        slides: whether the joint slides.
        at_tips: what it moves tips by, root mean square [m].
        log_ratio: log likelihood with it over that without.
        p_value: chance of as much in any joint if none scatters more.
    """

    joint: int
    scatter: float
    slides: bool
    at_tips: float
    log_ratio: float
    p_value: float

    @property
    def note(self) -> Note:
        """That they do."""
        code = "readings_of_slide_scatter" if self.slides else "readings_scatter"
        return Note(code, {"joint": self.joint, "scatter": self.scatter})

    def __str__(self) -> str:
        return str(self.note)


@dataclass(frozen=True)
class SharedError(Shown):
    """An error that records of one posture share, beside all that was found.

    Attributes:
        rms: of tips [m].
        times: that of a single record.
        p_value: chance of as much if they share none.
    """

    rms: float
    times: float
    p_value: float

    @property
    def note(self) -> Note:
        """That they do."""
        return Note("postures_share_error", {"rms": self.rms, "times": two_digits(self.times)})

    def __str__(self) -> str:
        return str(self.note)


@dataclass(frozen=True, eq=False)
class Unexplained(Shown):
    """Structure that no cause of the library has.

    Attributes:
        p_value: chance of as much structure over any covariate when there is none, family-wise.
        threshold: structure with less chance than this is left.
        depends_on: the covariates, strongest first.
        discrepancy: covariates more probable than not, strongest first; last the background, if it
            is not negligible.
        choice: the search behind it.
        acts_on: for each, in words, what it acts on.
        gain: by how much the discrepancy lowers the RMS of held-out records below that of the
            causes alone, or None.
        groups: groups of records that do not agree with the others.
        excluded: what the excluded records share, or None.
        branches: the joint over which the residuals fall into two branches, or None.
        readings: other joints whose readings scatter more than stated.
        shared_by_postures: the error that records of one posture share, or None.
    """

    p_value: float
    threshold: float
    depends_on: tuple[str, ...]
    discrepancy: tuple[DiscrepancySize, ...]
    choice: Choice
    acts_on: dict[str, str]
    gain: float | None
    groups: tuple[OddGroup, ...] = ()
    excluded: Shared | None = None
    branches: Branches | None = None
    readings: tuple[ScatteredReadings, ...] = ()
    shared_by_postures: SharedError | None = None

    @cached_property
    def shapes(self) -> dict[str, pd.DataFrame]:
        """For each covariate one row a record: the covariate; the smooth correction, in x, y, z of
        the tip [mm], or as angle of a joint [µrad] or growth of all lengths [µm/m]; and the same as
        each record has it (``_of_record``).
        """
        return dict(report().structure_shapes.shapes_of(self.choice))

    @property
    def left(self) -> bool:
        """Whether structure is left beyond chance."""
        return self.p_value < self.threshold

    @property
    def has_background(self) -> bool:
        """Whether a part of it is too diffuse to be named."""
        return any(each.covariate == BACKGROUND for each in self.discrepancy)

    @property
    def structure(self) -> bool:
        """Whether the residuals have structure that is more probable than not."""
        others = (self.branches, self.shared_by_postures)
        return bool(self.depends_on or self.discrepancy or self.readings) or others != (None, None)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What it depends on, and which groups do not fit in."""
        odd = {group.name: group for group in self.groups}
        covariates = [name for name in self.depends_on if name not in odd]
        depends = [Note("depends_on", {"covariates": covariates})] if covariates else []
        groups = [
            Note("group_differs", {"group": group.name, "times": group.times})
            for group in self.groups
        ]
        return (*depends, *groups, *(one.note for one in self.apart))

    @property
    def apart(self) -> tuple[Branches | ScatteredReadings | SharedError, ...]:
        """What is left beside structure over a column."""
        each = (self.branches, *self.readings, self.shared_by_postures)
        return tuple(one for one in each if one is not None)


def unexplained_by(
    choice: Choice, held: Gain | None, named: bool, rng: np.random.Generator
) -> Unexplained:
    """The discrepancy, or else whether anything seems left; ``named``: something was found."""
    mine = {k: choice.covariate(k) for k in choice.covariates}
    odd = tuple(odd_groups(choice))
    shared = shared_by(choice.fit) or round_excluded(choice.fit, _whitened(choice))
    depends = [group.name for group in odd[:1]]
    for covariate in mine.values():
        depends += covariate.depends_on
    chances = _chances(choice, odd, rng)
    if shared is not None:
        chances.append(shared.p_value)
        if not (shared.name == "place" and "x" in depends):
            depends.append(shared.name)
    background = _background(choice)
    branches = branches_of(choice)
    # What these leave of a joint is no scatter.
    known = [*depends, f"joint {branches.joint}"] if branches else depends
    readings = [one for one in scattered_readings(choice) if f"joint {one.joint}" not in known]
    described = [_discrepancy(choice, k, covariate.name) for k, covariate in mine.items()]
    sizes = (*described, *background)
    return Unexplained(
        p_value=min(chances),
        threshold=THRESHOLDS.left if named else THRESHOLDS.left_alone,
        depends_on=tuple(dict.fromkeys(depends)),
        discrepancy=sizes,
        choice=choice,
        acts_on={covariate.name: choice.way(k).acts_on for k, covariate in mine.items()},
        gain=held.discrepancy_gain if held is not None and sizes else None,
        groups=odd,
        excluded=shared,
        branches=branches,
        readings=tuple(readings),
        shared_by_postures=_shared_error(choice),
    )


def _chances(choice: Choice, odd: Sequence[OddGroup], rng: np.random.Generator) -> list[float]:
    """P-values of the covariates that are named; of all of them and of odd groups where none is."""
    candidates = choice.candidates
    posterior = choice.posterior
    if not choice.covariates:
        of_any = p_value_of_structure(candidates, posterior.median_model)
        return [of_any, *(group.p_value for group in odd), 1.0]
    return [
        family_wise_p_value(candidates, posterior.without(k), k, rng) for k in choice.covariates
    ]


def _shared_error(choice: Choice) -> SharedError | None:
    """The error that records of one posture share; None if that is chance, or small beside that of
    a record.
    """
    noise = choice.noise
    fit = choice.design.fit
    postures = noise.postures
    if postures.p_value >= THRESHOLDS.left or postures.ratio < THRESHOLDS.large:
        return None
    of_record = np.sqrt(choice.posterior.median_model.variance) * fit.distance_of(noise.covariances)
    return SharedError(float(postures.ratio * of_record), postures.ratio, postures.p_value)


def _whitened(choice: Choice) -> Array:
    """How far tips are off beside all that was found, in units of the noise; what a posture shares
    counts once (n, 3).
    """
    noise = choice.noise
    off = np.einsum("nij,nj->ni", noise.whitening, choice.design.deviations(choice.tips))
    return noise.postures.whitened(off[:, :3])


def scattered_readings(choice: Choice) -> tuple[ScatteredReadings, ...]:
    """The joints whose readings scatter more than stated, the largest first."""
    fit = choice.design.fit
    if noise_is_known(fit) or fit.problem.setup.encoder_noise is None:
        return ()
    scatter = choice.scatter_left
    chain = fit.problem.model.arm.chain
    noise = fit.distance_of(fit.stated_noise)
    found = []
    for j, row in enumerate(chain.moving_rows()):
        at_tips = float(scatter.at_tips[j])
        log_ratio = float(scatter.log_ratios[j])
        if at_tips > THRESHOLDS.large * noise:
            chance = min(1.0, 0.5 * scatter.readings.size * float(chi2_sf(2.0 * log_ratio, 1)))
            size = float(scatter.readings[j])
            slides = bool(chain.prismatic[j])
            found.append(ScatteredReadings(int(row), size, slides, at_tips, log_ratio, chance))
    return tuple(sorted(found, key=lambda one: -one.at_tips))


def excess_of(extended: Fit) -> float:
    """By how much χ² is larger than the stated noise explains, over the scatter found in its place;
    0 where it is not.

    Of shifts or of rotations. Where the noise of the encoders is not stated, they may have as much
    as plain ones.
    """
    if (
        extended.chi2_stated is None
        or max(extended.unmodelled, extended.noise.scatters.turn) == 0.0
    ):
        return 0.0
    off = extended.system.off
    explained = np.diagonal(extended.stated_noise, axis1=1, axis2=2)
    if extended.problem.setup.encoder_noise is None:
        point = extended.point
        by_reading = extended.problem.reading_jacobian(point.x, point.frame)
        explained = explained + THRESHOLDS.plain_encoder**2 * np.square(by_reading).sum(axis=2)
    kinds = [
        (slice(3), extended.used),
        (slice(3, 6), extended.used & extended.observations.oriented),
    ]
    limit = THRESHOLDS.much_more**2
    much = any(
        np.square(off[some, of]).sum() > limit * explained[some, of].sum() for of, some in kinds
    )
    chi2, dof = extended.chi2_stated
    return max(extended.dof * (1.0 - dof / chi2), 0.0) if much else 0.0


def _discrepancy(choice: Choice, block: int, name: str) -> DiscrepancySize:
    """The size of a covariate's part, at its posterior mean."""
    model = choice.posterior.median_model
    design = choice.design
    absorbed = choice.posterior.space.base(0).whitened[:, design.blocks[block].columns]
    own = model.places[block]
    estimate = model.estimate[own]
    covariance = model.covariance[own, own]
    rms, u = _sizes(choice, design.columns(block), absorbed, estimate, covariance)
    return DiscrepancySize(name, rms, u, choice.posterior.probability(block))


def _background(choice: Choice) -> list[DiscrepancySize]:
    """The background at its most probable amplitude; none where it may be zero, is negligible, or
    smaller than its u.
    """
    model = choice.posterior.median_model
    if not model.base.amplitude:
        return []
    background = Background(model)
    products = model.base.gram.products
    columns, weights = products.background
    absorbed = choice.posterior.space.base(0).whitened[:, columns] @ weights
    rms, u = _sizes(
        choice, products.background_columns, absorbed, background.estimate, background.covariance
    )
    noise = choice.design.fit.distance_of(choice.design.fit.residual_noise)
    there = float(1.0 - choice.posterior.amplitudes[0])
    if there < THRESHOLDS.settled or rms < max(THRESHOLDS.negligible * noise, u):
        return []
    return [DiscrepancySize(BACKGROUND, rms, u, there)]


def _sizes(
    choice: Choice, columns: Array, absorbed: Array, estimate: Array, covariance: Array
) -> tuple[float, float]:
    """Root mean square displacement of the used records' tips, and its standard uncertainty [m]: of
    what recalibration leaves of it.

    Args:
        choice: what was found.
        columns: displacement by one unit of each parameter (n, 3 or 6, q).
        absorbed: their products with the nuisances, divided by the factor of these (nuisances, q).
        estimate, covariance: of the parameters (q,), (q, q).
    """
    design = choice.design
    factor = choice.posterior.space.base(0).factor
    refitted = scipy.linalg.solve_triangular(factor, absorbed, lower=True, trans=1)
    displacement = columns - design.columns(None) @ refitted
    stay = design.deviations(design.tips)
    moved = []
    for k in range(len(estimate)):
        off = design.deviations(design.tips + displacement[:, :, k])
        moved.append((off - stay)[choice.fit.used, :3])
    rows = np.stack(moved, axis=2)
    square = np.square(rows @ estimate).sum()
    variance = np.einsum("nij,jk,nik->", rows, covariance, rows, optimize=True)
    rms, u = np.sqrt(np.maximum([square, variance], 0.0) / len(rows)).tolist()
    return rms, u
