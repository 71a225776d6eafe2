"""The characteristics of ISO 10360-12 and ASME B89.4.22 that a test has values of, by public descriptions of the standards.

The definitions were never compared with the standards' texts: :data:`ORIGIN` stands where a verdict is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

from aacmm_pin.errors import UnknownNameError
from aacmm_pin.verification.evaluators import (
    POSITIONS,
    REPEATS,
    SPHERE,
    Evaluated,
    Needed,
    OfLengths,
    OfPoints,
    deviation_of_accurate,
    deviation_of_others,
    distances_from_mean,
    errors_of_lengths,
    form_of_sphere,
    has_accurate,
    has_others,
    lengths_not_measured,
    lengths_with_one_end,
    missing_places,
    size_of_sphere,
    spread_of_centres,
    standard_deviation,
    twice_rms_of_lengths,
    twice_standard_deviation,
)

ISO, ASME, PAPER = "ISO 10360-12", "ASME B89.4.22", "Xu You et al. 2019"
EDITIONS = {ISO: "ISO 10360-12:2016", ASME: "ASME B89.4.22-2004"}
"""The editions that the public descriptions are of."""
RULE_OF = "ISO 14253-1:2013"
"""The edition that the decision rule is of."""
ORIGIN = (
    f"Definitions and decision rule come from public descriptions of {', '.join(EDITIONS.values())} and {RULE_OF}. They "
    "were never compared with the standards' texts; compare them before a contract depends on a verdict."
)
"""Stands first where a test is planned, predicted or judged."""
ZONES = "0 to 20, 20 to 80 and 80 to 100 % of the reach by public descriptions"
"""Where the points of ASME B89.4.22 stand; the standard's text rules. A file does not state whether they did."""
STANDARDS = {"iso10360-12": ISO, "asme-b89.4.22": ASME}
"""What ``standard`` can be, and whose characteristics are then evaluated."""


@dataclass(frozen=True)
class Definition:
    """A characteristic.

    Attributes:
        name: its name.
        standard: where it is from, without an edition: see :data:`EDITIONS`.
        test_name: name of the test there.
        test: the test as acceptance files name it.
        text: what the characteristic is.
        evaluate: works its test value out from the probed points of the test.
        counted: what is counted, ``touches`` or ``lengths``.
        column: the column without which it is left out; "" for none.
    """

    name: str
    standard: str
    test_name: str
    test: str
    text: str
    evaluate: Callable[[pd.DataFrame], Evaluated]
    counted: str = "touches"
    column: str = ""


TWO_SPHERES = Needed(((SPHERE, 2),), 25)
FIVE_REPEATS = Needed(((SPHERE, 1), (("repeat",), 5)), 5)
THREE_REPEATS = Needed((((*SPHERE, "repeat"), 3),), 9)
THREE_POINTS = Needed(((("position",), 3),), 10)
FIVE_LENGTHS = Needed(((("length_id",), 5), (("position",), POSITIONS)), REPEATS)

DEFINITIONS = (
    Definition(
        "P_Form.Sph.1x25", ISO, "probing form error", "sphere",
        "range of the radial distances of 25 touches from their least-squares sphere; the worse of two positions",
        OfPoints(TWO_SPHERES, form_of_sphere),
    ),
    Definition(
        "P_Size.Sph.1x25", ISO, "probing size error", "sphere",
        "diameter of the least-squares sphere of 25 touches minus the calibrated one; the worse of two positions",
        OfPoints(TWO_SPHERES, size_of_sphere),
    ),
    Definition(
        "L_Dia.5x5", ISO, "articulated location error", "location",
        "diameter of the smallest sphere round the centres of one sphere by five touches in each of five articulations",
        OfPoints(FIVE_REPEATS, spread_of_centres),
    ),
    Definition(
        "E_Uni", ISO, "unidirectional length measurement error", "length-uni",
        "largest error of five lengths, each in seven positions three times",
        OfLengths(FIVE_LENGTHS.missing, lengths_not_measured, False, errors_of_lengths), "lengths",
    ),
    Definition(
        "E_Bi", ISO, "bidirectional length measurement error", "length-bi",
        "largest error of five lengths touched from opposite sides, each in seven positions three times",
        OfLengths(FIVE_LENGTHS.missing, lengths_not_measured, True, errors_of_lengths), "lengths",
    ),
    Definition(
        "EffectiveDiameter", ASME, "effective diameter performance test", "effective-diameter",
        "largest error of the diameter of a sphere touched nine times, in three repeats",
        OfPoints(THREE_REPEATS, size_of_sphere),
    ),
    Definition(
        "SPAT.Max", ASME, "single-point articulation performance test", "single-point",
        f"largest distance of a touch from the mean of one point in ten articulations; worst of three distances, {ZONES}",
        OfPoints(THREE_POINTS, distances_from_mean),
    ),
    Definition(
        "SPAT.2s", ASME, "single-point articulation performance test", "single-point",
        f"twice the standard deviation of one point in ten articulations; worst of three distances, {ZONES}",
        OfPoints(THREE_POINTS, twice_standard_deviation),
    ),
    Definition(
        "Volumetric.Max", ASME, "volumetric performance test", "volumetric",
        "largest error of two calibrated lengths in twenty positions",
        OfLengths(missing_places, lengths_with_one_end, False, errors_of_lengths), "lengths",
    ),
    Definition(
        "Volumetric.2RMS", ASME, "volumetric performance test", "volumetric",
        "twice the root mean square error of two calibrated lengths in twenty positions",
        OfLengths(missing_places, lengths_with_one_end, False, twice_rms_of_lengths), "lengths",
    ),
    Definition(
        "SinglePoint.Sigma", PAPER, "single point, eqs. 16 and 17", "single-point",
        "standard deviation of the position of one point in ten articulations; the worst of three distances",
        OfPoints(THREE_POINTS, standard_deviation),
    ),
    Definition(
        "SinglePoint.Part", PAPER, "single point, eqs. 18 and 19", "single-point",
        "RMS distance from the mean of all touches, of those in postures predicted to be accurate; the worst distance",
        OfPoints(THREE_POINTS, deviation_of_accurate, has_accurate), column="part",
    ),
    Definition(
        "SinglePoint.Rest", PAPER, "single point, eqs. 18 and 19", "single-point",
        "the same of the other touches",
        OfPoints(THREE_POINTS, deviation_of_others, has_others), column="part",
    ),
)  # fmt: skip


def definitions(standard: str | None) -> list[Definition]:
    """The characteristics of a standard; of all where none is named.

    Raises:
        UnknownNameError: no such standard.
    """
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    return [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
