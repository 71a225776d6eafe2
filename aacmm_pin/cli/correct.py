"""Tip coordinates of readings by the calibrated arm."""

from __future__ import annotations

import math
from itertools import chain
from typing import Annotated

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.file_problems import rows_in_words
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy import AccuracyVolume, accuracy_volume, expanded
from aacmm_pin.arm import Arm, outside_limits
from aacmm_pin.calibration import compare, rms
from aacmm_pin.cli.arm_options import ArmAndData, EncoderNoise
from aacmm_pin.cli.common import CsvOutput, Replacing, Results, command, note, status, warn
from aacmm_pin.effects import Conditions, ErrorModel, State, joint_commands, known_range_in_words
from aacmm_pin.errors import AacmmError, MeasurementFileError, UnknownNameError
from aacmm_pin.measurements import (
    BAR,
    BAR_U,
    ORIENTATION,
    ORIENTATION_U,
    ORIENTATIONS,
    REFERENCE,
    REFERENCE_U,
    Measurements,
    quaternions,
    read_table,
)
from aacmm_pin.report import comparison_in_words, comparison_warning

CORRECTED = ("corrected_x_mm", "corrected_y_mm", "corrected_z_mm", "u_mm")
"""Added columns; then :data:`CORRECTED_ORIENTATION`, with orientations."""
CORRECTED_ORIENTATION = tuple(f"corrected_{name}" for name in ORIENTATION)
OF_ORIENTATION = (*chain(*ORIENTATIONS), ORIENTATION_U)
OF_REFERENCES = ("seat", *BAR, BAR_U, *REFERENCE, *REFERENCE_U, *OF_ORIENTATION)
"""Columns that do not change where the readings put the tip."""

DECIMALS_OF_UNIT = {"mm": 6, "deg": 8, "rad": 9}
"""Of computed numbers by unit of the column; 9 of quaternions. Rounding moves the tip of SINO6 by
1.4 nm at most (20 000 postures), a thousandth of the noise.
"""
FEWEST_ALIGNED = 3
"""Fewer positions do not determine an alignment."""
LARGE_CHANGE = 0.05
"""A command that changes by more is near a singular posture [rad]."""


@command(
    "aacmm-pin correct calibrated.toml readings.csv -o corrected.csv",
    "aacmm-pin correct calibrated.toml path.csv --commands --nominal ur5",
)
def run(
    arm: ArmAndData,
    noise: EncoderNoise,
    nominal: Annotated[
        str | None,
        typer.Option(
            metavar="ARM",
            help="Compare with this nominal arm (name or arm file, or URDF if ARM comes from a "
            "URDF). Default: the URDF that ARM names. If ARM names no URDF, the default is ARM "
            "without causes of error, and --commands requires --nominal.",
        ),
    ] = None,
    commands: Annotated[
        bool,
        typer.Option(
            "--commands",
            help="Use the angles as robot commands. Add corrected commands and the uncertainty of "
            "the position. Corrected commands move the real tip to the position of the nominal "
            "tip.",
        ),
    ] = False,
    orientation: Annotated[
        bool,
        typer.Option(
            "--orientation",
            help="Add the orientation of the tip. Default: add the orientation only if the file "
            "states orientations.",
        ),
    ] = False,
    output: CsvOutput = None,
    *,
    files: Replacing,
) -> None:
    with Results(files, output) as results:
        model, path = arm.model_and_data()
        nominal_model = _nominal(nominal, model)
        controller = nominal_model if commands else None
        if commands and nominal_model is None:
            raise typer.BadParameter(
                "--commands requires --nominal, the arm that the robot controller uses"
            )
        if commands and orientation:
            raise typer.BadParameter("--orientation cannot be combined with --commands")
        for name in ("references", "relations"):
            if getattr(arm, name) is not None:
                raise typer.BadParameter(f"--{name} cannot be used with correct; omit this option")
        file = read_table(path)
        table = file.table
        unit = "rad" if "theta1_rad" in table else "deg"
        if commands:
            sent = [f"command{j}_{unit}" for j in range(1, model.arm.nq + 1)]
            added = [*sent, "u_mm", "u_aligned_mm"]
        elif orientation or any(form[0] in table for form in ORIENTATIONS):
            added = [*CORRECTED, *CORRECTED_ORIENTATION]
        else:
            added = [*CORRECTED]
        for name in table.columns.intersection(added):
            raise MeasurementFileError(
                path,
                1,
                name,
                "the column exists already; expected a file without corrections; delete this "
                "column, or use the file before correction",
            )
        is_of_readings = ~table.columns.isin(OF_REFERENCES)
        of_file = Measurements.from_frame(table.loc[:, is_of_readings], model.arm.nq, path)
        readings = arm.with_approach(of_file.with_joint_angles(model.arm))
        warnings = model.input_warnings(readings.q, readings.conditions)
        for line in (*file.notes, *readings.read_as, *warnings):
            note(line)
        rows = _rows_in_range(model, readings)
        inside = readings.take(rows)
        try:
            if controller is not None:
                values = _command_values(model, controller, inside, unit, noise.encoder_noise)
            else:
                accuracy = _accuracy(model, inside.q, inside.conditions, noise.encoder_noise)
                state = model.state(inside.q, inside.conditions)
                values = _tip_values(state, accuracy)
                u = math.nan if accuracy is None else rms(accuracy.u)
                _note_comparisons(model, nominal_model, table, rows, state.position, u, path)
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
        computed = pd.DataFrame(values[:, : len(added)], rows, added)
        decimals = {name: DECIMALS_OF_UNIT.get(name.rpartition("_")[2], 9) for name in added}
        columns = computed.round(decimals).reindex(range(readings.n))
        results.text(file.text(pd.concat([table, columns], axis=1)), output)
    effects = ", ".join(effect.label for effect in model.effects)
    status(
        f"{path}: computed the tip for {computed.iloc[:, 0].count()} of {readings.n} records with "
        f"{model.arm.name}"
        + (f" and the causes of error {effects}" if effects else ", which has no causes of error")
    )


def _nominal(name: str | None, model: ErrorModel) -> ErrorModel | None:
    """The arm of ``--nominal``, or else the URDF that ``model`` corrects; None without either."""
    if name is None:
        return None if model.arm.nominal is None else ErrorModel(model.arm.uncorrected)
    try:
        if name.lower().endswith(".urdf"):
            nominal = ErrorModel(Arm.from_urdf(name, model.arm.tip))
        else:
            nominal = ErrorModel.load(name)
    except UnknownNameError as error:
        raise AacmmError(f"--nominal {name}: {error}") from None
    if nominal.arm.nq != model.arm.nq:
        raise AacmmError(
            f"--nominal {name}: {nominal.arm.nq} joints; expected {model.arm.nq}, as many as "
            f"{model.arm.name} has"
        )
    return nominal


def _command_values(
    model: ErrorModel,
    nominal: ErrorModel,
    records: Measurements,
    unit: str,
    encoder_noise: float | None,
) -> Array:
    """Corrected commands in the file's ``unit``, and both uncertainties [mm] (n, nq + 2)."""
    q = _commands(model, nominal, records)
    u = _u_of_commands(model, q, records, encoder_noise)
    readings = model.arm.readings(q)
    return np.column_stack([readings if unit == "rad" else readings / DEG, u / MM])


def _tip_values(state: State, accuracy: AccuracyVolume | None) -> Array:
    """Position of the tip and its u [mm], and its orientation as quaternions (n, 8)."""
    u = np.full(state.n, np.nan) if accuracy is None else accuracy.u
    return np.column_stack([state.position / MM, u / MM, quaternions(state.rotation[-1])])


def _commands(model: ErrorModel, nominal: ErrorModel, records: Measurements) -> Array:
    """Corrected commands (n, nq) [rad]; rows of nan, with a warning, if they cannot be used."""
    commands, arrived = joint_commands(model, nominal, records.q, records.conditions)
    _warn_of_large_changes(model, commands - records.q, records, arrived)
    if np.array_equal(commands, records.q):
        note(
            f"correct changed no command, because {model.arm.name} and the nominal arm have the "
            "same tip positions"
        )
    outside = outside_limits(commands, model.arm.limits).any(axis=1)
    rows_of_reason = {
        "the posture is singular, out of reach, or outside an error curve": ~arrived,
        "a corrected command is outside the joint limits": outside,
    }
    for reason, rows in rows_of_reason.items():
        if rows.any():
            refused_rows = rows_in_words(records.row[rows])
            warn(
                f"{records.source}: {refused_rows}: correct left the commands empty, because "
                f"{reason}"
            )
        commands[rows] = np.nan
    if len(commands) and np.isnan(commands).all():
        raise AacmmError(
            f"no command moves the tip of {model.arm.name} to the nominal position; check that "
            "--nominal is the same arm"
        )
    return commands


def _warn_of_large_changes(
    model: ErrorModel, change: Array, records: Measurements, arrived: Mask
) -> None:
    """Warn of a large ``change`` (n, nq) [rad] of revolute joints, in most commands or in some."""
    change = np.where(model.arm.chain.prismatic, 0.0, change)[arrived]
    if not len(change):
        return
    common = np.median(change, axis=0)
    for j in np.flatnonzero(np.abs(common) > LARGE_CHANGE):
        warn(
            f"{records.source}: the commands of joint {j + 1} change by {common[j] / DEG:.1f}° "
            "(median). Check that --nominal is the same arm, and that the calibration determined "
            "the zero of this joint"
        )
    uncommon = np.abs(change - common).max(axis=1)
    singular = uncommon > LARGE_CHANGE
    if singular.any():
        rows = rows_in_words(records.row[arrived][singular])
        warn(
            f"{records.source}: {rows}: a command near a singular posture changes by up to "
            f"{uncommon.max() / DEG:.1f}°; check the motion before you send the command"
        )


def _note_comparisons(
    model: ErrorModel,
    nominal: ErrorModel | None,
    table: pd.DataFrame,
    rows: Index,
    tips: Array,
    u: float,
    path: str,
) -> None:
    """State the distance of tips (n, 3) [m], of standard uncertainty ``u`` [m], from references."""
    if not table.columns.isin([*REFERENCE, BAR[0], "seat"]).any() or not len(rows):
        return
    try:
        of_file = Measurements.from_frame(table, model.arm.nq, path).take(rows)
        records = of_file.with_joint_angles(model.arm)
    except MeasurementFileError as error:
        note(
            "correct did not compare the tip with references, bars and seats, because of an error: "
            f"{str(error).splitlines()[0]}"
        )
        return
    other_targets = model.other_targets(records.conditions)
    if other_targets:
        markers = records.conditions.require("marker", "correct").astype(str)
        is_at_tip = ~np.isin(markers, other_targets)
        note(
            f"correct did not compare {len(is_at_tip) - is_at_tip.sum()} records of the targets "
            f"{', '.join(other_targets)}, because these targets are not at the tip"
        )
        records, tips = records.take(is_at_tip), tips[is_at_tip]
    compared_tips, first_in_words = [tips], "the nominal arm"
    if nominal is not None:
        compared_tips.insert(0, nominal.correct(records.q, records.conditions))
    elif model.effects:  # perhaps no nominal arm: causes may be calibrated with the geometry
        first_in_words = "the arm without causes of error"
        compared_tips.insert(0, model.arm.positions(records.q))
    for comparison in compare(records, compared_tips, u):
        text = comparison_in_words(comparison, first_in_words)
        if text:
            status(text)
        warning = comparison_warning(comparison, model.arm.name)
        if warning:
            warn(warning)


def _rows_in_range(model: ErrorModel, readings: Measurements) -> Index:
    """Rows in the known range of all causes; warn of others."""
    in_range = model.known_at(readings.q)
    for effect, inside in zip(model.effects, in_range.T, strict=True):
        if not inside.all():
            place = f"{readings.source}: {rows_in_words(readings.row[~inside])}"
            cause = f"{effect.label}{known_range_in_words(effect)}"
            warn(
                f"{place}: correct left the results empty, because the angles are outside the "
                f"range of {cause}"
            )
    rows = np.flatnonzero(in_range.all(axis=1))
    if readings.n and not rows.size:
        raise AacmmError(
            f"{readings.source}: all readings are outside the range of the causes of error of "
            f"{model.arm.name}; expected one or more readings inside"
        )
    return rows


def _u_of_commands(
    model: ErrorModel,
    commands: Array,
    records: Measurements,
    encoder_noise: float | None,
) -> Array:
    """u of the tip in the base, and after its alignment (n, 2) [m]; nan without a command or
    stated uncertainty.
    """
    u = np.full((len(commands), 2), np.nan)
    usable = np.flatnonzero(np.isfinite(commands).all(axis=1))
    accuracy = _accuracy(model, commands[usable], records.conditions.take(usable), encoder_noise)
    if accuracy is None or not len(usable):
        return u
    u[usable, 0] = accuracy.u
    frame = "a base frame without uncertainty" if _base_is_exact(model.arm) else "the base frame"
    status(f"{records.source}: position of the tip in {frame}: {expanded(accuracy.u)}")
    if len(usable) < FEWEST_ALIGNED:
        note(f"u_aligned_mm is empty, because it needs {FEWEST_ALIGNED} commands or more")
        return u
    u[usable, 1] = accuracy.u_aligned
    status(
        f"{records.source}: position of the tip after an alignment of the base to these commands: "
        f"{expanded(accuracy.u_aligned)}"
    )
    return u


def _accuracy(
    model: ErrorModel, q: Array, conditions: Conditions, encoder_noise: float | None
) -> AccuracyVolume | None:
    """Accuracy of the tip at ``q`` (n, nq) [rad], with notes; None if no uncertainty is stated."""
    noise = model.arm.encoder_noise if encoder_noise is None else np.array([encoder_noise])
    if not (np.diag(model.covariance()).any() or (noise is not None and noise.any())):
        note(f"u_mm is empty, because {model.arm.name} states no uncertainty")
        return None
    if noise is None:
        note(
            "u_mm contains only the uncertainties of the parameters; to add the noise of readings, "
            "use --encoder-noise"
        )
    accuracy = accuracy_volume(
        model, q, conditions=conditions, method="ellipsoid", encoder_noise=encoder_noise
    )
    for caveat in accuracy.sources.caveats:
        note(caveat)
    if _base_is_exact(model.arm):
        note(
            "u_mm does not include the uncertainty of the base, because the arm file states no "
            "half-widths; with --commands, use u_aligned_mm"
        )
    return accuracy


def _base_is_exact(arm: Arm) -> bool:
    """Whether a calibrated URDF has no uncertainty of joint 1."""
    u_of_base = [p.u for p in arm.parameters if p.joint == 1]
    return arm.covariance is not None and arm.dh is None and not any(u_of_base)
