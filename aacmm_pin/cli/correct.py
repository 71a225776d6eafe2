"""Tip coordinates of readings by the calibrated arm with its effects."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.accuracy.volume import accuracy_volume
from aacmm_pin.cli.arm_options import ArmAndData, EncoderNoise
from aacmm_pin.cli.common import Force, Output, Results, command, note
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements.csv_columns import BAR, REFERENCE, REFERENCE_U
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.records import Measurements

CORRECTED = ("corrected_x_mm", "corrected_y_mm", "corrected_z_mm", "u_mm")
"""The columns that ``correct`` adds."""
OF_REFERENCES = ("seat", *BAR, *REFERENCE, *REFERENCE_U)
"""Columns that say where the tip should be have no part in where the readings put it."""


@command
def run(arm: ArmAndData, noise: EncoderNoise, output: Output = None, force: Force = False) -> None:
    """Tip coordinates of readings by the calibrated arm with its effects, with their uncertainty, as CSV."""
    with Results(force, output, reads=arm.files) as results:
        model, path = arm.model_and_data()
        table, _, read_as = read_table(path)
        for name in table.columns.intersection(list(CORRECTED)):
            raise MeasurementFileError(path, 1, name, "is there already; expected readings that were not corrected yet")
        of_readings = ~table.columns.isin(OF_REFERENCES)
        readings = Measurements.from_frame(table.loc[:, of_readings], model.arm.nq, path)
        for line in read_as:
            note(f"note: {line}")
        rows = _known_rows(model, readings, path)
        known = readings.take(rows)
        found = np.full((readings.n, len(CORRECTED)), np.nan)
        try:
            found[rows, :3] = model.correct(known.q, known.conditions) / MM
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
        found[rows, 3] = _u(model, known, noise.encoder_noise_rad) / MM
        added = dict(zip(CORRECTED, found.T, strict=True))
        results.text(csv_text(table.assign(**added)), output)
    effects = ", ".join(effect.label for effect in model.effects) or "no effects"
    note(f"{path}: {known.n} of {readings.n} readings corrected by {model.arm.name} with {effects}")


def _known_rows(model: ErrorModel, readings: Measurements, path: str) -> Index:
    """The readings that can be corrected; the others, outside the range of an error curve, are listed on stderr.

    Raises:
        AacmmError: none can be.
    """
    known = model.known_at(readings.q)
    for k, number in zip(*np.nonzero(~known), strict=True):
        effect = model.effects[number]
        note(f"{path}: row {readings.row[k]} is outside the range of {effect.label}{effect.known_where}; left empty")
    rows = np.flatnonzero(known.all(axis=1))
    if readings.n and not rows.size:
        raise AacmmError(f"{path}: no reading is in the range in which the effects of {model.arm.name} are known")
    return rows


def _u(model: ErrorModel, readings: Measurements, encoder_noise: float | None) -> Array:
    """Standard uncertainty of each position (n,) [m]; nan where none is stated."""
    noise = model.arm.encoder_noise if encoder_noise is None else np.array([encoder_noise])
    if not (np.diag(model.covariance()).any() or (noise is not None and noise.any())):
        note(f"note: {model.arm.name} states no uncertainty, so u_mm is left empty")
        return np.full(readings.n, np.nan)
    if noise is None:
        note("note: u_mm is of the parameters alone; --encoder-noise-rad adds the noise of the readings")
    return accuracy_volume(
        model, readings.q, conditions=readings.conditions, method="ellipsoid", encoder_noise=encoder_noise
    ).u
