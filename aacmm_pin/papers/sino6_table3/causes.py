"""What may have spread the records of Table 3: patterns of the causes, none of them fitted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.progress import watched
from aacmm_pin.effects import (
    BaseCompliance,
    BearingTilt,
    Effect,
    EncoderEccentricity,
    EncoderEllipticity,
    JointCompliance,
    JointHysteresis,
    LinkBending,
    ThermalExpansion,
    ZeroDrift,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.measurements.schedule import workshop_conditions
from aacmm_pin.papers.sino6 import printed_points
from aacmm_pin.papers.sino6_table3 import patterns as spread
from aacmm_pin.papers.sino6_table3.patterns import Pattern, mixed
from aacmm_pin.papers.sino6_table3.seats import TouchedSeats

DH, NOISE, CONTACT, BOTH = "DH errors", "encoder noise", "contact noise", "DH errors + encoder noise"
ODD, STAND = "encoder noise + one odd seat", "encoder noise + stand that yields with height"
ECCENTRICITY, GRAVITY, THERMAL = "encoder eccentricity", "gravity (bearings, tubes, stand)", "thermal expansion"
OF_SEATS = (ODD, STAND, CONTACT)
"""Causes that are not the arm's."""
RATIOS = np.geomspace(0.1, 10.0, 61)
"""Spread by the second cause of a mixture over that of the first."""
SIZES = 21
"""Sizes of encoder noise that are tried beside DH errors."""
POWERS = (0.5, 1.0, 2.0, 3.0)
"""Powers of the height with which a stand yields: a column tilts with the first, bends with the third."""
UNEQUAL = 0.5
"""Standard deviation of the logarithm of each joint's noise, where the joints are not equal."""
FEW = 200
"""Draws of causes that need new conditions in each."""
TEMPERATURE_RANGE = 3.0
"""Temperatures stay within ± this of the reference [K]."""
WARMTH = (0.1, 2.0)
"""Sizes of thermal expansion thought possible, in 20 µm/(m K): the metal is known, and the room not warmer by more."""
WARM_UP = 1800.0
"""Time constant of a warm-up [s]."""
JOINTS, TUBES = range(1, 7), (3, 5)


def patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000, progress: bool = False) -> dict[str, Pattern]:
    """Every cause that is weighed, by its name."""
    with watched(_patterns(seats, rng, draws), progress, "patterns", "cause") as found:
        return {pattern.name: pattern for pattern in found}


def _patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int) -> Iterator[Pattern]:
    def workshop(rng: np.random.Generator) -> Conditions:
        """Conditions of an ordinary session: seat after seat, the postures of each in random order."""
        order = np.lexsort((rng.random(len(seats.all_q)), np.repeat(np.arange(len(seats.q)), seats.q.shape[1])))
        taken = workshop_conditions(
            np.zeros(len(order), dtype=np.intp),
            seats.all_q[order],
            rng=rng,
            reference_temperature=seats.model.arm.reference_temperature,
            temperature_range=TEMPERATURE_RANGE,
        )
        return taken.take(np.argsort(order))

    noise = spread.of_encoder_noise(seats, NOISE)
    dh = spread.of_stated_uncertainty(seats, DH, rng, draws)
    yield from (dh, noise)
    yield spread.of_encoder_noise(seats, "unequal encoder noise", np.exp(UNEQUAL * rng.normal(size=(FEW, len(JOINTS)))))
    yield mixed(BOTH, dh, noise, noise_sizes(noise))
    for name, effects in systematic().items():
        yield spread.of_effects(seats, name, effects, rng, draws)
    changing: dict[str, list[Effect]] = {
        "hysteresis": [JointHysteresis(joint=j) for j in JOINTS],
        "encoders that drift": [ZeroDrift(j, WARM_UP) for j in JOINTS],
        THERMAL: [ThermalExpansion()],
    }
    for name, effects in changing.items():
        yield spread.of_effects(seats, name, effects, rng, FEW, workshop, WARMTH if name == THERMAL else spread.DECADE)
    yield spread.of_local_noise(seats, CONTACT, np.ones(len(seats.q)))
    height = printed_points()[:, 2] - printed_points()[:, 2].min()
    alike = float(np.sqrt(noise.second.mean() / 3.0))  # spreads on average as much as encoder noise of size 1
    for name, relative in ((STAND, [(height / height.max()) ** power for power in POWERS]), (ODD, np.eye(len(seats.q)))):
        yield mixed(name, noise, spread.of_local_noise(seats, name, relative, alike), RATIOS)


def noise_sizes(noise: Pattern) -> Array:
    """Sizes of encoder noise that are weighed beside DH errors: (SIZES,) [rad]."""
    return np.geomspace(*noise.sizes, SIZES)


def systematic() -> dict[str, list[Effect]]:
    """Effects that depend on the posture alone."""
    gravity: list[Effect] = [BaseCompliance(), JointCompliance(joint=2), *(LinkBending(link=k) for k in TUBES)]
    return {
        ECCENTRICITY: [EncoderEccentricity(joint=j) for j in JOINTS],
        "encoder ellipticity": [EncoderEllipticity(joint=j) for j in JOINTS],
        GRAVITY: [*gravity, *(BearingTilt(joint=j) for j in JOINTS)],
        "stand tilts under the arm": [BaseCompliance()],
    }
