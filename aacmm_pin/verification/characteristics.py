"""Characteristics of ISO 10360-12 and ASME B89.4.22, by public descriptions.

Nobody compared them with the standards; every verdict states this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import pandas as pd

from aacmm_pin._support.notes import Note
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.verification.evaluators import (
    POSITIONS,
    REPEATS,
    SPHERE,
    Evaluated,
    Needed,
    OfLengths,
    OfPoints,
    deviation_of_part,
    distances_from_mean,
    errors_of_lengths,
    form_of_sphere,
    has_part,
    lengths_not_measured,
    lengths_with_one_end,
    missing_places,
    size_of_sphere,
    spread_of_centres,
    standard_deviation,
    twice_rms_of_lengths,
)

ISO = "ISO 10360-12"
ASME = "ASME B89.4.22"
PAPER = "Xu You et al. 2019"
EDITIONS = {ISO: "ISO 10360-12:2016", ASME: "ASME B89.4.22-2004"}
"""Of the public descriptions."""
RULE_OF = "ISO 14253-1:2013"
"""Of the decision rule."""
StandardName = Literal["iso10360-12", "asme-b89.4.22"]
STANDARDS: dict[str, str] = {"iso10360-12": ISO, "asme-b89.4.22": ASME}


@dataclass(frozen=True)
class Definition:
    """A characteristic.

    Attributes:
        standard: without edition, see :data:`EDITIONS`.
        test_name: in the standard.
        test: in acceptance files.
        evaluate: function of the test's points.
        counted: ``probed point`` or ``length``.
        column: without cells in it, the characteristic is omitted.
    """

    name: str
    standard: str
    test_name: str
    test: str
    evaluate: Callable[[pd.DataFrame], Evaluated]
    counted: str = "probed point"
    column: str = "test"

    @property
    def text(self) -> str:
        """In words."""
        return str(Note(self.name))


UNCALIBRATED = ("P_Form", "L_Dia", "SPAT", "SinglePoint")
"""Beginnings of names without calibrated value."""
TWO_SPHERES = Needed(((SPHERE, 2),), 25)
FIVE_REPEATS = Needed(((SPHERE, 1), (("repeat",), 5)), 5)
THREE_REPEATS = Needed((((*SPHERE, "repeat"), 3),), 9)
THREE_POINTS = Needed(((("position",), 3),), 10)
FIVE_LENGTHS = Needed(((("length_id",), 5), (("position",), POSITIONS)), REPEATS)


def _of_part(accurate: bool) -> OfPoints:
    deviation = partial(deviation_of_part, accurate=accurate)
    return OfPoints(THREE_POINTS, deviation, partial(has_part, accurate=accurate))


DEFINITIONS = (
    Definition(
        "P_Form.Sph.1x25", ISO, "probing form error", "sphere",
        OfPoints(TWO_SPHERES, form_of_sphere),
    ),
    Definition(
        "P_Size.Sph.1x25", ISO, "probing size error", "sphere",
        OfPoints(TWO_SPHERES, size_of_sphere),
    ),
    Definition(
        "L_Dia.5x5", ISO, "articulated location error", "location",
        OfPoints(FIVE_REPEATS, spread_of_centres),
    ),
    Definition(
        "E_Uni", ISO, "unidirectional length measurement error", "length-uni",
        OfLengths(FIVE_LENGTHS.missing, lengths_not_measured, False, errors_of_lengths), "length",
    ),
    Definition(
        "E_Bi", ISO, "bidirectional length measurement error", "length-bi",
        OfLengths(FIVE_LENGTHS.missing, lengths_not_measured, True, errors_of_lengths), "length",
    ),
    Definition(
        "EffectiveDiameter", ASME, "effective diameter performance test", "effective-diameter",
        OfPoints(THREE_REPEATS, size_of_sphere),
    ),
    Definition(
        "SPAT.Max", ASME, "single-point articulation performance test", "single-point",
        OfPoints(THREE_POINTS, distances_from_mean),
    ),
    Definition(
        "SPAT.2s", ASME, "single-point articulation performance test", "single-point",
        OfPoints(THREE_POINTS, partial(standard_deviation, times=2)),
    ),
    Definition(
        "Volumetric.Max", ASME, "volumetric performance test", "volumetric",
        OfLengths(missing_places, lengths_with_one_end, False, errors_of_lengths), "length",
    ),
    Definition(
        "Volumetric.2RMS", ASME, "volumetric performance test", "volumetric",
        OfLengths(missing_places, lengths_with_one_end, False, twice_rms_of_lengths), "length",
    ),
    Definition(
        "SinglePoint.Sigma", PAPER, "single point (equations 16 and 17)", "single-point",
        OfPoints(THREE_POINTS, standard_deviation),
    ),
    Definition(
        "SinglePoint.Part", PAPER, "single point (equations 18 and 19)", "single-point",
        _of_part(accurate=True), column="part",
    ),
    Definition(
        "SinglePoint.Rest", PAPER, "single point (equations 18 and 19)", "single-point",
        _of_part(accurate=False), column="part",
    ),
)  # fmt: skip


def definitions(standard: str | None) -> list[Definition]:
    """Characteristics of a standard, or all.

    Raises:
        UnknownNameError: unknown standard.
    """
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    return [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
