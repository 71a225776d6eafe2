"""Whether one geometric value of the arm file is wrong, and what the records give instead.

All geometric values are fitted freely. Then each of them in turn is taken to be wrong, and the
others to be within what is stated of them: of a linear model these are formulas of one matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.notes import Note
from aacmm_pin.arm import Parameter
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameters import unstated
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.errors import AacmmError

USUAL = {"m": 3e-4, "rad": 2e-3}
"""How far off a value usually is where nobody stated it: as manufactured [m, rad]."""
LEAST_WRONG = {"m": 4e-4, "rad": 4e-3}
"""A smaller error of a value is none of the file [m, rad] …"""
LEAST_OF_STATED = 0.2
"""… of which the uncertainty is not stated; where it is, so many times that."""
ZERO_KINDS = ("theta_offset", "rz")
"""Kinds of the zero of a joint, in DH rows and in placements of a URDF."""
RECORDS_FOR_VALUES = 2000
"""So many records tell which value is wrong."""
SURE = 30.0
"""Least gain in χ² by one wrong value …"""
DOMINATES = 3.0
"""… and over what the other values, within what is stated of them, leave."""
ALIKE = 12.0
"""Values whose gain is less by no more than this may be the wrong one too."""
MOST_ALIKE = 3
"""More values than this that may be wrong are no finding."""
FAR_OFF = 4.0
"""A value that the fit moves by fewer standard uncertainties is not asked about."""
MOST_OF_ZEROS = 0.6
"""Zeros are not all off by more: a joint is seen to be a quarter turn off [rad]."""
PER_PARAMETER = 6.0
"""Gain in χ² for each further value, with which all zeros are more probable than one value."""
SAME_SIZE = 0.02
"""Values of opposite sign whose sizes differ by a smaller part are those of a wrong sign."""


class WrongValue(NamedTuple):
    """What the records give instead of a value of the arm file.

    Attributes:
        note: parameter, stated value and value by the records.
        row: of the parameter; 0 for the zeros of all joints.
        fit: with all geometric values free.
    """

    note: Note
    row: int
    fit: Fit


def wrong_value(after: Fit) -> WrongValue | None:
    """The geometric value of the arm file that is wrong, or zeros that are all off; None if every
    value is about as stated, or if no single one explains the others.
    """
    problem = after.problem
    geometric = np.flatnonzero([p is not None for p in problem.vector.arm_parameters])
    if not geometric.size or not after.tells_noise:
        return None
    off = np.abs(after.point.x - problem.start)[geometric]
    usual = _usual(problem, geometric)
    if after.unmodelled == 0.0 and (off < FAR_OFF * usual).all():
        return None
    mine = np.zeros(problem.widths.size, dtype=bool)
    mine[geometric] = True
    records = problem.measurements
    some = records.take(np.arange(0, records.n, -(-records.n // RECORDS_FOR_VALUES)))
    try:
        free = fit(unstated(problem.of(some), mine))
    except AacmmError:
        return None
    values = _Geometry.of(free, geometric, usual)
    if values.zeros.size == geometric.size and not problem.stated[geometric].any():
        return None  # they were looked for, and nothing is known of them
    said = _said(values)
    return None if said is None else WrongValue(*said, free)


def _usual(problem: Problem, geometric: Index) -> Array:
    """Standard uncertainty of each geometric value: as stated, else the usual one."""
    parameters = [problem.vector.arm_parameters[k] for k in geometric]
    usual = np.array([USUAL[p.unit] for p in parameters if p is not None])
    return np.where(problem.stated[geometric], problem.widths[geometric], usual)


class _Geometry(NamedTuple):
    """Geometric values by the records alone: ``xᵀ A x - 2 bᵀ x`` of their errors x.

    Attributes:
        parameters: of the arm file.
        zeros: numbers of those that are zeros of joints.
        information: A (p, p).
        vector: b (p,).
        usual: standard uncertainties (p,).
    """

    parameters: tuple[Parameter, ...]
    zeros: Index
    information: Array
    vector: Array
    usual: Array

    @staticmethod
    def of(free: Fit, geometric: Index, usual: Array) -> _Geometry:
        problem = free.problem
        own = np.ix_(geometric, geometric)
        precision = np.linalg.pinv(free.covariance[own], hermitian=True)
        change = (free.point.x - problem.start)[geometric]
        values, vectors = np.linalg.eigh(precision - np.diag(problem.widths[geometric] ** -2.0))
        information = (vectors * np.maximum(values, 0.0)) @ vectors.T
        every = problem.vector.arm_parameters
        parameters = tuple(p for k in geometric if (p := every[k]) is not None)
        chain = problem.model.arm.chain
        turning = {
            row
            for row, slides in zip(chain.moving_rows(), chain.prismatic, strict=True)
            if not slides
        }
        zeros = [p.kind in ZERO_KINDS and p.joint in turning for p in parameters]
        numbers = np.flatnonzero(zeros)
        return _Geometry(parameters, numbers, information, precision @ change, usual)

    def with_free(self, wrong: Index) -> tuple[float, Array]:
        """How much less χ² is than with no error, and the errors, with some values free."""
        widths = self.usual.copy()
        widths[wrong] = 1e3 * np.array([USUAL[self.parameters[k].unit] for k in wrong])
        errors = np.linalg.solve(self.information + np.diag(widths**-2.0), self.vector)
        return float(self.vector @ errors), np.asarray(errors, np.float64)


def _said(values: _Geometry) -> tuple[Note, int] | None:
    """The note on the wrong value, and its row."""
    every = np.arange(len(values.parameters))
    least, _ = values.with_free(every[:0])
    most, _ = values.with_free(every)
    freed = [values.with_free(np.array([k])) for k in every]
    gains = np.array([gain for gain, _ in freed])
    best = int(np.argmax(gains))
    if values.zeros.size > 1:
        with_zeros, errors = values.with_free(values.zeros)
        if with_zeros - gains[best] > SURE + PER_PARAMETER * values.zeros.size:
            largest = float(np.abs(errors[values.zeros]).max())
            sure = with_zeros - least > DOMINATES * (most - with_zeros)
            if not sure or not LEAST_WRONG["rad"] < largest < MOST_OF_ZEROS:
                return None
            return Note("zeros_off", {"joints": values.zeros.size, "largest": largest}), 0
    if gains[best] - least < max(SURE, DOMINATES * (most - gains[best])):
        return None
    alike = np.flatnonzero(gains > gains[best] - ALIKE)
    parameter, error = values.parameters[best], float(freed[best][1][best])
    least_change = LEAST_WRONG[parameter.unit] * (LEAST_OF_STATED if parameter.u else 1.0)
    if alike.size > MOST_ALIKE or abs(error) < least_change:
        return None
    by_records = parameter.value + error
    if parameter.unit == "rad":
        by_records = float(np.remainder(by_records + np.pi, 2 * np.pi) - np.pi)
    opposite = abs(by_records + parameter.value) < SAME_SIZE * abs(parameter.value)
    data = {"parameter": parameter.name, "stated": parameter.value, "found": by_records}
    data["unit"] = "mm" if parameter.unit == "m" else "°"
    return Note("wrong_sign" if opposite else "wrong_value", data), parameter.joint or 0
