"""Whether one geometric value of the arm file is wrong, and its value by the records.

After a free fit, each in turn is taken to be wrong, the others to be as stated: formulas of one
matrix in a linear model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.notes import Note
from aacmm_pin.arm import Parameter
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.least_squares import remaining_triangle
from aacmm_pin.calibration.parameters import asked_again, free_geometry
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.effects import StylusOffset
from aacmm_pin.errors import AacmmError

USUAL = {"m": 3e-4, "rad": 2e-3}
"""Error of a value that nobody stated, as manufactured [m, rad]."""
TIP_OFFSET = StylusOffset(u=(USUAL["m"],) * 3)
"""The usual error of the tip of a URDF."""
SHOWN_UNITS = {"m": "mm", "rad": "°"}
PLACEMENT_KINDS = {
    **{kind: f"along {kind}" for kind in "xyz"},
    **{f"r{kind}": f"about {kind}" for kind in "xyz"},
}
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
LEAST_NOISE = 1e-6
"""Least noise of the records, for rounding [m]."""
SAME_SIZE = 0.02
"""Relative difference of values that have the wrong sign."""


class WrongValue(NamedTuple):
    """What the records give instead of a value of the arm file.

    Attributes:
        errors: to be added to values of the file, by parameter [m, rad].
    """

    note: Note
    errors: Mapping[str, float]


def wrong_value(after: Fit) -> WrongValue | None:
    """The wrong geometric value of the arm file, or all zeros; None if values are about as stated,
    if none explains the others, or if another is wrong with it corrected.
    """
    values = _geometry_by_records(after)
    if values is None:
        return None
    problem = _thinned(after.problem)
    described = problem.model.arm
    for wrong in _wrong_values(values):
        arm = moved_arm(described, wrong.errors, described.covariance)
        try:
            corrected = fit(asked_again(problem, replace(problem.model, arm=arm), problem.setup))
        except AacmmError:
            continue
        remaining = _geometry_by_records(corrected)
        if remaining is None or not any(_wrong_values(remaining)):
            return wrong
    return None


def _geometry_by_records(after: Fit) -> _Geometry | None:
    """After a free fit; None if values are about as stated. The tip of a URDF is uncertain too."""
    problem = after.problem
    geometric = np.flatnonzero(problem.vector.geometric)
    if not geometric.size or not after.determines_noise:
        return None
    changes = np.abs(after.point.x - problem.start)[geometric]
    usual = _usual(problem, geometric)
    if after.scatter == 0.0 and (changes < FAR_OFF * usual).all():
        return None
    asked = _thinned(problem)
    has_offset = any(isinstance(effect, StylusOffset) for effect in problem.vector.effects)
    if problem.model.arm.dh is None and not has_offset:
        asked = asked_again(asked, problem.model, problem.setup, TIP_OFFSET)
    geometric = np.flatnonzero(asked.vector.geometric)
    try:
        free = fit(free_geometry(asked))
    except AacmmError:
        return None
    values = _Geometry.of(free, geometric, _usual(asked, geometric))
    if values.zeros.size == geometric.size and not asked.stated[geometric].any():
        return None  # a user asked for zeros of which nothing is stated
    return values


def _thinned(problem: Problem) -> Problem:
    records = problem.measurements
    return problem.of(records.take(np.arange(0, records.n, -(-records.n // RECORDS_FOR_VALUES))))


def _usual(problem: Problem, geometric: Index) -> Array:
    parameters = [problem.vector.arm_parameters[k] for k in geometric]
    usual = np.array([USUAL[p.unit] for p in parameters if p is not None])
    return np.where(problem.stated[geometric], problem.widths[geometric], usual)


class _Geometry(NamedTuple):
    """Geometric values by the records alone: ``|R x - y|²`` of their errors x.

    Attributes:
        zeros: numbers of those that are zeros of joints.
        rows: R (k, p) [1/unit].
        measured: y (k,).
        usual: standard uncertainties (p,).
    """

    parameters: tuple[Parameter, ...]
    zeros: Index
    rows: Array
    measured: Array
    usual: Array

    @staticmethod
    def of(free: Fit, geometric: Index, usual: Array) -> _Geometry:
        problem = free.problem
        system = free.system
        prior = system.prior.rows
        prior_of_others = prior[(prior[:, geometric] == 0.0).all(axis=1)]
        all_rows = np.concatenate([prior_of_others, system.measured_triangle])
        others = np.setdiff1d(np.arange(system.prior.scales.size), geometric)
        triangle = remaining_triangle(all_rows[:, [*others, *geometric, -1]], others.size)
        rows = triangle[:, :-1] / system.prior.scales[geometric]
        # No more information than of records with the least noise.
        root_of_count = LEAST_NOISE * np.abs(rows).max()
        scale = min(1.0, np.sqrt(problem.measurements.n) / root_of_count)
        rows = scale * rows
        measured = rows @ (free.point.x - problem.start)[geometric] - scale * triangle[:, -1]
        of_entries = [problem.vector.arm_parameters[k] for k in geometric]
        parameters = tuple(p for p in of_entries if p is not None)
        chain = problem.model.arm.chain
        turning = np.array(chain.moving_rows())[~chain.prismatic]
        zeros = [p.kind in ZERO_KINDS and p.joint in turning for p in parameters]
        return _Geometry(parameters, np.flatnonzero(zeros), rows, measured, usual)

    def with_free(self, wrong: Index) -> tuple[float, Array]:
        """Decrease of χ² by errors of usual size, of any size for ``wrong`` (k,); and the errors
        (p,).
        """
        widths = self.usual.copy()
        widths[wrong] = 1e3 * np.array([USUAL[self.parameters[k].unit] for k in wrong])
        rows = np.concatenate([self.rows, np.diag(1 / widths)])
        measured = np.append(self.measured, np.zeros(widths.size))
        errors = np.linalg.lstsq(rows, measured)[0]
        explained = rows @ errors
        return float(explained @ explained), np.asarray(errors, np.float64)

    def cosines(self, number: int) -> Array:
        """Of the effects of all values with that of one (p,); 0 without effect."""
        lengths = np.linalg.norm(self.rows, axis=0)
        products = np.abs(self.rows.T @ self.rows[:, number])
        cosines = np.zeros_like(products)
        np.divide(products, lengths * lengths[number], out=cosines, where=lengths > 0.0)
        return cosines


def _wrong_values(values: _Geometry) -> Iterator[WrongValue]:
    """All zeros, or values that each explain more than all others together, best first."""
    numbers = np.arange(len(values.parameters))
    gain_of_none, _ = values.with_free(numbers[:0])
    gain_of_all, _ = values.with_free(numbers)
    gains_and_errors = [values.with_free(np.array([k])) for k in numbers]
    gains = np.array([gain for gain, _ in gains_and_errors])
    best = int(np.argmax(gains))
    if values.zeros.size > 1:
        gain, errors = values.with_free(values.zeros)
        # All zeros are more probable than any one value.
        if gain - gains[best] > LEAST_GAIN_OF_VALUE + PER_PARAMETER * values.zeros.size:
            largest = float(np.abs(errors[values.zeros]).max())
            dominate = gain - gain_of_none > LEAST_DOMINANCE * (gain_of_all - gain)
            if dominate and largest > LEAST_WRONG["rad"]:
                note = Note("zeros_off", {"joints": values.zeros.size, "largest": largest})
                of_zeros = {values.parameters[k].name: float(errors[k]) for k in values.zeros}
                yield WrongValue(note, of_zeros)
            return
    has_other_effect = values.cosines(best) < ONE_EFFECT
    rivals = (gains > gains[best] - RIVAL_GAIN) & has_other_effect
    if rivals.sum() >= MOST_ALIKE:
        return
    is_sure = gains - gain_of_none > np.maximum(
        LEAST_GAIN_OF_VALUE, LEAST_DOMINANCE * (gain_of_all - gains)
    )
    by_gain = np.argsort(-gains, kind="stable")
    for number in by_gain[is_sure[by_gain]][:MOST_ALIKE]:
        error = float(gains_and_errors[number][1][number])
        wrong = _wrong_value_of(values, int(number), error)
        if wrong is not None:
            yield wrong


def _wrong_value_of(values: _Geometry, number: int, error: float) -> WrongValue | None:
    """None if the ``error`` [its unit] is too little."""
    parameter = values.parameters[number]
    least_change = LEAST_WRONG[parameter.unit] * (LEAST_OF_STATED if parameter.u else 1.0)
    if abs(error) < least_change:
        return None
    by_records = parameter.value + error
    if parameter.unit == "rad":
        by_records = float(np.remainder(by_records + np.pi, 2 * np.pi) - np.pi)
    data: dict[str, Any] = {"parameter": parameter.name, "unit": SHOWN_UNITS[parameter.unit]}
    data |= {"stated": parameter.value, "found": by_records}
    same_effect = np.flatnonzero(values.cosines(number) >= ONE_EFFECT)
    others = [values.parameters[k].name for k in same_effect if k != number]
    opposite = abs(by_records + parameter.value) < SAME_SIZE * abs(parameter.value)
    code = "wrong_sign" if opposite else "wrong_value"
    if parameter.kind in PLACEMENT_KINDS:
        code = "wrong_placement"
        data |= {"joint": parameter.joint, "motion": PLACEMENT_KINDS[parameter.kind]}
    if others and not opposite:
        code += "_or"
        data["same"] = others
    return WrongValue(Note(code, data), {parameter.name: error})
