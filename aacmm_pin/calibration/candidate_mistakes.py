"""Mistakes that a measurement file or an arm file may have.

Signs and quarter turns of several joint angles at once, and orders of columns, are too many for a
fit of each, so that a few records judge all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations, permutations, product
from typing import Any

import numpy as np

from aacmm_pin._support.arrays import Array, Index, wrapped
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, ArmFile
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.parameters import asked_again
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.effects import StylusOffset

SLIPS_OF_LENGTHS = (-1.0, 10.0, 0.1)
LEAST_CHANGE = 4e-3
"""Least change of a length or twist that is a mistake [m, rad]."""
TABLE_KEYS = ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad")
GON = 0.9
"""One gon [°]."""
SLIDE_UNITS = {"mm": 1e-3, "centimetres": 1e-2, "inches": 0.0254}
"""Units of a prismatic joint's readings, in metres."""
JOINT_UNITS = {"gon": GON, "degrees": DEG, "radians": 1 / DEG}
"""Units of one joint's angles; the factor that undoes them."""
MOST_IN_RADIANS = 0.06
"""Twists all below this are right angles under a key for degrees [rad]."""
SMALL_ARM = 0.25
"""Least sum of the lengths of an arm [m]."""
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
QUARTERS = (0, 90, -90, 180)
"""Possible offsets of an angle [°]."""
MOST_TURNED = 4
"""So many joints at most are turned; any number is reversed."""
MANY_JOINTS = 7
KNOWN_RECORDS = 16
"""So many records with references judge …"""
SEATS, PER_SEAT = 5, 4
"""… or so many seats, with so many records each."""
SIMILAR_RATIO = 1.5
"""Largest ratio of misfits that are alike."""
NEAREST = 40
"""Number of combinations returned."""
FEW_ORDERS = 5
LEAST_DIVISOR = 1e-9
"""Least divisor [m]."""


@dataclass(frozen=True, eq=False)
class Mistake:
    """A hypothesis on the input: a mistake in a file or in the options, and what undoes it.

    Attributes:
        also: notes on further mistakes that go with the first.
        size: number of mistakes.
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
    also: tuple[Note, ...] = ()
    size: int = 1
    matrix: Array | None = None
    offset: Array | float = 0.0
    axes: Array = field(default_factory=lambda: np.eye(3))
    step: int = 0
    bars: Mapping[str, float] = field(default_factory=dict)
    options: _Values = field(default_factory=dict)
    arm: Arm | None = None
    free_numbers: int = 0

    def __str__(self) -> str:
        return ", and ".join(map(str, (Note(self.code, self.data), *self.also)))

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
    yield from mistakes_in_bars(problem)


def mistakes_in_bars(problem: Problem) -> Iterator[Mistake]:
    """Bars that another unit makes as long as by the arm as described."""
    records = problem.measurements
    stated = {bar.bar: bar.length for bar in records.bars()}
    errors = records.bar_length_errors(problem.model.arm.chain.positions(records.q))
    ratios = dict(zip(stated, 1.0 + errors / [*stated.values()], strict=True))
    for (unit, taken), factor in LENGTH_UNITS.items():
        bars = [bar for bar, ratio in ratios.items() if abs(ratio / factor - 1.0) < SAME_UNIT]
        if bars:
            data = {"unit": unit, "taken": taken, "bars": bars}
            yield Mistake("bars_unit", data, bars=dict.fromkeys(bars, factor))


def _mistakes_in_coordinates(problem: Problem) -> Iterator[Mistake]:
    records = problem.measurements
    placed = records.known
    tips = problem.model.arm.chain.positions(records.q[placed])
    references = records.reference[placed]
    if problem.external:  # where all mirror images are alike
        yield Mistake("coordinates_mirrored", axes=np.diag([1.0, 1.0, -1.0]))
    else:
        yield from _exchanged_axes()
        options = {"reference_frame": "external"}
        yield Mistake("other_frame", options=options, free_numbers=6)
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


def _exchanged_axes() -> Iterator[Mistake]:
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        letters = ["-" * (sign < 0.0) + "xyz"[k] for k, sign in zip(order, signs, strict=True)]
        if letters != [*"xyz"]:
            axes = np.eye(3)[:, order] * signs
            yield Mistake("other_axes", {"axes": ", ".join(letters)}, axes=axes)


def _mistakes_in_readings(problem: Problem) -> Iterator[Mistake]:
    arm = problem.model.arm
    nq = arm.nq
    for j, slides in enumerate(arm.chain.prismatic):
        of_joint = np.eye(nq, dtype=np.intp)[j]
        yield reversed_and_turned(1 - 2 * of_joint, 0 * of_joint)
        if not slides:
            for degrees in QUARTERS[1:]:
                yield reversed_and_turned(np.ones_like(of_joint), degrees * of_joint)
        code = "slide_unit" if slides else "joint_angles_unit"
        for unit, factor in (SLIDE_UNITS if slides else JOINT_UNITS).items():
            column = "rad" if unit == "degrees" else "deg"
            data = {"joint": j + 1, "unit": unit, "column": column}
            yield Mistake(code, data, matrix=_times(j, factor, nq))
    for j, k in combinations(range(nq), 2):
        order = np.arange(nq)
        order[[j, k]] = k, j
        data = {"joints": (j + 1, k + 1)}
        yield Mistake("joints_exchanged", data, matrix=np.eye(nq)[order])
    yield from _wrong_couplings(arm)
    for (unit, taken), factor in ANGLE_UNITS.items():
        data = {"unit": unit, "taken": taken}
        yield Mistake("angles_unit", data, matrix=factor * np.eye(nq))


def _times(number: int, factor: float, size: int) -> Array:
    return np.diag(np.where(np.arange(size) == number, factor, 1.0))


def reversed_and_turned(signs: Index, degrees: Index) -> Mistake:
    """Angles that signs (nq,), then shifts (nq,) [°], correct."""
    notes = []
    reversed_ = (np.flatnonzero(signs < 0) + 1).tolist()
    if reversed_:
        code = "joints_reversed" if len(reversed_) > 1 else "joint_reversed"
        notes.append(Note(code, {"joint": reversed_[0], "joints": reversed_}))
    for j in np.flatnonzero(degrees).tolist():
        notes.append(Note("zero_turned", {"joint": j + 1, "degrees": int(degrees[j])}))
    first, *others = notes
    size = len(reversed_) + int(np.count_nonzero(degrees))
    matrix = np.diag(signs.astype(np.float64))
    offset = np.asarray(DEG * degrees)
    return Mistake(first.code, first.data, tuple(others), size, matrix, offset)


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
        if j == k:
            ratios = [1.0 / ratio, *(factor * ratio for factor in GEAR_RATIOS)]
            others = dict.fromkeys(ratios, "joint_ratio")
        elif ratio:
            others = {-ratio: "coupling_ratio", 0.0: "coupling_ratio"}
        else:
            others = {-1.0: "joint_shows_sum", 1.0: "joint_shows_difference"}
        for other, code in others.items():
            changed = stated.copy()
            changed[j, k] = other
            data = {"joint": j + 1, "other": k + 1, "row": rows[j], "of": rows[k]}
            matrix = np.asarray(np.linalg.solve(stated, changed))
            yield Mistake(code, data | {"ratio": other, "stated": ratio}, matrix=matrix)


def _mistakes_in_table(file: ArmFile) -> Iterator[Mistake]:
    other = "modified-dh" if file.convention == "standard-dh" else "standard-dh"
    conventions = {"other": other, "convention": file.convention}
    by_other = Arm.from_file(file.model_copy(update={"convention": other}))
    yield Mistake("other_convention", conventions, arm=by_other)
    stated = np.array([[getattr(row, key) for key in TABLE_KEYS] for row in file.joints])
    for code, data, table in _other_tables(stated, _is_small(file)):
        rows = [
            row.model_copy(update=dict(zip(TABLE_KEYS, values, strict=True)))
            for row, values in zip(file.joints, table.tolist(), strict=True)
        ]
        yield Mistake(code, data, arm=Arm.from_file(file.model_copy(update={"joints": rows})))


def _other_tables(stated: Array, is_small: bool) -> Iterator[tuple[str, _Values, Array]]:
    """Code and data of each mistake in a table (rows, 4) [mm, rad], and the correct table."""
    if 0.0 < np.abs(stated[:, 2]).max() < MOST_IN_RADIANS:
        yield "table_in_radians", {}, stated / [1.0, 1.0, DEG, DEG]
    for (unit, _), factor in LENGTH_UNITS.items():
        if is_small and factor > 1.0:
            yield "table_unit", {"unit": unit}, stated * [factor, factor, 1.0, 1.0]
    for j, k in combinations(range(len(stated)), 2):
        for code, columns in (
            ("rows_exchanged", slice(4)),
            ("values_exchanged", slice(0, 1)),
            ("values_exchanged", slice(1, 2)),
        ):
            table = stated.copy()
            table[[j, k], columns] = stated[[k, j], columns]
            data = {"rows": (j + 1, k + 1), "value": TABLE_KEYS[columns.start or 0][0]}
            yield code, data, table
    for k in range(len(stated)):
        table = stated.copy()
        table[k, :2] = stated[k, 1::-1]
        yield "row_exchanged", {"row": k + 1}, table
    for (k, column), value in np.ndenumerate(stated[:, :3]):
        name = TABLE_KEYS[column].split("_")[0]
        unit, factor = ("°", 1.0) if name == "alpha" else ("mm", MM)
        others = value * np.array(SLIPS_OF_LENGTHS)
        if name == "alpha":
            turned = wrapped(value + DEG * np.array(QUARTERS[1:]))
            others = np.append(-value, turned[np.abs(turned + value) > LEAST_CHANGE])
        for other in others[factor * np.abs(others - value) > LEAST_CHANGE].tolist():
            table = stated.copy()
            table[k, column] = other
            values = {"stated": factor * value, "found": factor * other}
            yield "wrong_value", {"parameter": f"{name}{k + 1}", "unit": unit} | values, table


def _is_small(file: object) -> bool:
    return isinstance(file, ArmFile) and file.size * MM < SMALL_ARM


def _mistakes_in_placements(arm: Arm) -> Iterator[Mistake]:
    rotations = [parameter for parameter in arm.parameters if parameter.unit == "rad"]
    for parameter, degrees in product(rotations, QUARTERS[1:]):
        data = {"joint": parameter.joint, "axis": parameter.kind[1], "degrees": degrees}
        turned = moved_arm(arm, {parameter.name: degrees * DEG}, None)
        yield Mistake("placement_turned", data, arm=turned)


def several_columns(problem: Problem) -> Iterator[Mistake]:
    """Another order; signs and quarter turns of two joints or more."""
    arm = problem.model.arm
    for order in likely_orders(problem):
        data = {"joints": [joint + 1 for joint in order]}
        yield Mistake("columns_in_order", data, matrix=np.eye(arm.nq)[np.argsort(order)])
    for signs, degrees in likely_columns(problem):
        yield reversed_and_turned(signs, degrees)


def likely_columns(problem: Problem) -> list[tuple[Index, Index]]:
    """Signs (nq,), then shifts (nq,) [°], that undo wrong columns of two joints or more: the best,
    of those alike the simplest first; none for many joints.
    """
    arm = problem.model.arm
    if arm.nq > MANY_JOINTS:
        return []
    # The change of a joint is twice the number of its quarter turn, plus one if it is reversed.
    changes = np.indices((2 * len(QUARTERS),) * arm.nq, dtype=np.int8).reshape(arm.nq, -1).T
    changed_joints = np.count_nonzero(changes, axis=1)
    is_turned = changes > 1
    is_likely = (changed_joints <= MOST_TURNED) | ~is_turned.any(axis=1)
    tried = (changed_joints > 1) & is_likely & ~is_turned[:, arm.chain.prismatic].any(axis=1)
    changes, changed_joints = changes[tried], changed_joints[tried]
    signs = 1 - 2 * (changes % 2)
    degrees = np.array(QUARTERS)[changes // 2]
    misfit = _misfits(problem, lambda readings: signs[:, None] * readings + DEG * degrees[:, None])
    alike = misfit <= SIMILAR_RATIO * misfit.min()
    simplicity = np.where(alike, changed_joints, arm.nq + 1)
    simplest = np.lexsort((misfit, simplicity))[:NEAREST]
    return [*zip(signs[simplest], degrees[simplest], strict=True)]


def likely_orders(problem: Problem) -> list[tuple[int, ...]]:
    """Orders unlike that of the file: the joint (from 0) of each column, best first; none for many
    joints.
    """
    nq = problem.model.arm.nq
    if nq > MANY_JOINTS:
        return []
    orders = [*permutations(range(nq))][1:]
    misfit = _misfits(problem, lambda readings: readings[:, np.argsort(orders)].transpose(1, 0, 2))
    nearest = np.argsort(misfit, kind="stable")[:FEW_ORDERS]
    return [orders[number] for number in nearest]


def _misfits(problem: Problem, change: Callable[[Array], Array]) -> Array:
    """Median distance of tips and targets over the tips' travel (m,), with readings (n, nq) changed
    in m ways (m, n, nq) [rad].
    """
    arm, records = problem.model.arm, problem.measurements
    rows = np.flatnonzero(records.known)
    has_references = bool(rows.size)
    if has_references:
        spread = np.linspace(0, rows.size - 1, min(KNOWN_RECORDS, rows.size))
        rows = rows[np.round(spread).astype(np.intp)]
    else:
        seats = sorted(records.seats().values(), key=len, reverse=True)[:SEATS]
        rows = np.concatenate([members[:PER_SEAT] for members in seats])
    readings = change(records.readings[rows])
    tips = arm.chain.positions(arm.joint_angles(readings.reshape(-1, arm.nq)))
    tips = tips.reshape(len(readings), rows.size, 3)
    centred = tips - np.median(tips, axis=1, keepdims=True)
    travel = np.median(np.linalg.norm(centred, axis=2), axis=1)
    if has_references:
        targets = records.reference[rows]
        deviations = (
            _deviations_after_registration(tips, targets) if problem.external else tips - targets
        )
    else:
        seat = records.conditions.labels("seat")[rows]
        same_seat = seat[:, None] == seat
        deviations = tips - (same_seat / same_seat.sum(axis=1)) @ tips
    distance = np.median(np.linalg.norm(deviations, axis=2), axis=1)
    return np.asarray(distance / np.maximum(travel, LEAST_DIVISOR))


def _deviations_after_registration(tips: Array, targets: Array) -> Array:
    """Tips (m, n, 3) minus targets (n, 3) in the frame of the tips, by least squares [m]."""
    centred = tips - tips.mean(axis=1, keepdims=True)
    target = targets - targets.mean(axis=0)
    u, _, v = np.linalg.svd(target.T @ centred)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return np.asarray(centred - target @ (u @ v))
