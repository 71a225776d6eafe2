"""What no cause of the library explains, and what it depends on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.display import Note, Shown, report, two_digits
from aacmm_pin._support.distributions import chi2_sf, f_sf
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.shared_exclusions import Shared, shared_by
from aacmm_pin.diagnosis.choice import Choice, noise_is_known
from aacmm_pin.diagnosis.design_matrix import displacements
from aacmm_pin.diagnosis.held_out_gain import Gain
from aacmm_pin.diagnosis.significance import family_wise_p_value, p_value_of_structure
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import JointZeroOffset
from aacmm_pin.measurements import Measurements

NAMED_QUANTITIES = 2
"""So many quantities that the residuals depend on are named in a sentence, strongest first."""


FEWEST_IN_ORDER = 30
"""With fewer records the limits of chance are too wide to be of use."""
LEAST_PART_OF_LEVER = 1e-3
"""A joint says nothing of records that it displaces by less than this part of its largest
displacement.
"""


@dataclass(frozen=True)
class DiscrepancySize(Shown):
    """A part of what no cause explains.

    Attributes:
        covariate: what it depends on.
        rms: root mean square displacement of the tips by what recalibration leaves of it [m].
        u: standard uncertainty of that displacement, root mean square over the records [m].
        probability: of its inclusion.
    """

    covariate: str
    rms: float
    u: float
    probability: float


@dataclass(frozen=True)
class ScatteredReadings(Shown):
    """Readings of a joint that scatter more than stated.

    Attributes:
        scatter: standard deviation beyond the stated noise [rad; m where the joint slides].
        stated: whether the noise of readings is stated; if not, they scatter more than those of the
            other joints.
        at_tips: root mean square displacement of the tips [m].
        log_ratio: log likelihood with this scatter over that without.
        p_value: probability of as much scatter in any joint if none scatters more than stated.
    """

    joint: int
    scatter: float
    slides: bool
    stated: bool
    at_tips: float
    log_ratio: float
    p_value: float

    @property
    def note(self) -> Note:
        """Note that readings scatter."""
        code = "readings_scatter" if self.stated else "readings_scatter_most"
        unit = "µm" if self.slides else "µrad"
        return Note(code, {"joint": self.joint, "scatter": self.scatter, "unit": unit})

    def __str__(self) -> str:
        return str(self.note)


@dataclass(frozen=True)
class SharedError(Shown):
    """An error that records of one posture share, beyond all that was found.

    Attributes:
        rms: root mean square displacement of the tips [m].
        times: ``rms`` over that of the noise of a single record.
        p_value: probability of as much if they share none.
    """

    rms: float
    times: float
    p_value: float

    @property
    def note(self) -> Note:
        """Note that records share an error."""
        return Note("postures_share_error", {"rms": self.rms, "times": two_digits(self.times)})

    def __str__(self) -> str:
        return str(self.note)


@dataclass(frozen=True)
class RunOrder(Shown):
    """Records that follow each other in time share an error.

    Attributes:
        joint: row of the joint whose error they share; None for a displacement of the tip in the
            room.
        correlation: lag-1 autocorrelation of the whitened residuals along the displacement by the
            joint, or along the axes of the room.
        limit: 95 % limit of the correlation if the records share nothing.
        p_value: chance of such a correlation at any joint or at the tip if they share nothing.
        records: how many have a residual along that displacement.
    """

    joint: int | None
    correlation: float
    limit: float
    p_value: float
    records: int

    @property
    def note(self) -> Note:
        """Note that consecutive records share an error."""
        data = {"correlation": self.correlation, "limit": self.limit}
        if self.joint is None:
            return Note("run_order_of_tip", data)
        return Note("run_order_of_joint", {"joint": self.joint, **data})

    def __str__(self) -> str:
        return str(self.note)


@dataclass(frozen=True)
class OddGroup(Shown):
    """A group whose records are farther off than the others let expect.

    Attributes:
        name: such as ``bar left``.
        times: distance of its records from their prediction by the others, over that of the others
            from one another, in units of the scatter of residuals at the same postures.
        p_value: chance of that in a good set, for the best of all groups.
    """

    name: str
    records: int
    times: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Unexplained(Shown):
    """Structure of the residuals that no cause of the library explains.

    Attributes:
        p_value: family-wise probability of as much structure over any covariate if there is none.
        threshold: structure is left if ``p_value`` is below this.
        depends_on: the covariates, strongest first.
        discrepancy: covariates more probable than not, strongest first.
        acts_on: what each covariate acts on, in words.
        gain: by how much the discrepancy lowers the RMS of held-out records below that of the
            causes alone, or None.
        excluded: what the excluded records share, or None.
        shared_by_postures: the error that records of one posture share, or None.
        run_order: the error that consecutive records share, or None.
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
    readings: tuple[ScatteredReadings, ...] = ()
    shared_by_postures: SharedError | None = None
    run_order: RunOrder | None = None

    @cached_property
    def shapes(self) -> dict[str, pd.DataFrame]:
        """For each covariate one row a record: the covariate; the smooth correction, in x, y, z of
        the tip [mm], or as angle of a joint [µrad] or growth of all lengths [µm/m]; and these by
        each record alone (``_of_record``).
        """
        return dict(report().residual_tables.shapes_of(self.choice))

    @property
    def left(self) -> bool:
        """Whether structure is left beyond chance."""
        return self.p_value < self.threshold

    @property
    def structure(self) -> bool:
        """Whether structure is more probable than not."""
        return bool(self.depends_on or self.discrepancy or self.apart)

    @property
    def strongest(self) -> tuple[str, ...]:
        """The quantities that a sentence names."""
        names = ("place" if name in ("x", "y", "z") else name for name in self.depends_on)
        return tuple(dict.fromkeys(names))[:NAMED_QUANTITIES]

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on these quantities, and on groups and records that disagree."""
        odd = {group.name: group for group in self.groups}
        covariates = [name for name in self.strongest if name not in odd]
        depends = [Note("depends_on", {"covariates": covariates})] if covariates else []
        groups = [
            Note("group_differs", {"group": group.name, "times": group.times})
            for group in self.groups
        ]
        return (*depends, *groups, *(one.note for one in self.apart))

    @property
    def apart(self) -> tuple[ScatteredReadings | SharedError | RunOrder, ...]:
        """Structure over no covariate: of readings, of postures, of consecutive records."""
        structures = (*self.readings, self.shared_by_postures, self.run_order)
        return tuple(one for one in structures if one is not None)


def unexplained_by(choice: Choice, held_out_gain: Gain | None, has_findings: bool) -> Unexplained:
    """The discrepancy, and whether structure is left beside the causes."""
    covariates = [choice.covariate(k) for k in choice.covariates]
    groups_odd = tuple(odd_groups(choice))
    shared_by_excluded = shared_by(choice.fit)
    depends_on = [group.name for group in groups_odd[:1]]
    for covariate in covariates:
        depends_on += covariate.depends_on
    posterior = choice.posterior
    p_values = [
        family_wise_p_value(choice.candidates, posterior.without(k), k) for k in choice.covariates
    ]
    if not p_values:
        p_value_of_any = p_value_of_structure(choice.candidates, posterior.median_model)
        p_values = [p_value_of_any, *(group.p_value for group in groups_odd)]
    if shared_by_excluded is not None:
        p_values.append(shared_by_excluded.p_value)
        if not (shared_by_excluded.name == "place" and "x" in depends_on):
            depends_on.append(shared_by_excluded.name)
    # What a covariate leaves of a joint is no scatter.
    readings = tuple(
        joint for joint in scattered_readings(choice) if f"joint {joint.joint}" not in depends_on
    )
    shared_by_postures = None
    noise = choice.noise
    if noise.p_value < THRESHOLDS.left and noise.ratio >= THRESHOLDS.large:
        scatter = float(np.sqrt(posterior.median_model.variance))
        size = scatter * noise.shared_size(choice.design.fit)
        shared_by_postures = SharedError(size, noise.ratio, noise.p_value)
    discrepancy_sizes = _discrepancy_sizes(choice)
    gain = held_out_gain.discrepancy_gain if held_out_gain and discrepancy_sizes else None
    return Unexplained(
        p_value=min(p_values),
        threshold=THRESHOLDS.left if has_findings else THRESHOLDS.left_alone,
        depends_on=tuple(dict.fromkeys(depends_on)),
        discrepancy=discrepancy_sizes,
        choice=choice,
        acts_on={choice.covariate(k).name: choice.way(k).acts_on for k in choice.covariates},
        gain=gain,
        groups=groups_odd,
        excluded=shared_by_excluded,
        readings=readings,
        shared_by_postures=shared_by_postures,
        run_order=None if {"time", "session"} & {*depends_on} else run_order_of(choice),
    )


def scattered_readings(choice: Choice) -> tuple[ScatteredReadings, ...]:
    """The joints whose readings scatter more than stated, the largest first."""
    fit = choice.design.fit
    if noise_is_known(fit):
        return ()
    chain, left = fit.problem.model.arm.chain, choice.scatter_left
    chances = chi2_sf(2.0 * left.log_ratios, 1)
    p_values = np.minimum(0.5 * left.readings.size * chances, 1.0)
    is_large = left.larger & (left.at_tips > THRESHOLDS.large * fit.noise_rms)
    scattered = [
        ScatteredReadings(
            joint=int(chain.moving_rows()[k]),
            scatter=float(left.readings[k]),
            slides=bool(chain.prismatic[k]),
            stated=fit.problem.setup.encoder_noise is not None,
            at_tips=float(left.at_tips[k]),
            log_ratio=float(left.log_ratios[k]),
            p_value=float(p_values[k]),
        )
        for k in np.flatnonzero(is_large)
    ]
    return tuple(sorted(scattered, key=lambda readings: -readings.at_tips))


def exceeds_noise(extended: Fit) -> bool:
    """Whether χ² exceeds what the stated noise explains, displacements or rotations by far. Noise
    of encoders that is not stated counts as that of plain encoders.
    """
    if extended.chi2_stated is None or extended.noise.scatters.of_targets == 0.0:
        return False
    squared_deviations = np.square(extended.system.deviations)
    explained_variances = np.diagonal(extended.stated_noise, axis1=1, axis2=2)
    if extended.problem.setup.encoder_noise is None:
        squared_levers = np.square(extended.by_reading).sum(axis=2)
        explained_variances = explained_variances + THRESHOLDS.plain_encoder**2 * squared_levers
    largest_ratio = THRESHOLDS.much_more**2
    oriented = extended.used & extended.observations.oriented
    chi2, dof = extended.chi2_stated
    return chi2 > dof and any(
        squared_deviations[records, coordinates].sum()
        > largest_ratio * explained_variances[records, coordinates].sum()
        for coordinates, records in ((slice(3), extended.used), (slice(3, 6), oriented))
    )


def _discrepancy_sizes(choice: Choice) -> tuple[DiscrepancySize, ...]:
    """The covariates: of each the root mean square displacement of the used records' tips that
    recalibration leaves, and its standard uncertainty.
    """
    design, model = choice.design, choice.posterior.median_model
    sizes = []
    for block in choice.covariates:
        entries = model.entries[block]
        moved = choice.displacement(design.weights(block))
        products = np.tensordot(moved, moved, ((0, 1), (0, 1)))
        estimate, covariance = model.estimate[entries], model.covariance[entries, entries]
        sums = np.array([estimate @ products @ estimate, np.sum(products * covariance)])
        rms, u = np.sqrt(np.maximum(sums, 0.0) / len(moved)).tolist()
        probability = choice.posterior.probability(block)
        sizes.append(DiscrepancySize(choice.covariate(block).name, rms, u, probability))
    return tuple(sizes)


def run_order_of(choice: Choice) -> RunOrder | None:
    """The joint, or the tip, with the largest autocorrelation in the order of time, else of the
    rows; None if it is not significant.

    Whitened residuals beyond all that was found count along the displacement by each joint, or as
    they are for the tip. For independent residuals of n records, the lag-1 autocorrelation has a
    standard deviation of ``1/√n`` (Bartlett 1946, J. R. Stat. Soc. B 8).
    """
    fit = choice.design.fit
    residuals = choice.noise.whitened(choice.deviations)[:, :3]
    counts = choice.fit.used & np.isfinite(residuals).all(axis=1)
    order = fit.problem.measurements.order_in_time
    order = order[counts[order]]
    residuals = residuals[order]
    joint_rows = [int(row) for row in fit.problem.model.arm.chain.moving_rows()]
    by_joints = displacements(fit, [*map(JointZeroOffset, joint_rows)])[order, :3]
    by_joints = choice.noise.whitening[order, :3, :3] @ by_joints
    levers = np.linalg.norm(by_joints, axis=1)
    is_displaced = levers > LEAST_PART_OF_LEVER * levers.max(axis=0, initial=0.0)
    along = np.einsum("nij,ni->nj", by_joints, residuals) / np.where(is_displaced, levers, 1.0)
    residuals_by_joint: dict[int | None, Array] = {None: residuals}
    for number, joint_row in enumerate(joint_rows):
        residuals_by_joint[joint_row] = along[is_displaced[:, number], number, None]
    significant = []
    for joint, of_joint in residuals_by_joint.items():
        if len(of_joint) < FEWEST_IN_ORDER:
            continue
        centred = of_joint - of_joint.mean(axis=0)
        correlation = float((centred[1:] * centred[:-1]).sum() / np.square(centred).sum())
        p_value = float(chi2_sf(centred.size * correlation**2, 1)) * len(residuals_by_joint)
        if correlation > 0.0 and p_value < THRESHOLDS.left:
            limit = float(ndtri(0.975) / np.sqrt(centred.size))
            significant.append(RunOrder(joint, correlation, limit, p_value, len(of_joint)))
    return min(significant, key=lambda run_order: run_order.p_value, default=None)


def odd_groups(choice: Choice) -> list[OddGroup]:
    """The groups that stand out when all is refitted without them, worst first.

    Chow's test (Econometrica 28, 1960): ``F = ((χ² - χ²₋) / n) / (χ²₋ / ν₋)`` with χ²₋ of the other
    records, ν₋ their degrees of freedom and n what the group adds; Bonferroni's bound over the
    groups of a kind. The noise is the scatter of the residuals, as errors of readings move far tips
    more, and in few directions; records of one posture that share an error count once.
    """
    groups = label_groups(choice.fit.problem.measurements)
    if not groups:
        return []
    fit = choice.fit
    tip_covariance = choice.scatter_left.covariances - fit.observations.covariance
    fit_with_scatter = replace(fit, noise=replace(fit.noise, tip_covariance=tip_covariance))
    records_by_group = choice.noise.count
    independent_part = records_by_group.size / records_by_group.sum() if choice.noise.ratio else 1.0
    chi2_of_all = fit_with_scatter.chi2_of(fit.used)
    standing_out = []
    for group in groups:
        chi2_of_others = fit_with_scatter.chi2_of(fit.used & ~group.records)
        dof_of_group = chi2_of_all.dof - chi2_of_others.dof
        if min(dof_of_group, chi2_of_others.dof) < 1.0 or chi2_of_others.value <= 0.0:
            continue
        variance = max((chi2_of_all.value - chi2_of_others.value) / dof_of_group, 0.0)
        variance_ratio = variance / (chi2_of_others.value / chi2_of_others.dof)
        dofs = independent_part * dof_of_group, independent_part * chi2_of_others.dof
        count_of_kind = sum(other.kind == group.kind for other in groups)
        p_value = min(1.0, count_of_kind * float(f_sf(variance_ratio, *dofs)))
        if p_value < THRESHOLDS.odd:
            record_count = int((fit.used & group.records).sum())
            times = float(np.sqrt(variance_ratio))
            standing_out.append(OddGroup(group.name, record_count, times, p_value))
    return sorted(standing_out, key=lambda group: group.p_value)


class LabelGroup(NamedTuple):
    """Records (n,) of one label of a kind (bar, seat, session or marker), such as ``bar left``."""

    kind: str
    name: str
    records: Mask


def label_groups(measurements: Measurements) -> list[LabelGroup]:
    """Groups of records that may disagree with the others: bars, or else seats, of unknown place;
    sessions; markers. There are enough of a kind, each with enough records.
    """
    conditions = measurements.conditions
    labels_by_kind = {"session": conditions.session, "marker": conditions.marker}
    if not measurements.known.any():
        labels_by_kind["bar"] = measurements.bar
        labels_by_kind["seat"] = conditions.seat if measurements.bar is None else None
    groups = []
    for kind, label_of_record in labels_by_kind.items():
        if label_of_record is None:
            continue
        groups_of_kind = [
            LabelGroup(kind, f"{kind} {label}", label_of_record == label)
            for label in dict.fromkeys(label_of_record)
            if label and np.sum(label_of_record == label) > THRESHOLDS.fewest_records
        ]
        if len(groups_of_kind) >= THRESHOLDS.fewest_groups:
            groups += groups_of_kind
    return groups
