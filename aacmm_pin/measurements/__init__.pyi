from .csv_columns import (
    BAR,
    BAR_U,
    LABELS,
    MEASUREMENT_FILE,
    ORIENTATION,
    ORIENTATION_U,
    ORIENTATIONS,
    PLANNED,
    PROBED_POINT_COLUMNS,
    REFERENCE,
    REFERENCE_U,
    UNKNOWN_COLUMN,
    Column,
    column_of,
    is_reading,
    span,
)
from .csv_header import first_names
from .csv_table import is_workbook, measurement_file, read_table
from .csv_values import check_values, read_values
from .measuring_points import Pool, bars_for, seats_for
from .noise import ENCODER, PROBE, REFERENCE_NOISE, Noise
from .observations import (
    NOTHING_KNOWN,
    OF_BAR,
    Observations,
    best_sphere,
    centre_of_sphere,
    clusters_of,
    normal_of_plane,
)
from .orientation import quaternions
from .probed_points import PREDICTED_ACCURATE, read_probed_points
from .record_checks import FEWEST_CONTACTS
from .records import Bar, GivenRecords, Measurements, as_measurements
from .relations import ANGLE, DISTANCE
from .repeats import (
    fingerprints,
    fingerprints_of_standards,
    means_of_contacts,
    originals,
    posture_numbers,
)
from .schedule import probe_directions
from .simulation import (
    SCHEMES,
    SIMULATED_BAR,
    Scheme,
    seed_of,
    simulate_measurements,
    simulate_touches,
)

__all__ = [
    "ANGLE",
    "BAR",
    "BAR_U",
    "DISTANCE",
    "ENCODER",
    "FEWEST_CONTACTS",
    "LABELS",
    "MEASUREMENT_FILE",
    "NOTHING_KNOWN",
    "OF_BAR",
    "ORIENTATION",
    "ORIENTATIONS",
    "ORIENTATION_U",
    "PLANNED",
    "PREDICTED_ACCURATE",
    "PROBE",
    "PROBED_POINT_COLUMNS",
    "REFERENCE",
    "REFERENCE_NOISE",
    "REFERENCE_U",
    "SCHEMES",
    "SIMULATED_BAR",
    "UNKNOWN_COLUMN",
    "Bar",
    "Column",
    "GivenRecords",
    "Measurements",
    "Noise",
    "Observations",
    "Pool",
    "Scheme",
    "as_measurements",
    "bars_for",
    "best_sphere",
    "centre_of_sphere",
    "check_values",
    "clusters_of",
    "column_of",
    "fingerprints",
    "fingerprints_of_standards",
    "first_names",
    "is_reading",
    "is_workbook",
    "means_of_contacts",
    "measurement_file",
    "normal_of_plane",
    "originals",
    "posture_numbers",
    "probe_directions",
    "quaternions",
    "read_probed_points",
    "read_table",
    "read_values",
    "seats_for",
    "seed_of",
    "simulate_measurements",
    "simulate_touches",
    "span",
]
