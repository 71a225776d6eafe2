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
from aacmm_pin.papers.spread import (
    Pattern,
    TouchedSeats,
    mixed,
    of_effects,
    of_encoder_noise,
    of_local_noise,
    of_stated_uncertainty,
)
from aacmm_pin.papers.spread.causes import DrawConditions

DH, NOISE, BOTH, ODD, STAND = (
    "DH errors",
    "encoder noise",
    "DH errors + encoder noise",
    "encoder noise + one odd seat",
    "encoder noise + stand that yields with height",
)
ECCENTRICITY, GRAVITY, THERMAL = "encoder eccentricity", "gravity (bearings, tubes, stand)", "thermal expansion"
CONTACT = "contact noise"
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
JOINTS = range(1, 7)
TUBES = (3, 5)


def patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000, progress: bool = False) -> dict[str, Pattern]:
    """Every cause that is weighed, by its name."""
    with watched(_patterns(seats, rng, draws), progress, "patterns", "cause") as found:
        return {pattern.name: pattern for pattern in found}


def _patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int) -> Iterator[Pattern]:
    noise = of_encoder_noise(seats, NOISE)
    dh = of_stated_uncertainty(seats, DH, rng, draws)
    yield from (dh, noise)
    yield of_encoder_noise(seats, "unequal encoder noise", np.exp(UNEQUAL * rng.normal(size=(FEW, len(JOINTS)))))
    yield with_stated_uncertainty(dh, noise)[0]
    for name, effects in systematic().items():
        yield of_effects(seats, name, effects, rng, draws)
    yield of_effects(seats, "hysteresis", [JointHysteresis(joint=j) for j in JOINTS], rng, FEW, _workshop(seats))
    yield of_effects(seats, "encoders that drift", [ZeroDrift(j, WARM_UP) for j in JOINTS], rng, FEW, _workshop(seats))
    yield of_effects(seats, THERMAL, [ThermalExpansion()], rng, FEW, _workshop(seats)).of_sizes(*WARMTH)
    yield of_local_noise(seats, CONTACT, np.ones(len(seats.labels)))
    yield mixed(STAND, noise, _beside(seats, noise, yields_with_height()), RATIOS)
    yield mixed(ODD, noise, _beside(seats, noise, np.eye(len(seats.labels))), RATIOS)


def systematic() -> dict[str, list[Effect]]:
    """Effects that depend on the posture alone."""
    gravity: list[Effect] = [BaseCompliance(), JointCompliance(joint=2), *(LinkBending(link=k) for k in TUBES)]
    return {
        ECCENTRICITY: [EncoderEccentricity(joint=j) for j in JOINTS],
        "encoder ellipticity": [EncoderEllipticity(joint=j) for j in JOINTS],
        GRAVITY: [*gravity, *(BearingTilt(joint=j) for j in JOINTS)],
        "stand tilts under the arm": [BaseCompliance()],
    }


def with_stated_uncertainty(dh: Pattern, noise: Pattern) -> tuple[Pattern, Array]:
    """DH errors within their half-widths beside encoder noise of every size thought possible, and that size of each draw."""
    sizes = np.geomspace(*noise.sizes, SIZES)
    return mixed(BOTH, dh, noise, sizes), np.repeat(sizes, len(dh.second))


def yields_with_height() -> Array:
    """Local noise by powers of the height above the lowest seat, 1 at the highest: (powers, seats)."""
    height = printed_points()[:, 2] - printed_points()[:, 2].min()
    return np.stack([(height / height.max()) ** power for power in POWERS])


def _beside(seats: TouchedSeats, noise: Pattern, relative: Array) -> Pattern:
    """Local noise that, where ``relative`` is 1, spreads on average as much as encoder noise of size 1."""
    one = float(np.sqrt(noise.second.mean() / 3.0))
    return of_local_noise(seats, "local noise", relative, one)


def _workshop(seats: TouchedSeats) -> DrawConditions:
    """Conditions of an ordinary session: seat after seat, the postures of each in random order."""
    seat_of = np.repeat(np.arange(len(seats.q)), [len(q) for q in seats.q])

    def drawn(rng: np.random.Generator) -> Conditions:
        order = np.lexsort((rng.random(len(seat_of)), seat_of))
        taken = workshop_conditions(
            np.zeros(len(order), dtype=np.intp),
            seats.all_q[order],
            rng=rng,
            reference_temperature=seats.model.arm.reference_temperature,
            temperature_range=TEMPERATURE_RANGE,
        )
        return taken.take(np.argsort(order))

    return drawn
