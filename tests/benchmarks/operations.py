"""The operations that are measured, each beside its peers in turns.

An operation fills a :class:`Table`. Numbers are compared before they are timed: who is wrong is no
peer.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pinocchio as pin

from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy import accuracy_volume, workspace
from aacmm_pin.arm import Arm, load_arm_file
from aacmm_pin.arm.dh_to_urdf import urdf_text
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import EncoderEccentricity, ErrorModel
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.benchmarks.environments import (
    MissingError,
    PlainC,
    Seconds,
    ask,
    by_itself,
    child,
    install,
)
from tests.benchmarks.real_like import OPTIONS, real_like, with_errors
from tests.benchmarks.robots.robot import Robot
from tests.oracle import placement_sensitivity

OURS = "aacmm_pin"
NOISE = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
COORDINATE_NOISE = 1e-5
"""Standard deviation of every coordinate that the peers calibrate with [m]."""
GROSS_ERROR = 3e-4
"""Standard deviation of each coordinate of a gross error that is not far from what is believed [m].
"""
IN_C, PINOCCHIO, CALIBRATE = (
    "loop in C, -O3 -march=native",
    "loop over Pinocchio",
    "aacmm_pin calibrate",
)
TARGETS = {
    ("sensitivities", "100000 postures", IN_C): 2.0,
    ("sensitivities", "100000 postures", PINOCCHIO): 1 / 4,
    ("volumes", "100000 postures", IN_C): 1.5,
    ("map", "48 × 48 cells × 12 sectors", IN_C): 4.0,
    ("map", "96 × 96 cells × 12 sectors, elapsed time", "aacmm_pin, workers=1"): 1 / 1.7,
    ("calibration", "100 records", "robotkinecal"): 1 / 25,
    ("calibration", "100 records", "figaroh"): 1 / 50,
    ("diagnosis", "300 records", CALIBRATE): 8.0,
    ("diagnosis", "3000 records", CALIBRATE): 6.0,
    ("diagnosis", "12000 records, 0% gross errors, own process", OURS): 1e9,
    ("diagnosis", "12000 records, 2% gross errors, own process", OURS): 1e9,
    ("real-like", "60 postures × 3 markers", CALIBRATE): 8.0,
    ("real-like", "200 postures × 3 markers", CALIBRATE): 8.0,
    ("real-like", "12000 records of a robot with error curves, own process", OURS): 1.2e9,
    ("real-like", "100000 records of a robot with error curves, own process", OURS): 2e9,
    ("start-up", "--help", "python -c 'import typer'"): 3.0,
    ("start-up", "accuracy", "python -c 'import pinocchio, scipy.spatial'"): 2.5,
}
"""The most that is aimed at, of an operation, a task and who does it: ours over this, or the peak
of memory [byte].
"""


@dataclass(frozen=True)
class Row:
    """One way to do one thing: (median) CPU time, a peak of memory, ours over it."""

    what: str
    who: str
    cpu_s: float | None = None
    peak_bytes: int | None = None
    ours_over_this: float | None = None

    def judged(self, operation: str) -> dict[str, Any]:
        """The row with its target, where it has one, and whether that was reached."""
        found = self.peak_bytes if self.ours_over_this is None else self.ours_over_this
        target = TARGETS.get((operation, self.what, self.who))
        return asdict(self) | {
            "target": target,
            "reached": None if target is None or found is None else found <= target,
        }


@dataclass
class Table:
    """What one operation measured; ``quick`` is the smallest size and one turn, ``long`` takes many
    minutes.
    """

    quick: bool
    long: bool
    rows: list[Row] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def sizes(self, *sizes: int) -> tuple[int, ...]:
        return sizes[:1] if self.quick else sizes

    def beside(self, what: str, ways: dict[str, Callable[[], object]], turns: int = 5) -> None:
        """Time ways in turns, ours first, so that other work on the machine meets all alike."""
        seconds: dict[str, list[float]] = {who: [] for who in ways}
        for _ in range(1 if self.quick else turns):
            for who, work in ways.items():
                start = time.process_time()
                done = work()
                seconds[who].append(
                    done if isinstance(done, Seconds) else time.process_time() - start
                )
        median = {who: statistics.median(taken) for who, taken in seconds.items()}
        ours = next(iter(median.values()))
        self.rows += [Row(what, who, s, None, ours / s if s else None) for who, s in median.items()]

    def by_itself(self, what: str, before: str, code: str) -> None:
        """CPU time of ``code`` in a process of its own, and the most memory that this had."""
        with self.without():
            self.rows.append(
                Row(
                    what,
                    OURS,
                    *by_itself(f"from tests.benchmarks.operations import *\n{before}", code),
                )
            )

    def without(self) -> Any:
        """Goes on where something cannot be had, and says so in the table."""
        return _Without(self)

    def as_dict(self, operation: str) -> dict[str, Any]:
        return {"rows": [row.judged(operation) for row in self.rows], "skipped": self.skipped}


class _Without(suppress):
    def __init__(self, table: Table) -> None:
        super().__init__(MissingError)
        self.table = table

    def __exit__(self, kind: Any, error: Any, trace: Any) -> bool:
        if isinstance(error, MissingError) and str(error) not in self.table.skipped:
            self.table.skipped.append(str(error))
        return bool(super().__exit__(kind, error, trace))


def _configurations(n: int, arm: Arm) -> Array:
    return np.random.default_rng(20190427).uniform(*arm.limits.T, (n, arm.model.nq))


def pinocchio_loop(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Position (n, 3) and kinematic regressor (n, 3, 36) of every configuration, in a loop as plain
    as can be.
    """
    model, data, frame = arm.model, arm.model.createData(), arm.model.getFrameId("tip")
    positions, regressors = np.empty((len(q), 3)), np.empty((len(q), 6, 36))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k])
        positions[k] = pin.updateFramePlacement(model, data, frame).translation
        regressors[k] = pin.computeFrameKinematicRegressor(
            model, data, frame, pin.LOCAL_WORLD_ALIGNED
        )
    return positions, regressors[:, :3]


def sensitivities(table: Table) -> None:
    """Tip positions and their 24 sensitivities."""
    arm = Arm.load("sino6")
    dh = arm.require_dh("")
    for n in table.sizes(100, 1000, 10_000, 100_000, 1_000_000):
        q = _configurations(n, arm)
        position, columns = dh.chain.position_and_sensitivity(q)
        ways: dict[str, Callable[[], object]] = {
            OURS: lambda q=q: dh.chain.position_and_sensitivity(q)
        }
        with table.without():
            c = PlainC(dh.values())
            for mine, theirs in zip((position, columns), c.sensitivities(q), strict=True):
                np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)
            ways[IN_C] = lambda q=q, c=c: c.sensitivities(q)
        if n <= 100_000:
            loop_positions, regressors = pinocchio_loop(arm, q[:200])
            np.testing.assert_allclose(position[:200], loop_positions, rtol=0, atol=1e-12)
            np.testing.assert_allclose(
                placement_sensitivity(arm, q[:200]), regressors, rtol=0, atol=1e-12
            )
            ways[PINOCCHIO] = lambda q=q: pinocchio_loop(arm, q)
        table.beside(f"{n} postures", ways)


def positions(table: Table) -> None:
    """Tip positions."""
    file = load_arm_file("sino6")
    arm, urdf = Arm.from_file(file), urdf_text(file)
    for n in table.sizes(100, 1000, 10_000):
        q = _configurations(n, arm)
        mine = file.dh.chain.positions(q)
        ways: dict[str, Callable[[], object]] = {OURS: lambda q=q: file.dh.chain.positions(q)}
        for package in ("pybotics", "ikpy"):

            def by_peer(package: str = package, q: Array = q, mine: Array = mine) -> Seconds:
                report = ask(
                    package, "forward_kinematics.py", urdf, package, q=q, rows=file.dh.values()
                )
                np.testing.assert_allclose(report["positions"], mine, rtol=0, atol=1e-9)
                return Seconds(report["seconds"])

            with table.without():
                install(package)
                ways[package] = by_peer
        table.beside(f"{n} postures", ways, turns=3)


def volumes(table: Table) -> None:
    """Accuracy of postures: volumes (zonotopes) and covariances."""
    arm = Arm.load("sino6")
    dh, widths = arm.require_dh(""), np.array([p.half_width for p in arm.parameters])
    for n in table.sizes(100, 1000, 10_000, 100_000):
        q = _configurations(n, arm)
        ours: Callable[[], Array] = lambda q=q: accuracy_volume(arm, q).volume  # noqa: E731
        ways: dict[str, Callable[[], object]] = {OURS: ours}
        with table.without():
            c = PlainC(dh.values())
            in_c: Callable[[], Array] = lambda q=q, c=c: c.volumes(c.sensitivities(q)[1] * widths)  # noqa: E731
            np.testing.assert_allclose(ours(), in_c(), rtol=1e-9)
            ways[IN_C] = in_c
        table.beside(f"{n} postures", ways)


def map_cells(table: Table) -> None:
    """Map of the workspace, compared with the volumes of its postures."""
    arm = Arm.load("sino6")
    cells = 8 if table.quick else 48
    seen: list[tuple[Array, Array]] = []

    def recorded(model: Arm, q: Array, **options: Any) -> Any:
        result = accuracy_volume(model, q, **options)
        seen.append((np.array(q), result.volume))
        return result

    accuracy_volume = workspace.accuracy_volume

    def whole(workers: int = 1, cells: int = cells) -> object:
        return workspace.map_workspace(arm, (cells, cells), 12, workers=workers, progress=False)

    with patch.object(workspace, "accuracy_volume", recorded):
        whole()
    q = np.concatenate([q for q, _ in seen])
    ways: dict[str, Callable[[], object]] = {OURS: whole}
    with table.without():
        rows = arm.require_dh("").values()[:5]  # to the wrist, the map's working point
        c, widths = PlainC(rows), np.array([p.half_width for p in arm.parameters])[:20]
        in_c: Callable[[], Array] = lambda: c.volumes(c.sensitivities(q[:, :5])[1] * widths)  # noqa: E731
        np.testing.assert_allclose(in_c(), np.concatenate([v for _, v in seen]), rtol=1e-9)
        ways[IN_C] = in_c
    table.beside(f"{cells} × {cells} cells × 12 sectors", ways, turns=3)
    if table.long:
        table.beside(
            "96 × 96 cells × 12 sectors, elapsed time",
            {
                f"{OURS}, workers={n}": lambda n=n: _on_the_clock(lambda: whole(n, 96))
                for n in (2, 1)
            },
            turns=3,
        )


def _on_the_clock(work: Callable[[], object]) -> Seconds:
    start = time.perf_counter()
    work()
    return Seconds(time.perf_counter() - start)


def calibration(table: Table) -> None:
    """Calibration of 27 parameters from 100 records."""
    file, rng, n = load_arm_file("sino6"), np.random.default_rng(3), 100
    arm, dh = Arm.from_file(file), file.dh
    q = rng.uniform(*file.limits.T, (n, len(file.limits)))
    real = with_errors(dh, rng)
    tips = real.chain.positions(q) + rng.normal(size=(n, 3)) * COORDINATE_NOISE
    records, urdf = Measurements.of(q, reference=tips), urdf_text(file)
    plain: dict[str, Any] = {
        "reference_noise": COORDINATE_NOISE,
        "prior": False,
        "robust": False,
        "hold_out": False,
    }

    def ours() -> Any:
        """As the peers do it; 24 DH values and the 6 of an unknown frame, of which 27 combinations
        can be told.
        """
        return calibrate(arm, records, "geometry", reference_frame="external", **plain)

    # Of coordinates, or of distances, which is √3 times as much.
    assert ours().rms < 2 * COORDINATE_NOISE
    ways: dict[str, Callable[[], object]] = {OURS: ours}
    for package in ("robotkinecal", "figaroh"):

        def by_peer(package: str = package) -> Seconds:
            report = ask(
                package, f"solve_with_{package}.py", urdf, "--repeats", "1", q=q, positions=tips
            )
            # Otherwise there was nothing to calibrate.
            assert report["rms_before_m"] > 10 * COORDINATE_NOISE
            assert report["rms_after_m"] < 1.1 * COORDINATE_NOISE
            return Seconds(report["seconds"])

        with table.without():
            install(package)
            ways[package] = by_peer
    table.beside(f"{n} records", ways)


def measured(records: int, gross: float = 0.0) -> tuple[Arm, Measurements]:
    """Free points of SINO6 with an eccentric encoder; a part of them are off by small gross
    errors.
    """
    arm = Arm.load("sino6")
    hidden = ErrorModel(arm, (EncoderEccentricity(joint=3, values=(1e-4, 0.0)),))
    data, rng = (
        simulate_measurements(hidden, "free", records, rng=np.random.default_rng(1)),
        np.random.default_rng(2),
    )
    off = rng.normal(size=(records, 3)) * GROSS_ERROR * (rng.random(records) < gross)[:, None]
    return arm, replace(data, reference=data.reference + off)


def diagnosis(table: Table) -> None:
    """Diagnosis, compared with the calibration of the same file."""
    for n in (60,) if table.quick else (300, 3000, 12_000):
        arm, data = measured(n)
        ways: dict[str, Callable[[], object]] = {
            who: lambda work=work, arm=arm, data=data: work(arm, data, **NOISE, progress=False)
            for who, work in ((f"{OURS} diagnose", diagnose), (CALIBRATE, calibrate))
        }
        table.beside(f"{n} records", ways, turns=3)
    few = 60 if table.quick else 12_000
    for n, gross in (
        (few, 0.0),
        (few, 0.02),
        *(((30_000, 0.0), (100_000, 0.0)) if table.long else ()),
    ):
        what = f"{n} records, {gross:.0%} gross errors, own process"
        table.by_itself(
            what, f"given = measured({n}, {gross})", "diagnose(*given, **NOISE, progress=False)"
        )


def diagnosis_of_real_like(table: Table) -> None:
    """Diagnosis of files like those of robots, compared with the calibration of the same file."""
    files = ((60, 3), (200, 3))
    for postures, markers in files[:1] if table.quick else files:
        arm, data = real_like(postures, markers)
        ways: dict[str, Callable[[], object]] = {
            who: lambda work=work, arm=arm, data=data: work(arm, data, **OPTIONS, progress=False)
            for who, work in ((f"{OURS} diagnose", diagnose), (CALIBRATE, calibrate))
        }
        table.beside(f"{postures} postures × {markers} markers", ways, turns=3)
    lengths = (60,) if table.quick else (300, 2800, 12_000, *((100_000,) if table.long else ()))
    for records in lengths:
        what = f"{records} records of a robot with error curves, own process"
        work = "diagnose(*given, **OPTIONS, hold_out=False, progress=False)"
        table.by_itself(what, f"given = of_robot({records})", work)


def of_robot(records: int) -> tuple[Arm, Measurements]:
    """A robot whose joints have error curves of five waves, and its records."""
    with tempfile.TemporaryDirectory() as name:
        data = Robot.of(4).measured(records).write(Path(name))
        return Arm.load(data.with_name("robot.toml")), Measurements.read(data)


def volume_of_work(table: Table) -> None:
    """Long files and many postures (option --long)."""
    records, configurations = (200_000, 10_000_000) if table.long else (200, 1000)
    if not (table.long or table.quick):
        table.skipped.append("needs many minutes; run it with --long")
        return
    calibrated = "calibrate(*given, **NOISE, progress=False)"
    table.by_itself(f"calibration of {records} records", f"given = measured({records})", calibrated)
    drawn = (
        "arm = Arm.load('sino6')\nq = np.random.default_rng(1).uniform(*arm.limits.T, "
        f"({configurations}, 6))"
    )
    table.by_itself(
        f"accuracy_volume of {configurations} postures",
        drawn,
        "workspace.accuracy_volume(arm, q)",
    )


def start_up(table: Table) -> None:
    """Start of a command, compared with the imports that it needs."""
    shell = ("-m", "aacmm_pin.cli")
    point = ("accuracy", "sino6", "--point", "33.6323", "-671.8702", "182.9355")
    for what, words, imports in (
        ("--help", ("--help",), "typer"),
        ("accuracy", point, "pinocchio, scipy.spatial"),
    ):
        ways: dict[str, Callable[[], object]] = {
            f"aacmm-pin {what}": lambda words=words: child(*shell, *words),
            f"python -c 'import {imports}'": lambda imports=imports: child(
                "-c", f"import {imports}"
            ),
        }
        for work in ways.values():
            work()  # bytecode is there
        table.beside(what, ways)


def demo(table: Table) -> None:
    """Demonstration, from the start of the command to its page."""
    cells = ("4", "4") if table.quick else ("48", "48")

    def once() -> Seconds:
        with tempfile.TemporaryDirectory() as out:
            seconds = child("-m", "aacmm_pin.cli", "demo", "-o", out, "--cells", *cells, "--force")
            assert list(Path(out).glob("*.html"))
        return seconds

    table.beside(f"{' × '.join(cells)} cells", {OURS: once}, turns=3)


OPERATIONS: dict[str, Callable[[Table], None]] = {
    "sensitivities": sensitivities,
    "positions": positions,
    "volumes": volumes,
    "map": map_cells,
    "calibration": calibration,
    "diagnosis": diagnosis,
    "real-like": diagnosis_of_real_like,
    "long-files": volume_of_work,
    "start-up": start_up,
    "demo": demo,
}
