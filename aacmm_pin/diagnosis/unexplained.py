"""What no cause of the library explains, and what it depends on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Shown, report, two_digits
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.shared_exclusions import Shared, shared_by
from aacmm_pin.diagnosis.choice import Choice, noise_is_known
from aacmm_pin.diagnosis.held_out_gain import Gain
from aacmm_pin.diagnosis.odd_groups import OddGroup, odd_groups
from aacmm_pin.diagnosis.run_order import RunOrder, run_order_of
from aacmm_pin.diagnosis.significance import family_wise_p_value, p_value_of_structure
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

NAMED_QUANTITIES = 2
"""So many quantities that the residuals depend on are named in a sentence, strongest first."""


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
        shared_by_postures=_shared_error(choice),
        run_order=None if {"time", "session"} & {*depends_on} else run_order_of(choice),
    )


def _shared_error(choice: Choice) -> SharedError | None:
    """The shared error, if it is significant and large."""
    noise = choice.noise
    fit = choice.design.fit
    if noise.p_value >= THRESHOLDS.left or noise.ratio < THRESHOLDS.large:
        return None
    size = np.sqrt(choice.posterior.median_model.variance) * noise.shared_size(fit)
    return SharedError(float(size), noise.ratio, noise.p_value)


def scattered_readings(choice: Choice) -> tuple[ScatteredReadings, ...]:
    """The joints whose readings scatter more than stated, the largest first."""
    fit = choice.design.fit
    if noise_is_known(fit):
        return ()
    stated = fit.problem.setup.encoder_noise is not None
    scatter_left = choice.scatter_left
    chain = fit.problem.model.arm.chain
    noise_rms = fit.noise_rms
    scattered = []
    for number, joint_row in enumerate(chain.moving_rows()):
        at_tips = float(scatter_left.at_tips[number])
        log_ratio = float(scatter_left.log_ratios[number])
        if scatter_left.larger[number] and at_tips > THRESHOLDS.large * noise_rms:
            chance_of_joint = float(chi2_sf(2.0 * log_ratio, 1))
            p_value = min(1.0, 0.5 * scatter_left.readings.size * chance_of_joint)
            scatter_of_joint = float(scatter_left.readings[number])
            slides = bool(chain.prismatic[number])
            scattered.append(
                ScatteredReadings(
                    int(joint_row), scatter_of_joint, slides, stated, at_tips, log_ratio, p_value
                )
            )
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
        displacements = choice.displacement(design.weights(block))
        sum_of_squares = np.square(displacements @ model.estimate[entries]).sum()
        covariance = model.covariance[entries, entries]
        sum_of_variances = np.einsum(
            "nij,jk,nik->", displacements, covariance, displacements, optimize=True
        )
        mean_squares = np.maximum([sum_of_squares, sum_of_variances], 0.0) / len(displacements)
        rms, u = np.sqrt(mean_squares).tolist()
        probability = choice.posterior.probability(block)
        sizes.append(DiscrepancySize(choice.covariate(block).name, rms, u, probability))
    return tuple(sizes)
