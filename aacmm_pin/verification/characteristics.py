"""Characteristics of ISO 10360-12 and ASME B89.4.22, by public descriptions.

Nobody compared them with the standards; every verdict states this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import pandas as pd

from aacmm_pin._support.notes import Note
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.verification.evaluators import (
    Error,
    Evaluated,
    Evaluator,
    Needed,
    deviation_of_part,
    distances_from_mean,
    errors_of_lengths,
    form_of_sphere,
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
SPHERE = ("feature", "position")
TWO_SPHERES = Needed(((SPHERE, 2),), 25)
FIVE_REPEATS = Needed(((SPHERE, 1), (("repeat",), 5)), 5)
THREE_REPEATS = Needed((((*SPHERE, "repeat"), 3),), 9)
THREE_POINTS = Needed(((("position",), 3),), 10)
FIVE_LENGTHS = Needed(((("length_id",), 5), (("position",), 7)), 3)
TWENTY_PLACES = Needed(((("length_id", "position"), 20),), 1)
TWO_LENGTHS = Needed(((("length_id",), 2),), 1)


def _of_points(errors: Callable[[pd.DataFrame], Iterable[Error]], needed: Needed) -> Evaluator:
    """Of the outermost groups that are needed."""
    return Evaluator(errors, (needed,), by=needed.levels[0][0])


DEFINITIONS = (
    Definition(
        "P_Form.Sph.1x25", ISO, "probing form error", "sphere",
        _of_points(form_of_sphere, TWO_SPHERES),
    ),
    Definition(
        "P_Size.Sph.1x25", ISO, "probing size error", "sphere",
        _of_points(size_of_sphere, TWO_SPHERES),
    ),
    Definition(
        "L_Dia.5x5", ISO, "articulated location error", "location",
        _of_points(spread_of_centres, FIVE_REPEATS),
    ),
    Definition(
        "E_Uni", ISO, "unidirectional length measurement error", "length-uni",
        Evaluator(errors_of_lengths, (FIVE_LENGTHS,), both_sides=False), "length",
    ),
    Definition(
        "E_Bi", ISO, "bidirectional length measurement error", "length-bi",
        Evaluator(errors_of_lengths, (FIVE_LENGTHS,), both_sides=True), "length",
    ),
    Definition(
        "EffectiveDiameter", ASME, "effective diameter performance test", "effective-diameter",
        _of_points(size_of_sphere, THREE_REPEATS),
    ),
    Definition(
        "SPAT.Max", ASME, "single-point articulation performance test", "single-point",
        _of_points(distances_from_mean, THREE_POINTS),
    ),
    Definition(
        "SPAT.2s", ASME, "single-point articulation performance test", "single-point",
        _of_points(partial(standard_deviation, times=2), THREE_POINTS),
    ),
    Definition(
        "Volumetric.Max", ASME, "volumetric performance test", "volumetric",
        Evaluator(errors_of_lengths, (TWENTY_PLACES, TWO_LENGTHS), both_sides=False), "length",
    ),
    Definition(
        "Volumetric.2RMS", ASME, "volumetric performance test", "volumetric",
        Evaluator(twice_rms_of_lengths, (TWENTY_PLACES, TWO_LENGTHS), both_sides=False), "length",
    ),
    Definition(
        "SinglePoint.Sigma", PAPER, "single point (equations 16 and 17)", "single-point",
        _of_points(standard_deviation, THREE_POINTS),
    ),
    Definition(
        "SinglePoint.Part", PAPER, "single point (equations 18 and 19)", "single-point",
        _of_points(partial(deviation_of_part, accurate=True), THREE_POINTS), column="part",
    ),
    Definition(
        "SinglePoint.Rest", PAPER, "single point (equations 18 and 19)", "single-point",
        _of_points(partial(deviation_of_part, accurate=False), THREE_POINTS), column="part",
    ),
)  # fmt: skip


def definitions(standard: str | None) -> list[Definition]:
    """Characteristics of a standard, or all."""
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    return [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
