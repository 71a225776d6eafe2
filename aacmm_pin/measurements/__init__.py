"""Records of an arm: read from a file or simulated, and what they say of where the tip was."""

from aacmm_pin.measurements.csv_columns import (
    BAR,
    BAR_U,
    MEASUREMENT_FILE,
    ORIENTATION,
    ORIENTATION_U,
    PLANNED,
    PROBED_POINT_COLUMNS,
    REFERENCE,
    REFERENCE_U,
    Column,
    is_of_reference,
    is_reading,
    span,
)
from aacmm_pin.measurements.csv_table import measurement_file, read_table
from aacmm_pin.measurements.csv_values import check_numbers, read_values
from aacmm_pin.measurements.measuring_points import Pool, bars_for
from aacmm_pin.measurements.noise import ENCODER, Noise
from aacmm_pin.measurements.probed_points import PREDICTED_ACCURATE, read_probed_points
from aacmm_pin.measurements.records import Bar, GivenRecords, Measurements, as_measurements
from aacmm_pin.measurements.repeats import fingerprints, fingerprints_of_standards, means_of_contacts, originals
from aacmm_pin.measurements.simulate import seed_of, simulate_measurements

__all__ = [
    "BAR",
    "BAR_U",
    "ENCODER",
    "MEASUREMENT_FILE",
    "ORIENTATION",
    "ORIENTATION_U",
    "PLANNED",
    "PREDICTED_ACCURATE",
    "PROBED_POINT_COLUMNS",
    "REFERENCE",
    "REFERENCE_U",
    "Bar",
    "Column",
    "GivenRecords",
    "Measurements",
    "Noise",
    "Pool",
    "as_measurements",
    "bars_for",
    "check_numbers",
    "fingerprints",
    "fingerprints_of_standards",
    "is_of_reference",
    "is_reading",
    "means_of_contacts",
    "measurement_file",
    "originals",
    "read_probed_points",
    "read_table",
    "read_values",
    "seed_of",
    "simulate_measurements",
    "span",
]
