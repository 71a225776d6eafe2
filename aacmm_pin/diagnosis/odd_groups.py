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
    scatter = choice.scatter_left.covariances - fit.observations.covariance
    judge = replace(fit, noise=replace(fit.noise, tip_covariance=scatter))
    count = choice.noise.count
    part = count.size / count.sum() if choice.noise.ratio else 1.0
    all_records = judge.chi2_of(fit.used)
    odd = []
    for group in groups:
        without_group = judge.chi2_of(fit.used & ~group.records)
        dof_of_group = all_records.dof - without_group.dof
        if min(dof_of_group, without_group.dof) < 1.0 or without_group.value <= 0.0:
            continue
        variance = max((all_records.value - without_group.value) / dof_of_group, 0.0)
        ratio = variance / (without_group.value / without_group.dof)
        alike = sum(other.kind == group.kind for other in groups)
        chance = float(f_sf(ratio, part * dof_of_group, part * without_group.dof))
        p_value = min(1.0, alike * chance)
        if p_value < THRESHOLDS.odd:
            records = int((fit.used & group.records).sum())
            odd.append(OddGroup(group.name, records, float(np.sqrt(ratio)), p_value))
    return sorted(odd, key=lambda group: group.p_value)


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
    labels = {"session": conditions.session, "marker": conditions.marker}
    if not measurements.known.any():
        labels["bar"] = measurements.bar
        labels["seat"] = conditions.seat if measurements.bar is None else None
    groups = []
    for kind, of_record in labels.items():
        if of_record is None:
            continue
        named = [label for label in dict.fromkeys(of_record) if label]
        labelled = [LabelGroup(kind, f"{kind} {label}", of_record == label) for label in named]
        large = [group for group in labelled if group.records.sum() > THRESHOLDS.fewest_records]
        if len(large) >= THRESHOLDS.fewest_groups:
            groups += large
    return groups
