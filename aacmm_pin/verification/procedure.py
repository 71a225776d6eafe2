"""Plan an acceptance test: places of artefacts, and points with postures, in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.plausible import BAR_LENGTH, DIAMETER, PROBE_DIAMETER
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, GivenArm, as_arm, joint_bounds
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import (
    PLANNED,
    PROBED_POINT_COLUMNS,
    REFERENCE,
    GivenRecords,
    Pool,
    as_measurements,
    bars_for,
    is_reading,
    read_table,
    seed_of,
)
from aacmm_pin.postures import articulations, brought_to, spread_out
from aacmm_pin.verification.characteristics import definitions

SPHERES = {"near": (0.2, 0.45), "far": (0.7, 0.95)}
"""In parts of the reach from joint 2; chosen here."""
SEAT_ZONES = {"near": (0.0, 0.18), "middle": (0.4, 0.6), "far": (0.82, 1.0)}
"""In parts of the reach: inside the zones of ASME B89.4.22."""
LENGTHS = 5
REPEATS = 3
"""Of lengths."""
BALL_BARS = {"short": 1, "long": 3}
"""Lengths of each ball bar if a test has all lengths."""
SPHERE_DIAMETER_MM = 25.0
"""Assumed test sphere [mm]."""
PROBE_DIAMETER_MM = 6.0
"""Assumed stylus tip [mm]."""
LENGTH_STEP = 10.0
"""Of planned lengths [mm]."""
LEVEL = 0.25
"""Largest height from joint 2, in parts of the reach."""
LEAST_SEPARATION = 0.2
"""Of artefacts, in parts of the reach."""
CANDIDATES, TRIED = 4000, 30
"""Places looked at, and those of which the most distant one is taken."""
RIM = 0.1
"""Part of the radius over the rim of a half sphere for points."""
LEAST_UPRIGHT_COSINE = 0.7
"""Of joint axis 1 to gravity, if the arm stands."""
LIMIT_MARGIN = 0.02
"""Part of the range of a joint left free, for probing around a sphere."""


@dataclass(frozen=True, eq=False)
class Procedure(Shown):
    """Points of an acceptance test in the order of probing.

    Attributes:
        probed_points: rows of an acceptance file, lengths in mm.
        q: postures ``(n, nq)`` [rad].
        points: centres of the probe ``(n, 3)`` [m].
        seed: of the random generator, or None.
    """

    arm: Arm
    probed_points: pd.DataFrame
    q: Array
    points: Array
    seed: int | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return the acceptance file to complete as a table.

        Coordinates and readings are empty; further columns are planned values.
        """
        names = [f"theta{k}_deg" for k in range(1, self.arm.nq + 1)]
        empty = pd.DataFrame("", self.probed_points.index, [*REFERENCE, *names])
        points = pd.DataFrame(self.points / MM, columns=REFERENCE).round(6)
        readings = self.arm.readings(self.q)
        angles = pd.DataFrame(readings / DEG, columns=names).round(4)
        planned = [points.add_prefix(PLANNED), angles.add_prefix(PLANNED)]
        return pd.concat([self.probed_points, empty, *planned], axis=1)

    def csv(self) -> str:
        """Return the text of the acceptance file to complete."""
        return csv_text(self.to_frame())

    def filled(self, records: GivenRecords, software: GivenModel) -> pd.DataFrame:
        """Return the completed file: readings and conditions of ``records``, coordinates by the arm
        ``software``.
        """
        records = as_measurements(records, self.arm)
        software = ErrorModel.of(software)
        q = records.with_joint_angles(software.arm).q
        coordinates_mm = software.correct(q, records.conditions) / MM
        indicated = records.to_frame().drop(columns=["record"], errors="ignore")
        planned = self.to_frame()
        planned = planned[planned.columns.difference(indicated.columns, sort=False)]
        planned = planned.assign(**dict(zip(REFERENCE, coordinates_mm.T, strict=True)))
        return pd.concat([planned, indicated], axis=1)

    def __str__(self) -> str:
        counts = self.probed_points["test"].value_counts(sort=False)
        tests = ", ".join(f"{count} of {test}" for test, count in counts.items())
        return (
            f"The plan for {self.arm.name} has {len(self.probed_points)} points to probe ({tests})"
        )

    @staticmethod
    def read(path: str | Path, arm: GivenArm) -> Procedure:
        """Read a file of :meth:`csv`, empty or completed.

        Raises:
            MeasurementFileError: a planned column is missing, or a cell without number.
        """
        arm = as_arm(arm)
        table, lines, *_ = read_table(str(path))
        angles = [f"{PLANNED}theta{k}_deg" for k in range(1, arm.nq + 1)]
        expected = [*(PLANNED + name for name in REFERENCE), *angles]
        if missing := [name for name in expected if name not in table]:
            raise MeasurementFileError(
                str(path),
                None,
                ", ".join(missing),
                f"missing; expected a procedure for {arm.name}; to write this file, run aacmm-pin "
                "plan acceptance ARM -o FILE",
            )
        problems = Problems(str(path), lines)
        planned = table[expected].apply(pd.to_numeric, errors="coerce").astype(np.float64)
        for name in expected:
            bad = ~np.isfinite(planned[name]).to_numpy()
            problems.at(bad, name, "{!r}; expected a number", table[name].to_numpy())
        problems.stop()
        if f"{PLANNED}theta{arm.nq + 1}_deg" in table:
            raise AacmmError(
                f"{path}: the procedure is for an arm with more joints; expected {arm.nq}, as many "
                f"as {arm.name} has"
            )
        points = planned[expected[:3]].to_numpy() * MM
        q = arm.joint_angles(planned[angles].to_numpy() * DEG)
        empty = [name for name in table if name in REFERENCE or is_reading(name)]
        stated = table.drop(columns=[*empty, *table.filter(regex=f"^{PLANNED}")])
        return Procedure(arm, stated, q, points)


def acceptance_procedure(
    model: GivenModel,
    *,
    standard: str | None = None,
    measuring_range: float | None = None,
    lengths: Sequence[float] | None = None,
    sphere_diameter: float = SPHERE_DIAMETER_MM * MM,
    probe_diameter: float = PROBE_DIAMETER_MM * MM,
    above: float | None = None,
    rng: np.random.Generator | None = None,
) -> Procedure:
    """Plan probed points for all characteristics of a standard, within reach.

    There are two spheres (near and far), points at three distances, a bar of five lengths in seven
    places along axes of the base and diagonals, and ball bars of two lengths in twenty places. Each
    repeat on a bar has another posture. Each sphere has five postures; each point uses the one with
    the best direction of the stylus.

    Args:
        standard: ``iso10360-12`` or ``asme-b89.4.22``, for its points alone.
        measuring_range: diameter of the working volume [m]; default twice the reach from joint 2.
        lengths: five [m], or two for ASME B89.4.22 alone; default parts of two thirds of the range.
        sphere_diameter, probe_diameter: [m].
        above: height of a table over the base origin, against gravity [m], above which the tip
            stays; default that of the base if the arm stands and the test is possible, else none.
        rng: default seed 1.

    Raises:
        UnknownNameError: unknown standard.
        AacmmError: a wrong number of lengths, one not above 0, or places out of reach.
    """
    rng = rng or np.random.default_rng(1)
    seed = seed_of(rng)
    model = ErrorModel.of(model).restricted_to_known_range()
    margin = LIMIT_MARGIN * np.diff(model.arm.limits, axis=1) * np.array([1.0, -1.0])
    inner = replace(model, arm=replace(model.arm, limits=model.arm.limits + margin))

    def laid_out(height: float | None) -> Procedure:
        layout = _Layout(Pool.draw(inner, height, 10, rng), sphere_diameter, probe_diameter, rng)
        layout.fill(standard, measuring_range, lengths)
        return layout.procedure(model.arm, seed)

    rotation, _ = model.arm.chain.at_zero
    axis = rotation[model.arm.chain.moving_axes()[0], :, 2]
    is_upright = abs(float(axis @ model.arm.up)) > LEAST_UPRIGHT_COSINE
    if above is None and is_upright and float(_shoulder(model.arm) @ model.arm.up) > -MM:
        with suppress(AacmmError):  # then it is tried without that table
            return laid_out(0.0)
    return laid_out(above)


def _shoulder(arm: Arm) -> Array:
    """Origin of joint axis 2 (or the only one) at zero joint values (3,) [m]."""
    _, origin = arm.chain.at_zero
    first_two = arm.chain.moving_axes()[:2]
    return np.asarray(origin[first_two[-1]])


@dataclass(eq=False)
class _Layout:
    """Points so far: other cells of the row, point (3,) [m] and posture (nq,) of each."""

    pool: Pool
    sphere_diameter: float
    probe_diameter: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        self.probed: list[tuple[dict[str, Any], Array, Array]] = []
        self.placed_points: list[Array] = []
        self.shoulder = _shoulder(self.pool.arm)
        self.distance = np.linalg.norm(self.pool.tips - self.shoulder, axis=1)
        self.reach = float(self.distance.max())

    def fill(
        self, standard: str | None, measuring_range: float | None, lengths: Sequence[float] | None
    ) -> None:
        wanted = {d.test for d in definitions(standard)}
        all_lengths = bool({"length-uni", "length-bi"} & wanted)
        parts = [*range(1, LENGTHS + 1)] if all_lengths else [*BALL_BARS.values()]
        if lengths is None:
            step = LENGTH_STEP * MM
            longest = 2 / 3 * (2 * self.reach if measuring_range is None else measuring_range)
            lengths = [step * np.ceil(longest * k / LENGTHS / step) for k in parts]
        bars = sorted(lengths)
        BAR_LENGTH.check(bars, "length")
        DIAMETER.check(self.sphere_diameter, "feature diameter")
        PROBE_DIAMETER.check(self.probe_diameter, "probe diameter")
        if not len(set(bars)) == len(bars) == len(parts):
            came = ", ".join(f"{x / MM:g}" for x in bars)
            raise AacmmError(f"lengths are {came} mm; expected {len(parts)} different lengths")
        self.spheres(wanted)
        for name, zone in SEAT_ZONES.items() if "single-point" in wanted else ():
            point, postures = self.place(*zone, 10)
            for q in postures:
                self.probe_point(point, q, test="single-point", feature="seat", position=name)
        if all_lengths:
            self.length_bar(bars, wanted)
        if "volumetric" in wanted:
            self.ball_bars(*(bars[parts.index(part)] for part in BALL_BARS.values()))

    def probe_point(self, point: Array, q: Array, **cells: Any) -> None:
        self.probed.append((cells, point, q))

    def place(self, low: float, high: float, each: int) -> tuple[Array, Array]:
        """A point (3,) between these parts of the reach, about as high as joint 2, and ``each``
        postures there.
        """
        tips = self.pool.tips
        inside = (self.distance >= low * self.reach) & (self.distance < high * self.reach)
        height = (tips - self.shoulder) @ self.pool.arm.up
        inside &= np.abs(height) <= LEVEL * self.reach
        for other in self.placed_points:
            inside &= np.linalg.norm(tips - other, axis=1) > LEAST_SEPARATION * self.reach
        tips = tips[inside][:CANDIDATES]
        best = tips[np.argsort(self.pool.thinness(tips))[:TRIED]]
        zone = f"places at {low:.0%} to {high:.0%} of the reach"
        (place,) = self.pool.reached(best[:, None], 1, each, zone)
        self.placed_points.append(place.points[0])
        return place.points[0], place.postures[0]

    def spheres(self, wanted: set[str]) -> None:
        """For all tests that need one."""
        diameters = {
            "feature_diameter_mm": self.sphere_diameter / MM,
            "probe_diameter_mm": self.probe_diameter / MM,
        }
        for name, zone in SPHERES.items():
            center, postures = self.place(*zone, 5)
            cells = {"feature": "sphere", "position": name, **diameters}
            if "sphere" in wanted:
                self._round(center, postures, 25, test="sphere", **cells)
            if "location" in wanted:
                for k in range(5):
                    posture = postures[k : k + 1]
                    self._round(center, posture, 5, test="location", repeat=k + 1, **cells)
            if "effective-diameter" in wanted and name == "near":
                cells["test"] = "effective-diameter"
                for repeat in range(1, 4):
                    self._round(center, postures, 9, repeat=repeat, **cells)

    def _round(self, center: Array, postures: Array, count: int, **cells: Any) -> None:
        """Add points over the half of a sphere from which the stylus comes, each with the posture
        whose stylus is closest to the normal.
        """
        stylus = self.pool.arm.stylus_axis
        if stylus is None:
            normals = _half_sphere(count, self.pool.arm.up)
            posture = np.arange(count) % len(postures)
        else:
            rotation, _ = self.pool.arm.chain.walk(postures)
            styli = rotation[self.pool.arm.chain.tip] @ stylus
            mean = styli.mean(axis=0)
            pole = -mean / np.linalg.norm(mean) if len(postures) > 1 else -styli[0]
            normals = _half_sphere(count, pole)
            posture = (-styli @ normals.T).argmax(axis=0)
        points = center + (self.sphere_diameter + self.probe_diameter) / 2 * normals
        for k in np.argsort(posture, kind="stable"):  # posture by posture
            self.probe_point(points[k], postures[posture[k]], **cells)

    def length_bar(self, lengths: Sequence[float], wanted: set[str]) -> None:
        """Add a bar with a point at 0 and at each length, in seven places; bidirectional lengths
        are probed from beyond their ends.
        """
        numbers = range(1, len(lengths) + 1)
        for place, ends in enumerate(self._bar_places(np.array([0.0, *lengths])), start=1):
            postures = self.pool.postures_at(ends, REPEATS)
            direction = (ends[-1] - ends[0]) / lengths[-1]
            for test, aside in (("length-uni", 0.0), ("length-bi", self.probe_diameter / 2)):
                repeats = range(REPEATS) if test in wanted else ()
                for repeat, number in product(repeats, numbers):
                    cells = {"test": test, "position": f"P{place}", "repeat": repeat + 1}
                    cells |= {"length_id": f"L{number}", "length_mm": lengths[number - 1] / MM}
                    cells["probe_diameter_mm"] = self.probe_diameter / MM
                    for feature, end, sign in (("A", 0, -1), (f"L{number}", number, 1)):
                        q = postures[end][repeat % len(postures[end])]
                        point = ends[end] + sign * aside * direction
                        self.probe_point(point, q, feature=feature, **cells)

    def _bar_places(self, marks: Array) -> Iterator[Array]:
        """Points (k, 3) of the bar, with ``marks`` (k,) from its start, in seven distant places:
        nearly along two level axes, upright, and along the four diagonals.
        """
        pool = self.pool
        _, _, axes = np.linalg.svd(pool.arm.up[None])
        level_axes = axes[1:]
        signs = np.array([*product((-1, 1), repeat=2)])
        diagonals = (signs @ level_axes + pool.arm.up) / np.sqrt(3)
        thinnest = float(np.quantile(pool.thinness(pool.tips[:CANDIDATES]), 0.98))
        deviation = np.linspace(0.0, 1.0, CANDIDATES)[:, None]
        middles = np.empty((0, 3))
        for wanted in (*level_axes, pool.arm.up, *diagonals):
            directions = wanted + deviation * self.rng.normal(size=(CANDIDATES, 3))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            starts = pool.tips[self.rng.integers(len(pool.tips), size=CANDIDATES)]
            bars = starts[:, None] + marks[:, None] * directions[:, None]
            points = bars.reshape(-1, 3)
            admitted = pool.room.admits(points) & np.isfinite(pool.thinness(points, thinnest))
            # Those that deviate least from the wanted direction.
            fitting = bars[admitted.reshape(CANDIDATES, -1).all(axis=1)][:TRIED]
            if not len(fitting):
                raise AacmmError(
                    f"{pool.arm.name}: a bar of {marks[-1] / MM:g} mm fits in {len(middles)} of 7 "
                    "places; expected all; reduce --measuring-range-mm or --length-mm"
                )
            spread = spread_out(np.concatenate([middles, fitting.mean(axis=1)]), TRIED, 0.0)
            distant = spread[spread >= len(middles)] - len(middles)
            (place,) = pool.reached(fitting[distant], 1, 1, "bars")
            middles = np.vstack([middles, place.points.mean(axis=0)])
            yield place.points

    def ball_bars(self, *lengths: float) -> None:
        """Two lengths in ten places each."""
        for name, length in zip(BALL_BARS, lengths, strict=True):
            cells: dict[str, Any] = {"test": "volumetric", "length_id": f"{name} ball bar"}
            cells |= {"length_mm": length / MM, "probe_diameter_mm": self.probe_diameter / MM}
            for place, bar in enumerate(bars_for(self.pool, 10, length, 2, self.rng), start=1):
                cells["position"] = f"{name} {place}"
                for feature, point, q in zip("AB", bar.points, bar.postures, strict=True):
                    self.probe_point(point, q[0], feature=feature, **cells)

    def procedure(self, arm: Arm, seed: int | None) -> Procedure:
        """All points, with exact postures."""
        rows, points, near = (np.array(values) for values in zip(*self.probed, strict=True))
        q, arrived = brought_to(self.pool.state_of, near, points, joint_bounds(arm))
        if not arrived.all():
            out = int((~arrived).sum())
            raise AacmmError(
                f"{arm.name}: {out} of {len(q)} points are outside the joint limits; expected "
                "none; use another --seed"
            )
        columns = [column.names[0] for column in PROBED_POINT_COLUMNS]
        table = pd.DataFrame([*rows]).reindex(columns=columns)
        table["repeat"] = table["repeat"].astype("Int64")
        table["articulation"] = articulations(arm, near)
        return Procedure(arm, table, q, points, seed)


def _half_sphere(count: int, pole: Array) -> Array:
    """Even directions over the half about ``pole`` (n, 3): spiral of Saff, Kuijlaars."""
    number = np.arange(count)
    height = 1 - number / max(count - 1, 1) * (1 - RIM)
    longitude = number * np.pi * (3 - np.sqrt(5))
    _, _, axes = np.linalg.svd(pole[None])
    perpendicular = axes[1:]
    around = np.stack([np.cos(longitude), np.sin(longitude)], axis=1) @ perpendicular
    radius = np.sqrt(1 - height**2)
    return np.asarray(height[:, None] * pole + radius[:, None] * around)
