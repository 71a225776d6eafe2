"""Whether one geometric value of the arm file is wrong, and its value by the records.

After a free fit, each in turn is taken to be wrong, the others to be as stated: a deletion residual
(Belsley, Kuh, Welsch 1980, eq. 2.27) of what is stated of it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.arm import Parameter
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.candidate_mistakes import BY_RECORDS, Mistake
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameters import free_geometry
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.errors import AacmmError

USUAL = {"m": 3e-4, "rad": 2e-3}
"""Error of a value that nobody stated, as manufactured [m, rad]."""
SHOWN_UNITS = {"m": "mm", "rad": "°"}
LEAST_WRONG = {"m": 4e-4, "rad": 4e-3}
"""A smaller error is none of the file [m, rad] …"""
LEAST_OF_STATED = 0.2
"""… if its uncertainty is not stated; if it is, so many times that."""
ZERO_KINDS = ("theta_offset", "rz")
RECORDS_FOR_VALUES = 2000
LEAST_GAIN_OF_VALUE = 30.0
"""Least gain in χ² by one wrong value …"""
LEAST_DOMINANCE = 3.0
"""… and over what the other values, within what is stated of them, leave."""
RIVAL_GAIN = 12.0
"""Difference of gains of values that may both be wrong."""
ONE_EFFECT = 0.9999
"""Cosine of effects that are one, as of distances along parallel axes."""
MOST_ALIKE = 3
"""So many possible values with other effects are no finding."""
FAR_OFF = 4.0
"""A fit that moves values by fewer standard uncertainties gives no reason to search."""
PER_PARAMETER = 6.0
"""Gain in χ² per further value with which all zeros are more probable than one value."""
LEAST_PART_OF_USUAL = 1e-3
"""Least uncertainty by the records, as a part of the usual one, for rounding."""
SAME_SIZE = 0.02
"""Relative difference of values that have the wrong sign."""


def wrong_value(after: Fit) -> Mistake | None:
    """The wrong geometric value of the arm file, or all zeros; None if values are about as stated,
    if none explains the others, or if another is wrong with it corrected.
    """
    mistake = _likely_value(after)
    if mistake is None:
        return None
    try:
        corrected = fit(mistake.undone(_thinned(after.problem)))
    except AacmmError:
        return None
    return None if _likely_value(corrected) else mistake


def _likely_value(after: Fit) -> Mistake | None:
    """All zeros, or the value that explains more than all others together."""
    errors = _errors_of_values(after)
    if errors is None:
        return None
    parameters, zeros = errors.parameters, errors.zeros
    arm = after.problem.model.arm
    precision = np.linalg.inv(errors.covariance + np.diag(errors.usual**2))
    pulls = precision @ errors.values
    cost = float(errors.values @ pulls)
    # Each as a case that is left out: its error, and how much lower χ² is.
    singly = pulls / np.diag(precision)
    gains = pulls * singly
    best = int(np.argmax(gains))
    if zeros.size > 1:
        of_zeros = np.linalg.solve(precision[np.ix_(zeros, zeros)], pulls[zeros])
        gain = float(of_zeros @ pulls[zeros])
        # All zeros are more probable than any one value.
        if gain - gains[best] > LEAST_GAIN_OF_VALUE + PER_PARAMETER * zeros.size:
            largest = float(np.abs(of_zeros).max())
            if gain <= LEAST_DOMINANCE * (cost - gain) or largest <= LEAST_WRONG["rad"]:
                return None
            steps = {parameters[k].name: step for k, step in zip(zeros, of_zeros, strict=True)}
            corrected = moved_arm(arm, steps, arm.covariance)
            data = {"joints": zeros.size, "largest": largest}
            return Mistake("zeros_off", data, arm=corrected, free_numbers=BY_RECORDS)
    parameter, error = parameters[best], float(singly[best])
    information = np.linalg.inv(errors.covariance)
    lengths = np.sqrt(np.diag(information))
    same_effect = np.abs(information[best]) >= ONE_EFFECT * lengths[best] * lengths
    rivals = (gains > gains[best] - RIVAL_GAIN) & ~same_effect
    is_sure = gains[best] > max(LEAST_GAIN_OF_VALUE, LEAST_DOMINANCE * (cost - gains[best]))
    least_change = LEAST_WRONG[parameter.unit] * (LEAST_OF_STATED if parameter.u else 1.0)
    # The file of a URDF states placements, not single values.
    if arm.dh is None or rivals.sum() >= MOST_ALIKE or not is_sure or abs(error) < least_change:
        return None
    same = [parameters[k].name for k in np.flatnonzero(same_effect) if k != best]
    corrected = moved_arm(arm, {parameter.name: error}, arm.covariance)
    code, data = _code_and_data(parameter, error, same)
    return Mistake(code, data, arm=corrected, free_numbers=BY_RECORDS)


class _Errors(NamedTuple):
    """Errors of geometric values by the records alone.

    Attributes:
        zeros: numbers of those that are zeros of joints.
        values: (p,) [units].
        covariance: (p, p) [units].
        usual: standard uncertainties (p,) [units].
    """

    parameters: tuple[Parameter, ...]
    zeros: Index
    values: Array
    covariance: Array
    usual: Array


def _errors_of_values(after: Fit) -> _Errors | None:
    """After a free fit; None if values are about as stated."""
    problem = after.problem
    geometric = np.flatnonzero(problem.vector.geometric)
    if not geometric.size or not after.determines_noise:
        return None
    changes = np.abs(after.point.x - problem.start)[geometric]
    if after.scatter == 0.0 and (changes < FAR_OFF * _usual(problem, geometric)).all():
        return None
    asked = _thinned(problem)
    try:
        free = fit(free_geometry(asked))
    except AacmmError:
        return None
    of_entries = [asked.vector.arm_parameters[k] for k in geometric]
    parameters = tuple(p for p in of_entries if p is not None)
    chain = asked.model.arm.chain
    turning = np.array(chain.moving_rows())[~chain.prismatic]
    zeros = [p.kind in ZERO_KINDS and p.joint in turning for p in parameters]
    if all(zeros) and not asked.stated[geometric].any():
        return None  # a user asked for zeros of which nothing is stated
    steps = free.system.independent_steps[geometric]
    values = (free.point.x - asked.start)[geometric]
    usual = _usual(asked, geometric)
    covariance = steps @ steps.T + np.diag(np.square(LEAST_PART_OF_USUAL * usual))
    return _Errors(parameters, np.flatnonzero(zeros), values, covariance, usual)


def _thinned(problem: Problem) -> Problem:
    records = problem.measurements
    return problem.of(records.take(np.arange(0, records.n, -(-records.n // RECORDS_FOR_VALUES))))


def _usual(problem: Problem, geometric: Index) -> Array:
    parameters = [problem.vector.arm_parameters[k] for k in geometric]
    usual = np.array([USUAL[p.unit] for p in parameters if p is not None])
    return np.where(problem.stated[geometric], problem.widths[geometric], usual)


def _code_and_data(
    parameter: Parameter, error: float, same: list[str]
) -> tuple[str, dict[str, Any]]:
    """Of a wrong value with this ``error`` [its unit]; ``same`` names values with its effect."""
    by_records = parameter.value + error
    if parameter.unit == "rad":
        by_records = float(np.remainder(by_records + np.pi, 2 * np.pi) - np.pi)
    data: dict[str, Any] = {"parameter": parameter.name, "unit": SHOWN_UNITS[parameter.unit]}
    data |= {"stated": parameter.value, "found": by_records, "same": same}
    if abs(by_records + parameter.value) < SAME_SIZE * abs(parameter.value):
        return "wrong_sign", data
    return "wrong_value_or" if same else "wrong_value", data
