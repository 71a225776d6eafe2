"""Characteristics of ISO 10360-12 and ASME B89.4.22, by public descriptions.

Nobody compared them with the standards; every verdict states this.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Literal

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Note
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.verification.evaluators import (
    LENGTH_KEY,
    Error,
    Evaluated,
    Needed,
    PointsInFile,
    deviation_of_part,
    distances_from_mean,
    errors_of_lengths,
    form_of_sphere,
    groups_of,
    measured_lengths,
    named,
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
        errors: of a group of points: none without points, nan on a small cap of a sphere; or of the
            lengths between points.
        needed: points or lengths; the one that lacks most counts. Errors are of the outermost
            groups of points, or of all lengths.
        both_sides: of lengths: probed from opposite sides, which adds the probe diameter; None for
            points.
        column: without cells in it, the characteristic is omitted.
    """

    name: str
    standard: str
    test_name: str
    test: str
    errors: Callable[[pd.DataFrame], Iterable[Error]]
    needed: tuple[Needed, ...]
    both_sides: bool | None = None
    column: str = "test"

    @property
    def counted(self) -> str:
        """What the test needs a number of."""
        return "probed point" if self.both_sides is None else "length"

    @property
    def text(self) -> str:
        """In words."""
        return str(Note(self.name))

    def evaluate(self, points: pd.DataFrame) -> Evaluated:
        """Evaluate the points of the test."""
        table = points
        one_ended: list[PointsInFile] = []
        if self.both_sides is not None:
            table = measured_lengths(points, self.both_sides)
            lengths = map(PointsInFile.of, groups_of(points, LENGTH_KEY))
            one_ended = [length for length in lengths if "feature" in length.labels]
        errors: list[list[Error]] = []
        missing = max(needed.missing(table) for needed in self.needed)
        if not missing:
            outermost, _ = self.needed[0].levels[0]
            groups = groups_of(table, outermost) if self.both_sides is None else [table]
            errors = [[*self.errors(group)] for group in groups]
            missing = errors.count([])
        if missing:
            lacking = [named(length.labels) for length in one_ended]
            lacking = lacking or [*self.needed[0].begun(table)]
            return Evaluated(len(table), missing, lacking=tuple(lacking))
        if one_ended:  # the other end might not conform
            raise AacmmError(
                f"{one_ended[0]}: only one end has points; expected points of both ends with the "
                "same labels"
            )
        all_errors = tuple(chain.from_iterable(errors))
        if any(np.isnan(error.value) for error in all_errors):
            return Evaluated(len(table), why_incomplete="points all over the sphere")
        return Evaluated(len(table), errors=all_errors)


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


DEFINITIONS = (
    Definition(
        "P_Form.Sph.1x25", ISO, "probing form error", "sphere",
        form_of_sphere, (TWO_SPHERES,),
    ),
    Definition(
        "P_Size.Sph.1x25", ISO, "probing size error", "sphere",
        size_of_sphere, (TWO_SPHERES,),
    ),
    Definition(
        "L_Dia.5x5", ISO, "articulated location error", "location",
        spread_of_centres, (FIVE_REPEATS,),
    ),
    Definition(
        "E_Uni", ISO, "unidirectional length measurement error", "length-uni",
        errors_of_lengths, (FIVE_LENGTHS,), False,
    ),
    Definition(
        "E_Bi", ISO, "bidirectional length measurement error", "length-bi",
        errors_of_lengths, (FIVE_LENGTHS,), True,
    ),
    Definition(
        "EffectiveDiameter", ASME, "effective diameter performance test", "effective-diameter",
        size_of_sphere, (THREE_REPEATS,),
    ),
    Definition(
        "SPAT.Max", ASME, "single-point articulation performance test", "single-point",
        distances_from_mean, (THREE_POINTS,),
    ),
    Definition(
        "SPAT.2s", ASME, "single-point articulation performance test", "single-point",
        partial(standard_deviation, times=2), (THREE_POINTS,),
    ),
    Definition(
        "Volumetric.Max", ASME, "volumetric performance test", "volumetric",
        errors_of_lengths, (TWENTY_PLACES, TWO_LENGTHS), False,
    ),
    Definition(
        "Volumetric.2RMS", ASME, "volumetric performance test", "volumetric",
        twice_rms_of_lengths, (TWENTY_PLACES, TWO_LENGTHS), False,
    ),
    Definition(
        "SinglePoint.Sigma", PAPER, "single point (equations 16 and 17)", "single-point",
        standard_deviation, (THREE_POINTS,),
    ),
    Definition(
        "SinglePoint.Part", PAPER, "single point (equations 18 and 19)", "single-point",
        partial(deviation_of_part, accurate=True), (THREE_POINTS,), column="part",
    ),
    Definition(
        "SinglePoint.Rest", PAPER, "single point (equations 18 and 19)", "single-point",
        partial(deviation_of_part, accurate=False), (THREE_POINTS,), column="part",
    ),
)  # fmt: skip


def definitions(standard: str | None) -> list[Definition]:
    """Characteristics of a standard, or all."""
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    return [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
