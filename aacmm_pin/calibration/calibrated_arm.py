"""From estimated effects to an arm: geometry goes into its table, the rest stays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, ArmFile, Covariance
from aacmm_pin.calibration.fit import NO_SCATTER, Fit
from aacmm_pin.calibration.identifiability import NEGLIGIBLE_PART
from aacmm_pin.effects import Effect, ErrorModel, ReferenceFrame, StylusOffset, entries_of
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import fingerprints, fingerprints_of_standards

UNDETERMINED_PART = 0.999
"""A parameter that is this much of an undetermined combination has no u."""


@dataclass(frozen=True, eq=False)
class HeldEffects:
    """Effects with many parameters, such as error curves, that a fit held.

    Attributes:
        effects: at their posterior means, with u.
        covariance: of all their parameters (q, q) [units].
        response: of the fit's estimates (p, q) [units].
    """

    effects: tuple[Effect, ...]
    covariance: Array
    response: Array

    @property
    def added_covariance(self) -> Array:
        """Of the fit's estimates (p, p) [units]."""
        return self.response @ self.covariance @ self.response.T

    def of_effect(self, effect: Effect) -> Array:
        """Covariance of one (q, q) [units]."""
        stops = np.cumsum([len(held.terms) for held in self.effects])
        number = [held.label for held in self.effects].index(effect.label)
        entries = slice(stops[number] - len(effect.terms), stops[number])
        return self.covariance[entries, entries]


def calibrated_model(fit: Fit, held: HeldEffects | None = None) -> ErrorModel:
    """The arm and effects with the estimated values, without the set-up's.

    The u of an effect includes the prior width as far as the records leave it open; the covariance
    only where it moves the tip. Effects that the fit ``held`` join the covariance: with the
    response ``R`` of the estimates and their covariance ``Σ``, the cross-covariance is ``R Σ``.
    """
    problem = fit.problem
    vector = problem.vector
    arm = problem.model.arm
    u = np.sqrt(np.diag(fit.covariance))
    x = fit.point.x
    values = zip(vector.arm_parameters, x.tolist(), strict=True)
    steps = {p.name: step for p, step in values if p is not None}
    tip_spread = fit.undetermined.tip_spread
    open_u = np.linalg.norm(fit.undetermined.spread, axis=1)
    # A parameter that nothing determines has no u that means anything, unless it moves the tip.
    has_u = (open_u < UNDETERMINED_PART * problem.widths) | (
        np.linalg.norm(tip_spread, axis=1) > NEGLIGIBLE_PART * open_u
    )
    u_with_open = np.hypot(u[: vector.size], open_u)
    effects = []
    for effect, entries in vector:
        if is_of_setup(effect):
            has_u[entries] = False
        elif vector.arm_parameters[entries.start] is None:
            nonlinear_u = fit.nonlinear_u.get(effect.key, 0.0)
            at_estimate = effect.at(x[entries], u_with_open[entries])
            effects.append(replace(at_estimate, nonlinear_u=nonlinear_u))
    names = [name if keep else "" for name, keep in zip(vector.names, has_u, strict=True)]
    names += [f"{effect.key}.{effect.nonlinear.field}" for effect in fit.nonlinear_widths]
    # The columns of the frame stay out.
    nonlinear = range(problem.scales.size, len(fit.full_covariance))
    columns = [*range(vector.size), *nonlinear]
    matrix = fit.full_covariance[np.ix_(columns, columns)]
    matrix[: vector.size, : vector.size] += tip_spread @ tip_spread.T
    others = problem.model.effects
    if held is not None:
        cross = np.zeros((len(matrix), len(held.covariance)))
        cross[: vector.size] = held.response[: vector.size] @ held.covariance
        matrix = np.block([[matrix, cross], [cross.T, held.covariance]])
        for effect in held.effects:
            names += [parameter.name for parameter in effect.parameters()]
        held_effects = {effect.key: effect for effect in held.effects}
        others = tuple(held_effects.get(effect.key, effect) for effect in others)
    used = problem.measurements.take(fit.used)
    records = (*problem.earlier_records, *fingerprints(used), *fingerprints_of_standards(used))
    covariance = joined_covariance(arm, names, matrix, " ".join(dict.fromkeys(records)))
    all_effects = (*others, *effects)
    code = "scatter_beyond_noise" if fit.noise_is_stated else "scatter_of_unstated_noise"
    has_scatter = fit.noise.scatters.of_targets > NO_SCATTER
    unexplained = str(Note(code, {"scatter": fit.scatter_in_words})) if has_scatter else ""
    of_file = {
        "reference_temperature_c": temperature_of(fit),
        "unexplained": unexplained,
        "tip_on_target": problem.tip_on_target or arm.tip_on_target,
        **entries_of(all_effects),
    }
    calibrated = moved_arm(arm, steps, covariance, of_file)
    if problem.setup.encoder_noise is not None:
        calibrated = calibrated.with_encoder_noise(problem.setup.encoder_noise)
    return ErrorModel(calibrated, all_effects)


def is_of_setup(effect: Effect) -> bool:
    """Whether an effect is a marker's place or a session's frame."""
    if isinstance(effect, StylusOffset):
        return effect.marker is not None
    return isinstance(effect, ReferenceFrame) and effect.session is not None


def temperature_of(fit: Fit) -> float:
    """Of the calibrated lengths [°C]: the mean of the records if no effect depends on it."""
    problem = fit.problem
    conditions = problem.measurements.conditions.take(fit.used)
    recorded = conditions.temperature
    if recorded is None:
        recorded = conditions.link_temperature
    grows = any("temperature" in effect.needs for effect in (*problem.model.effects, *fit.effects))
    has_length = any(p is not None and p.unit == "m" for p in problem.vector.arm_parameters)
    if recorded is None or grows or not has_length:
        return problem.model.arm.reference_temperature
    return round(float(recorded.mean()), 2)


def joined_covariance(
    arm: Arm, names: list[str], matrix: Array, fingerprints: str
) -> Covariance | None:
    """The covariance of new estimates, joined with the arm's of other parameters; both are
    uncorrelated. None if no parameter is left.

    Args:
        names: of the new parameters (p,); "" leaves one out, and so does a variance of zero.
        matrix: their covariance (p, p) [their units].
        fingerprints: of the records.
    """
    keep = [i for i, name in enumerate(names) if name and matrix[i, i] > 0]
    chosen = [names[i] for i in keep]
    matrix = matrix[np.ix_(keep, keep)]
    u = np.sqrt(np.diag(matrix))
    correlation = np.clip(matrix / np.outer(u, u), -1.0, 1.0)
    before = arm.covariance
    others = None if before is None else before.restricted({*before.parameters}.difference(names))
    if others is not None:
        chosen += others.parameters
        u = np.append(u, others.standard_uncertainty_si)
        correlation = block_diag(correlation, others.matrix_of_correlation())
    return Covariance.of(chosen, u, correlation, fingerprints) if chosen else None


def moved_arm(
    arm: Arm,
    steps: Mapping[str, float],
    covariance: Covariance | None,
    of_file: Mapping[str, Any] | None = None,
) -> Arm:
    """The arm with ``steps`` added to its parameters by name [m, rad; of a URDF in the axes of the
    placement], and other values ``of_file``.
    """
    update = of_file or {}
    if arm.dh is None:
        twists = np.array([steps.get(p.name, 0.0) for p in arm.parameters]).reshape(-1, 6)
        moved = arm.with_placements(twists, covariance)
        of_urdf = moved.urdf_file.model_copy(update=update)
        temperature = of_urdf.reference_temperature_c
        return replace(moved, reference_temperature=temperature, file=of_urdf)
    file = moved_file(arm, steps).model_copy(update={**update, "covariance": covariance})
    return Arm.from_file(file)


def moved_file(arm: Arm, steps: Mapping[str, float]) -> ArmFile:
    """The arm's file with ``steps`` added to its parameters by name [m, rad].

    Raises:
        AacmmError: the arm was not made from a file.
    """
    if not isinstance(arm.file, ArmFile):
        raise AacmmError(
            f"{arm.name}: this arm has no arm file; expected the half-widths of an arm file"
        )
    rows = list(arm.file.joints)
    for parameter in arm.parameters:
        if parameter.name in steps and parameter.joint is not None:
            suffix, unit = ("mm", MM) if parameter.unit == "m" else ("rad", 1.0)
            field = f"{parameter.kind}_{suffix}"
            row = rows[parameter.joint - 1]
            rows[parameter.joint - 1] = row.model_copy(
                update={field: getattr(row, field) + steps[parameter.name] / unit}
            )
    return arm.file.model_copy(update={"joints": rows})
