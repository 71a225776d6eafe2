"""The parameters of a calibration, and how far off each may be."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin.arm import Arm, Covariance
from aacmm_pin.calibration.parameter_vector import (
    ParameterVector,
    geometric_parameters,
)
from aacmm_pin.calibration.problem import FRAME_WIDTHS, Problem
from aacmm_pin.calibration.setup import Setup, Target, sessions_of
from aacmm_pin.effects import (
    Effect,
    ErrorModel,
    JointPlacement,
    LinkTilt,
    ReferenceFrame,
    StylusOffset,
    joint_zeros,
    of_parameter,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements

ParameterSet = Literal["zero-offsets", "geometry", "tool"]

ASSEMBLED = {"m": 0.01, "rad": 0.1}
"""Width of a geometric value that nobody stated, as assembled: 10 mm and 6° [m, rad]."""
HELD_WIDTH = 1e-9
"""Width of a length that stands for all others [m]."""
REACH_OF_TARGET = 1.0
"""How far beyond the tip an unknown target may be [m]."""
BEYOND_TYPICAL = 1000.0
"""Width of a cause that nobody stated, in typical magnitudes."""


PARALLEL_SINE = 0.1
"""Below it, axes are nearly parallel: DH has no value for one tilt."""


class _Unknown(NamedTuple):
    effect: Effect
    widths: Array
    stated: Mask


def problem_of(
    model: ErrorModel,
    measurements: Measurements,
    parameters: str | Iterable[str | Effect],
    setup: Setup,
) -> Problem:
    """The unknowns that ``parameters`` names, and those of the set-up (target, frame).

    Raises:
        AacmmError: a parameter occurs twice.
    """
    items: list[str | Effect] = [parameters] if isinstance(parameters, str) else [*parameters]
    named_causes = {item.label for item in items if isinstance(item, Effect)}
    labels_of_targets = {offset.label for offset in _target_offsets(measurements, setup.target)}
    for effect in model.effects:  # offsets of targets that the arm states with a u that counts
        is_target = effect.label in labels_of_targets - named_causes
        if is_target and not is_reestimated(effect, setup, measurements):
            items.append(effect)
    unknowns = _unknowns(model.arm, measurements, items, setup)
    effects = tuple(unknown.effect for unknown in unknowns)
    keys = [effect.key for effect in effects]
    for key in keys:
        if keys.count(key) > 1:
            raise AacmmError(f"{key} occurs twice; expected each parameter once")
    labels = [effect.label for effect in effects]
    base = model.restricted(tuple(e for e in model.effects if e.label not in labels))
    vector = ParameterVector(base.arm, effects)
    widths = np.concatenate([np.empty(0), *(unknown.widths for unknown in unknowns)])
    stated = np.concatenate([np.empty(0, dtype=bool), *(unknown.stated for unknown in unknowns)])
    covariance = model.arm.covariance
    earlier_records = ""
    if covariance is not None and (setup.prior or base.arm.covariance):
        earlier_records = covariance.records
    targets = measurements.conditions.labels("marker")[measurements.oriented].tolist()
    return Problem(
        model=base,
        vector=vector,
        widths=widths,
        stated=stated,
        correlation=_correlation(covariance, vector.names, np.where(stated, widths, np.nan)),
        measurements=measurements,
        setup=setup,
        earlier_records=tuple(earlier_records.split()),
        targets=() if setup.target == "frame" else tuple(dict.fromkeys(targets)),
        asked=tuple(items),
    )


def _unknowns(
    arm: Arm, measurements: Measurements, items: list[str | Effect], setup: Setup
) -> list[_Unknown]:
    """Of the target and the frames of sessions, then those that ``items`` name."""
    # A value that is asked for with a u of its own replaces that of a set.
    with_own_u = {item.label for item in items if isinstance(item, Effect) and any(item.u)}
    offsets = _target_offsets(measurements, setup.target)
    unknowns = [_unknown_offset(offset) for offset in offsets if offset.label not in with_own_u]
    if setup.frame_of_session:
        unstated = np.zeros(FRAME_WIDTHS.size, dtype=bool)
        others = sessions_of(measurements)[1:]
        unknowns += [_Unknown(ReferenceFrame(label), FRAME_WIDTHS, unstated) for label in others]
    for item in items:
        if isinstance(item, Effect):
            u = np.array(item.u)
            bounds = [BEYOND_TYPICAL * term.typical for term in item.terms]
            unknowns.append(_Unknown(item, np.where(u > 0, u, bounds), u > 0))
        elif item == "tool":
            if setup.target != "unknown":
                unknowns += map(_unknown_offset, _target_offsets(measurements, "unknown"))
        elif item == "zero-offsets":
            unknowns += [_unknown_geometry(arm, zero, setup.prior) for zero in joint_zeros(arm)]
        elif item == "geometry":
            geometry = _all_geometry(arm, setup)
            unknowns += [one for one in geometry if one.effect.label not in with_own_u]
    names = set().union(*named_parameters(arm, items).values())
    return unknowns + _named_geometry(arm, names, setup)


def named_parameters(arm: Arm, items: Iterable[str | Effect]) -> dict[str, list[str]]:
    """Geometric parameters that each name or pattern, such as ``theta_offset*``, stands for."""
    names = [parameter.name for parameter in arm.parameters]
    matches = {item: fnmatch.filter(names, item) for item in items if isinstance(item, str)}
    return {item: matching for item, matching in matches.items() if matching}


def _named_geometry(arm: Arm, names: Collection[str], setup: Setup) -> list[_Unknown]:
    """What contains these parameters; others of a placement stay."""
    parameters = [parameter for parameter in arm.parameters if parameter.name in names]
    if arm.dh is not None:
        effects = [of_parameter(arm, parameter) for parameter in parameters]
        return [_unknown_geometry(arm, effect, setup.prior) for effect in effects]
    unknowns = []
    for row in sorted({parameter.joint for parameter in parameters if parameter.joint}):
        effect, widths, stated = _unknown_geometry(arm, JointPlacement(row), setup.prior)
        stays = np.array([p.name not in names for p in geometric_parameters(arm, effect)])
        unknowns.append(_Unknown(effect, np.where(stays, HELD_WIDTH, widths), stated | stays))
    return unknowns


def asked_again(problem: Problem, model: ErrorModel, setup: Setup, *others: Effect) -> Problem:
    """The problem with its unknowns and ``others``, of another model or with another set-up."""
    asked = [*problem.asked, *others]
    return problem_of(model, problem.measurements, asked, setup)


def free_geometry(problem: Problem) -> Problem:
    """The problem as if nothing were stated of the geometric parameters."""
    geometric = problem.vector.geometric
    units = [parameter.unit for parameter in problem.vector.parameters]
    assembled = np.array([ASSEMBLED.get(unit, np.nan) for unit in units])
    with_geometric = geometric[:, None] | geometric
    correlation = np.where(with_geometric, np.eye(geometric.size), problem.correlation)
    widths = np.where(geometric, assembled, problem.widths)
    stated = problem.stated & ~geometric
    return replace(problem, widths=widths, stated=stated, correlation=correlation)


def require_scale(problem: Problem) -> None:
    """Refuse records that leave the size of an arm without stated lengths open.

    Raises:
        AacmmError: they have neither coordinates nor known lengths.
    """
    records = problem.measurements
    if records.known.any() or records.lengths() or not records.seats():
        return
    parameters = zip(problem.vector.arm_parameters, problem.stated, strict=True)
    lengths = [p.name for p, stated in parameters if p and p.unit == "m" and not stated]
    if lengths:
        raise AacmmError(
            f"{records.source}: seats without coordinates and bars do not determine the scale of "
            f"the arm ({', '.join(lengths[:4])} …). Add coordinates, a bar of known length or a "
            "known distance of planes, state the uncertainties of the arm, or estimate only "
            "zero-offsets"
        )


def _correlation(covariance: Covariance | None, names: list[str], stated: Array) -> Array:
    """Of the prior (p, p), by the file; none for parameters with another ``stated`` u (p,)."""
    correlation = np.eye(stated.size)
    if covariance is None:
        return correlation
    u = covariance.u
    u_of_file = [u.get(name, np.nan) for name in names]
    unchanged = np.flatnonzero(np.isclose(stated, u_of_file, rtol=1e-9, atol=0.0))
    in_file = [covariance.parameters.index(names[k]) for k in unchanged]
    of_file = covariance.matrix_of_correlation()[np.ix_(in_file, in_file)]
    correlation[np.ix_(unchanged, unchanged)] = of_file
    return correlation


def _all_geometry(arm: Arm, setup: Setup) -> list[_Unknown]:
    if arm.dh is None:
        effects: list[Effect] = [JointPlacement(row) for row in range(1, arm.chain.rows + 1)]
    else:
        parameters = [p for p in arm.parameters if not (setup.prior and p.half_width == 0.0)]
        effects = [of_parameter(arm, parameter) for parameter in parameters]
        for row in range(1, arm.dh.rows):
            twist = arm.dh.alpha[row - 1 if arm.dh.standard else row]
            if arm.dh.moving[row - 1 : row + 1].all() and abs(np.sin(twist)) < PARALLEL_SINE:
                effects.append(LinkTilt(row if arm.dh.standard else row + 1))
    return [_unknown_geometry(arm, effect, setup.prior) for effect in effects]


def _unknown_geometry(arm: Arm, effect: Effect, prior: bool) -> _Unknown:
    of_arm = geometric_parameters(arm, effect)
    u = np.array([p.u for p in of_arm]) if of_arm else np.zeros(len(effect.terms))
    stated = (u > 0) & prior
    assembled = np.array([ASSEMBLED[t.unit] for t in effect.terms])
    return _Unknown(effect, np.where(stated, u, assembled), stated)


def is_reestimated(effect: Effect, setup: Setup, measurements: Measurements) -> bool:
    """Whether it is the offset of a target of the records, without a u that counts."""
    labels = [offset.label for offset in _target_offsets(measurements, setup.target)]
    has_u = setup.prior and effect.place and any(effect.u)
    return effect.label in labels and not has_u


def _target_offsets(measurements: Measurements, target: Target) -> list[StylusOffset]:
    """One for each marker, or one if the target is not the tip."""
    markers = dict.fromkeys(filter(None, measurements.conditions.labels("marker").tolist()))
    if not markers and target == "unknown":
        return [StylusOffset()]
    return [StylusOffset(marker) for marker in markers]


def _unknown_offset(offset: StylusOffset) -> _Unknown:
    return _Unknown(offset, np.full(3, REACH_OF_TARGET), np.zeros(3, dtype=bool))
