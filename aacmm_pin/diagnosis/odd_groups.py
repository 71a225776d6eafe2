"""Groups of records that disagree with the others: a bar, seat, session or marker set up badly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Mask
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import f_sf
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import Measurements


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
        count_of_kind = sum(other.kind == group.kind for other in groups)
        dofs = independent_part * dof_of_group, independent_part * chi2_of_others.dof
        p_value_of_group = float(f_sf(variance_ratio, *dofs))
        p_value = min(1.0, count_of_kind * p_value_of_group)
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
        distinct_labels = [label for label in dict.fromkeys(label_of_record) if label]
        groups_of_kind = [
            LabelGroup(kind, f"{kind} {label}", label_of_record == label)
            for label in distinct_labels
        ]
        large_groups = [
            group for group in groups_of_kind if group.records.sum() > THRESHOLDS.fewest_records
        ]
        if len(large_groups) >= THRESHOLDS.fewest_groups:
            groups += large_groups
    return groups
