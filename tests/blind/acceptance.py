"""Touches of an acceptance test by a blind plant: two spheres, three single points, five lengths in
seven positions.
"""

from __future__ import annotations

import numpy as np

from blind import plans, table
from blind.chains import Chain
from blind.conditions import SESSIONS, run
from blind.kinematics import Array
from blind.plant import ENCODER_NOISE, Plant

SPHERE_MM, PROBE_MM = 25.0, 6.0
LENGTHS_MM = (300.0, 550.0, 800.0, 1050.0, 1300.0)
CONTACT_NOISE = 3e-6
"""Of one coordinate of a touch [m]."""
Labels = dict[str, str]


def acceptance_csv(plant: Plant, index: int) -> str:
    """Acceptance test number ``index``, as the arm's own software writes it: its nominal
    coordinates, and indications.
    """
    rng, arm = plant.rng("acceptance", index), plant.machine.arm
    where, seat, labels = _artefacts(rng, arm)
    n = len(seat)
    axes = np.broadcast_to([0.0, 0.0, 1.0], where.shape)
    q = plans.seat_postures(rng, arm, plans.Seats(where, axes, np.empty((0, 2), dtype=int)), seat)
    conditions = run(rng, arm, np.full(n, -1), np.arange(n) * SESSIONS // n, 1.0, plant.small_terms)
    q = plant.machine.touching(
        q, conditions, where[seat] + CONTACT_NOISE * rng.standard_normal((n, 3))
    )
    read = q + ENCODER_NOISE * rng.standard_normal(q.shape)
    columns = {
        name: [row.get(name, "") for row in labels]
        for name in dict.fromkeys(name for row in labels for name in row)
    }
    return table.csv(
        columns
        | table.angles(read)
        | table.coordinates(arm.tips(read))
        | {
            "time_s": table.fixed(conditions.time, 1),
            "temperature_c": table.fixed(conditions.temperature_reading, 2),
        }
        | table.approaches(conditions, np.ones(conditions.approach.shape[1], dtype=bool))
    )


def _artefacts(rng: np.random.Generator, arm: Chain) -> tuple[Array, np.ndarray, list[Labels]]:
    """Points (p, 3) [m] that the centre of the probe comes to, which of them each touch is at (n,),
    and its labels.
    """
    tips = arm.tips(plans.random_postures(rng, arm, 3000))
    out = np.hypot(tips[:, 0], tips[:, 1])
    tips = tips[(out > 0.3) & (out < 0.9) & (np.abs(tips[:, 2]) < 0.45)]
    points: list[Array] = []
    seat: list[int] = []
    labels: list[Labels] = []

    def touch(point: Array, cells: list[Labels]) -> None:
        points.append(point)
        seat.extend([len(points) - 1] * len(cells))
        labels.extend(cells)

    of_sphere = {
        "feature_diameter_mm": str(SPHERE_MM),
        "probe_diameter_mm": str(PROBE_MM),
        "u_length_mm": "0.0005",
    }
    for position in "12":
        directions = rng.standard_normal((25, 3))
        directions[:, 2] = np.abs(directions[:, 2])  # a sphere on its stem
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        centre = tips[rng.integers(len(tips))]
        for direction in directions:
            at = centre + 0.5e-3 * (SPHERE_MM + PROBE_MM) * direction
            touch(at, [{"test": "sphere", "feature": "S", "position": position} | of_sphere])
    for position in ("near", "middle", "far"):
        touch(tips[rng.integers(len(tips))], [{"test": "single-point", "position": position}] * 10)
    for length in LENGTHS_MM:
        for position in "1234567":
            a = tips[rng.integers(len(tips))]
            away = tips - a
            b = away[np.abs(np.linalg.norm(away, axis=1) - 1e-3 * length).argmin()]
            known = {"test": "length-uni", "length_id": f"L{length:.0f}", "position": position}
            known |= {"length_mm": str(length), "u_length_mm": "0.001"}
            for feature, point in (("A", a), ("B", a + 1e-3 * length * b / np.linalg.norm(b))):
                touch(point, [known | {"feature": feature, "repeat": repeat} for repeat in "123"])
    return np.array(points), np.array(seat), labels
