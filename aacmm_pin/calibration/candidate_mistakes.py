"""Mistakes that a measurement file or an arm file may have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from typing import Any

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, ArmFile
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameters import asked_again
from aacmm_pin.calibration.problem import Problem, registered
from aacmm_pin.calibration.wrong_columns import (
    LEAST_DIVISOR,
    QUARTERS,
    likely_columns,
    likely_orders,
)
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import StylusOffset

ONE_TURN = 2 * np.pi
"""A larger angle was hardly in radians [rad]."""
SLIPS_OF_LENGTHS = (-1.0, 10.0, 0.1)
LEAST_CHANGE = 4e-3
"""Least change of a length or twist that is a mistake [m, rad]."""
EXCHANGED = {
    ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"): "rows_exchanged",
    ("a_mm",): "values_exchanged",
    ("d_mm",): "values_exchanged",
}
"""Fields that two rows may have exchanged, and codes of the notes."""
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
BY_RECORDS = 10
"""Free numbers that a value by the records counts as."""
GEAR_RATIOS = (1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0)
"""Ratios of gears that an encoder may be in front of."""
SAME_UNIT = 0.05
"""Relative difference of lengths in the same unit."""


_Values = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Mistake:
    """A hypothesis on the input: a mistake in a file or in the options, and what undoes it.

    Attributes:
        matrix, offset: correct readings are ``matrix`` (nq, nq) times those in the file, plus
            ``offset`` (nq,) [rad, m].
        axes: matrix (3, 3) that multiplies coordinates; uncertainties stay.
        step: coordinates of a row belong to the row so many rows before it.
        bars: factors of the lengths of bars, by their labels.
        options: of the set-up that were left out.
        arm: None for the arm as described.
        free_numbers: how many numbers it leaves open, which may absorb other mistakes; many if the
            records choose its value.
    """

    code: str
    data: _Values = field(default_factory=dict)
    matrix: Array | None = None
    offset: Array | float = 0.0
    axes: Array = field(default_factory=lambda: np.eye(3))
    step: int = 0
    bars: Mapping[str, float] = field(default_factory=dict)
    options: _Values = field(default_factory=dict)
    arm: Arm | None = None
    free_numbers: int = 0

    @property
    def changes_targets(self) -> bool:
        """Whether it is in coordinates or lengths of bars."""
        return bool(self.step or self.bars) or not np.array_equal(self.axes, np.eye(3))

    def undone(self, problem: Problem) -> Problem:
        """Return the problem without the mistake."""
        records = problem.measurements
        placed = records
        if self.step:
            rows = np.arange(max(-self.step, 0), records.n - max(self.step, 0))
            placed = records.take(rows + self.step)
            records = records.take(rows)
        readings = records.readings
        if self.matrix is not None:
            readings = readings @ self.matrix.T + self.offset
        length = records.bar_length
        if self.bars and records.bar is not None and length is not None:
            length = length * [self.bars.get(bar, 1.0) for bar in records.bar]
        changed = replace(
            records,
            q=readings,
            of_encoders=None,
            reference=placed.reference @ self.axes,
            reference_u=placed.reference_u[:, np.abs(self.axes).argmax(axis=0)],
            bar_length=length,
            orientation=None,  # tips alone show what is wrong with them
        ).with_joint_angles(problem.model.arm)
        setup = replace(problem.setup, **self.options)
        if "target" in self.options or self.arm:
            model = problem.model if self.arm is None else replace(problem.model, arm=self.arm)
            problem = asked_again(problem, model, setup)
        return replace(problem, measurements=changed, setup=setup, targets=())


OTHER_FRAME = Mistake("other_frame", options={"reference_frame": "external"}, free_numbers=6)


def single_mistakes(problem: Problem) -> Iterator[Mistake]:
    """One mistake each, without values that only a fit gives."""
    arm = problem.model.arm
    yield from _mistakes_in_readings(problem)
    if isinstance(arm.file, ArmFile):
        yield from _mistakes_in_table(arm.file)
    if arm.dh is None and not arm.mimics:
        yield from _mistakes_in_placements(arm)
    if problem.measurements.known.any():
        yield from _mistakes_in_coordinates(problem)
    yield from _mistakes_in_bars(problem)


def _mistakes_in_bars(problem: Problem) -> Iterator[Mistake]:
    """Bars that another unit makes as long as by the arm as described."""
    records = problem.measurements
    stated = {bar.bar: bar.length for bar in records.bars()}
    errors = records.bar_length_errors(problem.model.arm.chain.positions(records.q))
    ratios = dict(zip(stated, 1.0 + errors / [*stated.values()], strict=True))
    for (unit, taken), factor in LENGTH_UNITS.items():
        bars = [bar for bar, ratio in ratios.items() if abs(ratio / factor - 1.0) < SAME_UNIT]
        if not bars:
            continue
        data = {"unit": unit, "taken": taken, "bars": bars}
        code = "bars_unit" if len(bars) == len(stated) else "some_bars_unit"
        yield Mistake(code, data, bars=dict.fromkeys(bars, factor))


def _mistakes_in_coordinates(problem: Problem) -> Iterator[Mistake]:
    records = problem.measurements
    placed = records.known
    tips = problem.model.arm.chain.positions(records.q[placed])
    references = records.reference[placed]
    if problem.external:  # where all mirror images are alike
        yield Mistake("coordinates_mirrored", axes=np.diag([1.0, 1.0, -1.0]))
    else:
        yield from _exchanged_axes(tips, references)
        yield OTHER_FRAME
    has_offset = any(isinstance(effect, StylusOffset) for effect in problem.vector.effects)
    if problem.setup.target != "unknown" and not has_offset:
        yield Mistake("target_off_tip", options={"target": "unknown"}, free_numbers=3)
    for (unit, taken), factor in LENGTH_UNITS.items():
        if not _is_small(problem.model.arm.file):
            data = {"unit": unit, "taken": taken}
            yield Mistake("coordinates_unit", data, axes=factor * np.eye(3))
    for k, axis in enumerate("xyz"):
        yield Mistake("coordinate_in_metres", {"axis": axis}, axes=_times(k, 1e3, 3))
    spread, scaled = (np.median(np.abs(xyz - np.median(xyz, axis=0))) for xyz in (tips, references))
    scale = float(spread / max(scaled, LEAST_DIVISOR))
    scaling = {"axes": [*"xyz"], "factor": 1 / scale}
    yield Mistake("coordinates_scaled", scaling, axes=scale * np.eye(3), free_numbers=BY_RECORDS)
    if placed.all():
        for where, step in (("before", 1), ("after", -1)):
            yield Mistake("rows_shifted", {"where": where}, step=step)


def _exchanged_axes(tips: Array, references: Array) -> Iterator[Mistake]:
    for handedness in (1.0, -1.0):
        axes = np.round(handedness * registered(tips, handedness * references).rotation)
        if (np.abs(axes).sum(axis=0) == 1.0).all() and not np.array_equal(axes, np.eye(3)):
            order = np.abs(axes).argmax(axis=0)
            signs = axes[order, np.arange(3)].tolist()
            letters = ["-" * (sign < 0.0) + "xyz"[k] for k, sign in zip(order, signs, strict=True)]
            yield Mistake("other_axes", {"axes": ", ".join(letters)}, axes=axes)


def _mistakes_in_readings(problem: Problem) -> Iterator[Mistake]:
    arm = problem.model.arm
    for j, largest in enumerate(np.abs(problem.measurements.readings).max(axis=0)):
        slides = arm.chain.prismatic[j]
        yield _reversed(j, arm.nq)
        if not slides:
            yield from (_turned(j, degrees, arm.nq) for degrees in QUARTERS[1:])
        units = SLIDE_UNITS if slides else {"gon": GON}
        if not slides and largest > ONE_TURN:
            units = units | {"degrees": DEG}
        elif not slides and largest <= ONE_TURN * DEG:
            units = units | {"radians": 1 / DEG}
        for unit, factor in units.items():
            column = "rad" if unit == "degrees" else "deg"
            data = {"joint": j + 1, "unit": unit, "column": column}
            code = "slide_unit" if slides else "joint_angles_unit"
            yield Mistake(code, data, matrix=_times(j, factor, arm.nq))
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


def _reversed(joint: int, nq: int) -> Mistake:
    return Mistake("joint_reversed", {"joint": joint + 1}, matrix=_times(joint, -1.0, nq))


def _turned(joint: int, degrees: int, nq: int) -> Mistake:
    data = {"joint": joint + 1, "degrees": degrees}
    unchanged = np.eye(nq)
    offset = degrees * DEG * unchanged[joint]
    return Mistake("zero_turned", data, matrix=unchanged, offset=offset)


def _wrong_couplings(arm: Arm) -> Iterator[Mistake]:
    """Other ratios, also of a joint to its own reading, and couplings of neighbours that are not
    stated.
    """
    stated = arm.coupling_matrix
    rows = arm.chain.moving_rows()
    joints = np.arange(arm.nq)
    is_near = np.abs(joints[:, None] - joints) <= 1
    for j, k in np.argwhere(is_near | (stated != 0.0)).tolist():
        ratio = float(stated[j, k])
        code = "coupling_ratio"
        if j == k:
            code = "joint_ratio" if ratio == 1.0 else code
            others = [1.0 / ratio, *(factor * ratio for factor in GEAR_RATIOS)]
        else:
            others = [-ratio, 0.0] if ratio else [1.0, -1.0]
        for other in others:
            if not ratio:
                code = "joint_shows_sum" if other < 0 else "joint_shows_difference"
            changed = stated.copy()
            changed[j, k] = other
            joints_and_rows = {"joint": j + 1, "other": k + 1, "row": rows[j], "of": rows[k]}
            data = {**joints_and_rows, "ratio": other, "stated": ratio}
            matrix = np.asarray(np.linalg.solve(stated, changed))
            yield Mistake(code, data, matrix=matrix)


def _mistakes_in_table(file: ArmFile) -> Iterator[Mistake]:
    def mistake(code: str, data: _Values, values: Mapping[int, _Values]) -> Mistake:
        rows = [row.model_copy(update=values.get(k, {})) for k, row in enumerate(file.joints)]
        return Mistake(code, data, arm=Arm.from_file(file.model_copy(update={"joints": rows})))

    def scaled(code: str, data: _Values, keys: Sequence[str], factor: float) -> Mistake:
        rows = [{key: factor * getattr(row, key) for key in keys} for row in file.joints]
        return mistake(code, data, dict(enumerate(rows)))

    other = "modified-dh" if file.convention == "standard-dh" else "standard-dh"
    conventions = {"other": other, "convention": file.convention}
    by_other = Arm.from_file(file.model_copy(update={"convention": other}))
    yield Mistake("other_convention", conventions, arm=by_other)
    for number in range(len(file.joints)):
        for code, data, values in _mistakes_in_row(file, number):
            yield mistake(code, data, {number: values})
    for j, k in combinations(range(len(file.joints)), 2):
        for keys, code in EXCHANGED.items():
            of_j, of_k = (file.joints[row].model_dump(include={*keys}) for row in (j, k))
            data = {"rows": (j + 1, k + 1), "value": keys[0][0]}
            yield mistake(code, data, {j: of_k, k: of_j})
    if 0.0 < max(abs(row.alpha_rad) for row in file.joints) < MOST_IN_RADIANS:
        yield scaled("table_in_radians", {}, ("alpha_rad", "theta_offset_rad"), 1.0 / DEG)
    for (unit, _), factor in LENGTH_UNITS.items():
        if _is_small(file) and factor > 1.0:
            yield scaled("table_unit", {"unit": unit}, ("a_mm", "d_mm"), factor)


def _mistakes_in_row(file: ArmFile, number: int) -> Iterator[tuple[str, _Values, _Values]]:
    """Code and data of each mistake in one row (from 0), and the correct values."""
    row = file.joints[number]
    yield "row_exchanged", {"row": number + 1}, {"a_mm": row.d_mm, "d_mm": row.a_mm}
    for key, unit, factor in (("a_mm", "mm", MM), ("d_mm", "mm", MM), ("alpha_rad", "°", 1.0)):
        stated = getattr(row, key)
        others = [slip * stated for slip in SLIPS_OF_LENGTHS]
        if unit == "°":
            turned = stated + DEG * np.array(QUARTERS[1:])
            turned = np.remainder(turned + np.pi, ONE_TURN) - np.pi
            others = [-stated, *turned[np.abs(turned + stated) > LEAST_CHANGE].tolist()]
        for other in others:
            if factor * abs(other - stated) > LEAST_CHANGE:
                name = f"{key.split('_')[0]}{number + 1}"
                data = {"parameter": name, "unit": unit, "stated": factor * stated}
                yield "wrong_value", {**data, "found": factor * other}, {key: other}


def _is_small(file: object) -> bool:
    return isinstance(file, ArmFile) and file.size * MM < SMALL_ARM


def _mistakes_in_placements(arm: Arm) -> Iterator[Mistake]:
    names = [parameter.name for parameter in arm.parameters]
    for joint in range(arm.nq):
        of_joint = names[6 * joint + 3 : 6 * joint + 6]
        for name, degrees in product(of_joint, QUARTERS[1:]):
            data = {"joint": joint + 1, "axis": name[1], "degrees": degrees}
            turned = moved_arm(arm, {name: degrees * DEG}, None)
            yield Mistake("placement_turned", data, arm=turned)
    for joint, (axis, letter) in product(range(arm.nq - 1), zip(np.eye(3), "xyz", strict=True)):
        if abs(axis @ arm.joint_axes[joint]) < LEAST_SINE:
            data = {"joint": joint + 1, "axis": letter}
            yield Mistake("axis_mistyped", data, arm=arm.with_joint_axis(joint + 1, axis))


def mistake_in_value(after: Fit) -> Iterator[Mistake]:
    """One wrong value of the arm, or wrong zeros, by a fit."""
    wrong = wrong_value(after)
    if wrong is not None:
        arm = after.problem.model.arm
        changed = moved_arm(arm, wrong.errors, arm.covariance)
        yield Mistake(wrong.note.code, wrong.note.data, arm=changed, free_numbers=BY_RECORDS)


def several_columns(problem: Problem) -> Iterator[tuple[Mistake, ...]]:
    """Another order; signs and quarter turns of two joints or more."""
    arm = problem.model.arm
    for order in likely_orders(problem):
        data = {"joints": [joint + 1 for joint in order]}
        matrix = np.eye(arm.nq)[np.argsort(order)]
        yield (Mistake("columns_in_order", data, matrix=matrix),)
    for signs, degrees in likely_columns(problem):
        reversed_ = [_reversed(joint, arm.nq) for joint in np.flatnonzero(signs < 0).tolist()]
        turned = [_turned(j, int(degrees[j]), arm.nq) for j in np.flatnonzero(degrees).tolist()]
        yield (*reversed_, *turned)


def in_words(mistakes: tuple[Mistake, ...]) -> str:
    """One sentence, joints with the opposite sign together."""
    notes = [Note(mistake.code, mistake.data) for mistake in mistakes]
    joints = [note.data["joint"] for note in notes if note.code == "joint_reversed"]
    if len(joints) > 1:
        others = [note for note in notes if note.code != "joint_reversed"]
        notes = [Note("joints_reversed", {"joints": joints}), *others]
    return ", and ".join(map(str, notes))
