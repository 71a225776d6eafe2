"""Mistakes that a measurement file or an arm file may have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import combinations, permutations, product
from typing import Any

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, ArmFile
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameters import asked_again
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.wrong_columns import (
    QUARTERS,
    likely_columns,
    likely_orders,
    likely_ratios,
    likely_scales,
)
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import StylusOffset

ONE_TURN = 2 * np.pi
"""A larger angle was hardly in radians [rad]."""
SLIPS_OF_LENGTHS = (-1.0, 10.0, 0.1)
LEAST_LENGTH = 2e-3
"""Shorter lengths of a row are not looked at [m]."""
EXCHANGED = {
    ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"): "rows_exchanged",
    ("a_mm",): "values_exchanged",
    ("d_mm",): "values_exchanged",
}
"""Fields that two rows may have exchanged, and codes of the notes."""
PRISMATIC = {
    "kind": "prismatic",
    "limits_mm": (-1e4, 1e4),
    "limits_rad": None,
    "encoder_noise_rad": None,
}
SLIDE_UNITS = {"mm": 1e-3, "centimetres": 1e-2, "inches": 0.0254}
"""Units of a prismatic joint's readings, in metres."""
LEAST_SINE = 0.01
"""A twist with a smaller sine has no sign."""
MOST_IN_RADIANS = 0.06
"""Twists all below this are right angles under a key for degrees [rad]."""
SMALL_ARM = 0.25
"""Least sum of the lengths of an arm [m]."""
GON = 0.9
"""One gon [°]."""
LENGTH_UNITS = {
    ("metres", "mm"): 1e3,
    ("centimetres", "mm"): 10.0,
    ("inches", "mm"): 25.4,
    ("micrometres", "mm"): 1e-3,
    ("mm", "metres"): MM,
}
"""Possible units of lengths and those they were taken in; the factor that undoes it."""
ANGLE_UNITS = {
    ("degrees", "radians"): DEG,
    ("radians", "degrees"): 1 / DEG,
    ("gon", "degrees"): GON,
    ("minutes of arc", "degrees"): 1 / 60,
    ("milliradians", "radians"): 1e-3,
    ("turns", "degrees"): 360.0,
    ("turns", "radians"): 360.0 * DEG,
}
"""The same for angles."""


_Values = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Mistake:
    """A mistake in a file, and what undoes it.

    Attributes:
        matrix, offset: correct readings are ``matrix`` (nq, nq) times those in the file, plus
            ``offset`` (nq,) [rad, m].
        axes: matrix (3, 3) that multiplies coordinates; uncertainties stay.
        options: of the set-up that were left out.
        arm: None for the arm as described.
        by_records: whether the records choose its value.
    """

    code: str
    data: Mapping[str, Any] = field(default_factory=dict)
    matrix: Array | None = None
    offset: Array | float = 0.0
    axes: Array = field(default_factory=lambda: np.eye(3))
    bar_factor: float = 1.0
    options: Mapping[str, Any] = field(default_factory=dict)
    arm: Arm | None = None
    by_records: bool = False

    @property
    def changes_tips(self) -> bool:
        """Whether it is not in coordinates or lengths."""
        return "target" in self.options or self.matrix is not None or self.arm is not None

    @property
    def free_numbers(self) -> int:
        """How many numbers it leaves open, which may absorb other mistakes."""
        numbers_of_option = {"reference_frame": 6, "target": 3}
        return 10 * self.by_records + sum(numbers_of_option[option] for option in self.options)

    def undone(self, problem: Problem) -> Problem:
        """Return the problem without the mistake."""
        records = problem.measurements
        length = records.bar_length
        readings = records.readings
        if self.matrix is not None:
            readings = readings @ self.matrix.T + self.offset
        changed = replace(
            records,
            q=readings,
            of_encoders=None,
            reference=records.reference @ self.axes,
            reference_u=records.reference_u[:, np.abs(self.axes).argmax(axis=0)],
            bar_length=None if length is None else self.bar_factor * length,
            orientation=None,  # tips alone show what is wrong with them
        ).with_joint_angles(problem.model.arm)
        setup = replace(problem.setup, **self.options)
        if "target" in self.options or self.arm:
            model = problem.model if self.arm is None else replace(problem.model, arm=self.arm)
            problem = asked_again(problem, model, setup)
        return replace(problem, measurements=changed, setup=setup, targets=())


OTHER_FRAME = Mistake("other_frame", options={"reference_frame": "external"})


def single_mistakes(problem: Problem) -> Iterator[Mistake]:
    """Without values that the records choose."""
    records = problem.measurements
    yield from _mistakes_in_readings(problem)
    for code, data, correct in _mistakes_in_arm(problem.model.arm):
        yield Mistake(code, data, arm=correct)
    if records.known.any():
        yield from _mistakes_in_coordinates(problem)
    if records.bars():
        for (unit, taken), factor in LENGTH_UNITS.items():
            data = {"unit": unit, "taken": taken}
            yield Mistake("bars_unit", data, bar_factor=factor)


def _mistakes_in_coordinates(problem: Problem) -> Iterator[Mistake]:
    if problem.external:  # where all mirror images are alike
        yield Mistake("coordinates_mirrored", axes=np.diag([1.0, 1.0, -1.0]))
    else:
        yield from _exchanged_axes()
        yield OTHER_FRAME
    has_offset = any(isinstance(effect, StylusOffset) for effect in problem.vector.effects)
    if problem.setup.target != "unknown" and not has_offset:
        yield Mistake("target_off_tip", options={"target": "unknown"})
    for (unit, taken), factor in LENGTH_UNITS.items():
        if not _is_small(problem.model.arm.file):
            data = {"unit": unit, "taken": taken}
            yield Mistake("coordinates_unit", data, axes=factor * np.eye(3))
    for k, axis in enumerate("xyz"):
        yield Mistake("coordinate_in_metres", {"axis": axis}, axes=_times(k, 1e3, 3))


def _exchanged_axes() -> Iterator[Mistake]:
    orders_and_signs = [*product(permutations(range(3)), product((1, -1), repeat=3))]
    for order, signs in orders_and_signs[1:]:  # the first changes nothing
        letters = [f"{'-' * (s < 0)}{'xyz'[k]}" for k, s in zip(order, signs, strict=True)]
        axes = np.eye(3)[:, order] * signs
        yield Mistake("other_axes", {"axes": ", ".join(letters)}, axes=axes)


def _mistakes_in_readings(problem: Problem) -> Iterator[Mistake]:
    arm = problem.model.arm
    readings = problem.measurements.readings
    for j, largest in enumerate(np.abs(readings).max(axis=0)):
        yield _reversed(j, arm.nq)
        slides = arm.chain.prismatic[j]
        units = SLIDE_UNITS
        if not slides:
            units = {"gon": GON}
            if largest > ONE_TURN:
                units["degrees"] = DEG
            elif largest <= ONE_TURN * DEG:
                units["radians"] = 1 / DEG
        for unit, factor in units.items():
            column = "rad" if unit == "degrees" else "deg"
            data = {"joint": j + 1, "unit": unit, "column": column}
            code = "slide_unit" if slides else "joint_angles_unit"
            yield Mistake(code, data, matrix=_times(j, factor, arm.nq))
    for j, degrees in product(range(arm.nq), QUARTERS[1:]):
        yield _turned(j, degrees, arm.nq)
    for j, k in combinations(range(arm.nq), 2):
        order = np.arange(arm.nq)
        order[[j, k]] = k, j
        data = {"joints": (j + 1, k + 1)}
        yield Mistake("joints_exchanged", data, matrix=np.eye(arm.nq)[order])
    yield from _wrong_couplings(arm)
    for (unit, taken), factor in ANGLE_UNITS.items():
        data = {"unit": unit, "taken": taken}
        yield Mistake("angles_unit", data, matrix=factor * np.eye(arm.nq))


def _times(number: int, factor: float, size: int) -> Array:
    return np.diag(np.where(np.arange(size) == number, factor, 1.0))


@cache
def _reversed(joint: int, nq: int) -> Mistake:
    matrix = _times(joint, -1.0, nq)
    return Mistake("joint_reversed", {"joint": joint + 1}, matrix=matrix)


@cache
def _turned(joint: int, degrees: int, nq: int) -> Mistake:
    data = {"joint": joint + 1, "degrees": degrees}
    unchanged = np.eye(nq)
    offset = degrees * DEG * unchanged[joint]
    return Mistake("zero_turned", data, matrix=unchanged, offset=offset)


def _wrong_couplings(arm: Arm) -> Iterator[Mistake]:
    stated = arm.coupling_matrix
    uncoupled = np.eye(arm.nq)
    rows = arm.chain.moving_rows()
    for j, k in np.argwhere(stated != uncoupled):
        ratio = float(stated[j, k])
        inverse = 1.0 / ratio if j == k else 0.0
        for expected in {-ratio, inverse, float(uncoupled[j, k])} - {ratio}:
            changed = stated.copy()
            changed[j, k] = expected
            data = {"joint": rows[j], "of": rows[k], "ratio": ratio, "expected": expected}
            matrix = np.asarray(np.linalg.solve(stated, changed))
            yield Mistake("coupling_ratio", data, matrix=matrix)
    upwards = [(joint + 1, joint) for joint in range(arm.nq - 1)]
    downwards = [(joint, other) for other, joint in upwards]
    for (j, k), sign in product([*upwards, *downwards], (1.0, -1.0)):
        if stated[j, k]:
            continue
        code = "joint_shows_sum" if sign < 0 else "joint_shows_difference"
        matrix = uncoupled + sign * np.outer(uncoupled[j], uncoupled[k])
        ratio = float((stated @ matrix)[j, k])
        data = {"joint": j + 1, "other": k + 1, "row": rows[j], "of": rows[k], "ratio": ratio}
        yield Mistake(code, data, matrix=matrix)


def _mistakes_in_arm(arm: Arm) -> Iterator[tuple[str, _Values, Arm]]:
    """Code and data of each mistake in the file of the arm, and the arm without it."""
    if isinstance(arm.file, ArmFile):
        yield from _mistakes_in_table(arm.file)
    if arm.dh is None and not arm.mimics:
        yield from _mistakes_in_placements(arm)


def _mistakes_in_table(file: ArmFile) -> Iterator[tuple[str, _Values, Arm]]:
    other = "modified-dh" if file.convention == "standard-dh" else "standard-dh"
    conventions = {"other": other, "convention": file.convention}
    by_other = Arm.from_file(file.model_copy(update={"convention": other}))
    yield "other_convention", conventions, by_other
    for number in range(len(file.joints)):
        for code, data, values in _mistakes_in_row(file, number):
            yield code, data, _with_values(file, {number: values})
    for j, k in combinations(range(len(file.joints)), 2):
        for keys, code in EXCHANGED.items():
            values_of_j, values_of_k = (
                file.joints[row].model_dump(include={*keys}) for row in (j, k)
            )
            data = {"rows": (j + 1, k + 1), "value": keys[0][0]}
            yield code, data, _with_values(file, {j: values_of_k, k: values_of_j})
    if 0.0 < max(abs(row.alpha_rad) for row in file.joints) < MOST_IN_RADIANS:
        yield "table_in_radians", {}, _scaled(file, ("alpha_rad", "theta_offset_rad"), 1.0 / DEG)
    for (unit, _), factor in LENGTH_UNITS.items():
        if _is_small(file) and factor > 1.0:
            yield "table_unit", {"unit": unit}, _scaled(file, ("a_mm", "d_mm"), factor)


def _mistakes_in_row(file: ArmFile, number: int) -> Iterator[tuple[str, _Values, _Values]]:
    """Of one row (from 0); and the correct values."""
    row = file.joints[number]
    yield "row_exchanged", {"row": number + 1}, {"a_mm": row.d_mm, "d_mm": row.a_mm}
    twist = {"row": number + 1, "alpha": row.alpha_rad}
    if abs(np.sin(row.alpha_rad)) > LEAST_SINE:
        yield "twist_reversed", twist, {"alpha_rad": -row.alpha_rad}
    for key in ("a_mm", "d_mm"):
        stated = getattr(row, key)
        for factor in SLIPS_OF_LENGTHS if abs(stated) * MM > LEAST_LENGTH else ():
            data = {"parameter": f"{key[0]}{number + 1}", "stated": stated * MM}
            data["likely"] = factor * stated * MM
            yield "length_mistyped", data, {key: factor * stated}
    for degrees in QUARTERS[1:]:
        alpha = float(np.remainder(row.alpha_rad + degrees * DEG + np.pi, ONE_TURN) - np.pi)
        if abs(alpha + row.alpha_rad) >= LEAST_SINE:  # not the opposite sign
            yield "twist_mistyped", twist | {"likely": alpha}, {"alpha_rad": alpha}
    if not row.fixed and not row.slides:
        yield "kind_of_joint", {"row": number + 1}, PRISMATIC


def _scaled(file: ArmFile, keys: Sequence[str], factor: float) -> Arm:
    rows = [{key: factor * getattr(row, key) for key in keys} for row in file.joints]
    return _with_values(file, dict(enumerate(rows)))


def _with_values(file: ArmFile, values: Mapping[int, _Values]) -> Arm:
    rows = [row.model_copy(update=values.get(k, {})) for k, row in enumerate(file.joints)]
    return Arm.from_file(file.model_copy(update={"joints": rows}))


def _is_small(file: object) -> bool:
    return isinstance(file, ArmFile) and file.size * MM < SMALL_ARM


def _mistakes_in_placements(arm: Arm) -> Iterator[tuple[str, _Values, Arm]]:
    names = [parameter.name for parameter in arm.parameters]
    for joint in range(arm.nq):
        of_joint = names[6 * joint + 3 : 6 * joint + 6]
        for name, degrees in product(of_joint, QUARTERS[1:]):
            data = {"joint": joint + 1, "axis": name[1], "degrees": degrees}
            yield "placement_turned", data, moved_arm(arm, {name: degrees * DEG}, None)
    for joint, (axis, letter) in product(range(arm.nq - 1), zip(np.eye(3), "xyz", strict=True)):
        if abs(axis @ arm.joint_axes[joint]) < LEAST_SINE:
            data = {"joint": joint + 1, "axis": letter}
            yield "axis_mistyped", data, arm.with_joint_axis(joint + 1, axis)


def mistakes_by_records(problem: Problem, after: Fit | None) -> Iterator[Mistake]:
    """Mistakes with a value that the records choose."""
    arm = problem.model.arm
    wrong = None if after is None else wrong_value(after)
    if wrong is not None:
        changed = moved_arm(arm, wrong.errors, arm.covariance)
        yield Mistake(wrong.note.code, wrong.note.data, arm=changed, by_records=True)
    rows = arm.chain.moving_rows()
    for joint, factor in enumerate(likely_ratios(problem)):
        ratio = float(arm.coupling_matrix[joint, joint]) * factor
        data = {"joint": joint + 1, "row": rows[joint], "ratio": ratio}
        matrix = _times(joint, factor, arm.nq)
        yield Mistake("joint_ratio", data, matrix=matrix, by_records=True)
    scales = likely_scales(problem)
    if scales is None:
        return
    for letters in ("xyz", *"xyz"):
        scaled = [letter in letters for letter in "xyz"]
        scale = float(np.mean(scales[scaled]))
        scaling = {"axes": [*letters], "factor": 1 / scale}
        axes = np.diag(np.where(scaled, scale, 1.0))
        yield Mistake("coordinates_scaled", scaling, axes=axes, by_records=True)


def several_columns(problem: Problem) -> list[tuple[Mistake, ...]]:
    """Another order; signs and quarter turns of two joints or more."""
    arm = problem.model.arm
    mistakes: list[tuple[Mistake, ...]] = []
    for order in likely_orders(problem):
        data = {"joints": [joint + 1 for joint in order]}
        matrix = np.eye(arm.nq)[np.argsort(order)]
        mistakes.append((Mistake("columns_in_order", data, matrix=matrix),))
    for signs, degrees in likely_columns(problem):
        reversed_ = [_reversed(joint, arm.nq) for joint in np.flatnonzero(signs < 0).tolist()]
        turned = [_turned(j, int(degrees[j]), arm.nq) for j in np.flatnonzero(degrees).tolist()]
        mistakes.append((*reversed_, *turned))
    return mistakes


def in_words(mistakes: tuple[Mistake, ...]) -> str:
    """One sentence, joints with the opposite sign together."""
    notes = [Note(mistake.code, mistake.data) for mistake in mistakes]
    joints = [note.data["joint"] for note in notes if note.code == "joint_reversed"]
    if len(joints) > 1:
        others = [note for note in notes if note.code != "joint_reversed"]
        notes = [Note("joints_reversed", {"joints": joints}), *others]
    return ", and ".join(map(str, notes))
