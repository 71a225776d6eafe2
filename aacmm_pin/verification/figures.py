"""The figures of ISO 10360-12 and ASME B89.4.22, from touches, by public descriptions of the standards: :data:`ORIGIN`.

Each evaluation gets the touches of one test, see :func:`aacmm_pin.verification.touches.read_touches`; a value needs all
of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.single_point import single_point_statistics
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.acceptance_columns import PART
from aacmm_pin.verification.spheres import LEAST, FittedSphere, fitted_sphere, minimum_circumscribed_sphere

LENGTH = ("length_id", "position", "repeat")
"""What tells one measured length from another."""
CAP = 4.0
"""Independent errors of touches that are enlarged by more than this in the diameter: 25 of
them are within about 45° of their middle then, nine within 60°."""
MOST_LISTED = 6
"""Rows that are listed one by one."""


@dataclass(frozen=True)
class Place:
    """Touches of a test: the labels that all of them have, by column, and their lines in the file."""

    labels: Mapping[str, str]
    rows: tuple[int, ...]

    @classmethod
    def of(cls, touches: pd.DataFrame) -> Place:
        """The place of these touches."""
        labels = {name: touches[name].iloc[0] for name in ("length_id", "feature", "position", "repeat")}
        shared = {name: label for name, label in labels.items() if label and (touches[name] == label).all()}
        return cls(shared, _rows(touches))

    def __str__(self) -> str:
        first, last, few = min(self.rows), max(self.rows), self.rows[:MOST_LISTED]
        text = ", ".join([*map(str, few), *["…"] * (len(self.rows) > len(few))])
        if len(self.rows) > 2 and last - first + 1 == len(self.rows):
            text = f"{first} to {last}"
        return f"{', '.join([_named(self.labels), ''] if self.labels else [''])}row{'s' * (len(self.rows) > 1)} {text}"


def _named(labels: Mapping[str, str]) -> str:
    return ", ".join(f"{name.removesuffix('_id')} {label}" for name, label in labels.items())


def _rows(touches: pd.DataFrame) -> tuple[int, ...]:
    return tuple(touches["row"].tolist())


@dataclass(frozen=True)
class Evaluated:
    """One figure's value and its standard uncertainty [m], how many of what it had, and how many are missing.

    ``value`` is nan where something is missing; ``u`` is nan where none is stated, or none belongs to the figure. ``errors``
    (n, 2) are all of which it is the largest, each with its own u, and ``rows`` the lines of the touches of each, where it
    comes from some. ``lacking`` names what was begun, or is elsewhere, and is missing here.
    """

    value: float
    u: float
    had: int
    missing: int
    why_incomplete: str = ""
    errors: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: tuple[tuple[int, ...], ...] = ()
    lacking: tuple[str, ...] = ()


@dataclass(frozen=True)
class Definition:
    """A figure.

    Attributes:
        name: its name.
        standard: where it is from, without an edition: see :data:`EDITIONS`.
        test_name: name of the test there.
        test: the test as files of touches name it.
        text: what the figure is.
        evaluate: works it out from the touches of the test.
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


def points_of(touches: pd.DataFrame) -> Array:
    """Their coordinates (n, 3) [m]."""
    return touches[["x", "y", "z"]].to_numpy()


def _groups(touches: pd.DataFrame, *by: str) -> list[pd.DataFrame]:
    return [group for _, group in touches.groupby(list(by), sort=False)]


def _short(sizes: Iterable[int], each: int, count: int) -> int:
    """How many are missing until ``count`` groups, and every one that was begun, have ``each``."""
    sizes = [*sizes]
    return sum(max(each - size, 0) for size in [*sizes, *[0] * (count - len(sizes))])


def _begun(groups: Iterable[pd.DataFrame], each: int) -> tuple[str, ...]:
    """The names of groups with fewer touches than ``each``."""
    return tuple(_named(Place.of(group).labels) for group in groups if len(group) < each)


def _without(had: int, missing: int, lacking: Sequence[str] = (), why: str = "") -> Evaluated:
    return Evaluated(np.nan, np.nan, had, missing, why, lacking=tuple(lacking))


def _worst(values: Sequence[float], u: Sequence[float], had: int, rows: Iterable[tuple[int, ...]] = ()) -> Evaluated:
    """The value of largest magnitude, with its u."""
    worst = int(np.abs(values).argmax())
    return Evaluated(float(values[worst]), float(u[worst]), had, 0, "", np.column_stack([values, u]), tuple(rows))


def _of_spheres(touches: pd.DataFrame, by: Sequence[str], each: int, count: int, size: bool) -> Evaluated:
    """The worst diameter error, or form, of the spheres that ``by`` tells apart."""
    groups = _groups(touches, *by)
    if missing := _short(map(len, groups), each, count):
        return _without(len(touches), missing, _begun(groups, each))
    spheres = [_sphere(group) for group in groups]
    if max(sphere.diameter_factor for sphere in spheres) > CAP:
        return _without(len(touches), 0, why="touches farther round")
    if not size:
        return _worst([s.form for s in spheres], [np.nan] * len(groups), len(touches), map(_rows, groups))
    errors, stated = [*map(size_error, groups, spheres)], [group["u_length"].iloc[0] for group in groups]
    return _worst(errors, stated, len(touches), map(_rows, groups))


def size_error(touches: pd.DataFrame, sphere: FittedSphere) -> float:
    """How much larger the sphere through some touches is than the calibrated one and the probe [m]."""
    return float(sphere.diameter - touches["feature_diameter"].iloc[0] - touches["probe_diameter"].iloc[0])


def _sphere(touches: pd.DataFrame) -> FittedSphere:
    try:
        return fitted_sphere(points_of(touches))
    except AacmmError as error:
        rows = ", ".join(map(str, touches["row"].head(6)))
        raise AacmmError(f"feature {touches['feature'].iloc[0]}, row {rows}, …: {error}") from None


def _location(touches: pd.DataFrame) -> Evaluated:
    whole = _groups(touches, "feature", "position")
    places = [_groups(place, "repeat") for place in whole]
    if missing := sum(_short(map(len, place), 5, 5) for place in places) if places else 25:
        return _without(len(touches), missing, [name for place in places for name in _begun(place, 5)])
    found = [minimum_circumscribed_sphere(np.array([_sphere(g).center for g in place]))[1] for place in places]
    return _worst(found, [np.nan] * len(found), len(touches), map(_rows, whole))


def measured_lengths(touches: pd.DataFrame, both_sides: bool) -> pd.DataFrame:
    """The lengths of which both ends were touched: labels, calibrated length, its u, error [m], and rows of touches."""
    labels, at = [*LENGTH], ["x", "y", "z"]
    ends = touches.groupby([*labels, "feature"], sort=False)
    sizes = ends.size()
    _check_ends(touches, sizes.reset_index(name="touches"))
    centers = touches.drop_duplicates([*labels, "feature"]).set_index([*labels, "feature"])[at].astype(np.float64)
    for end in sizes.index[sizes > 1]:
        centers.loc[end, at] = _sphere(ends.get_group(end)).center
    of_lengths = centers.groupby(level=labels, sort=False)
    both = of_lengths.size() == 2
    stated = touches.drop_duplicates(labels).set_index(labels)[["length", "u_length", "probe_diameter"]][both.to_numpy()]
    apart = (of_lengths.last() - of_lengths.first())[both].to_numpy()
    probe = stated["probe_diameter"] if both_sides else 0.0
    errors = np.linalg.norm(apart, axis=1) - stated["length"] - probe
    row, where = touches["row"].to_numpy(), touches.groupby(labels, sort=False).indices
    rows = pd.Series([tuple(row[where[length]].tolist()) for length in stated.index], stated.index)
    return stated.rename(columns={"u_length": "u"}).assign(error=errors, rows=rows).reset_index()


def _check_ends(touches: pd.DataFrame, ends: pd.DataFrame) -> None:
    """Two features at most of each length, with one touch each or with enough for a sphere."""
    labels = [*LENGTH]
    bad = ends["touches"].between(2, LEAST - 1) | (ends.groupby(labels)["feature"].transform("size") > 2)
    if bad.any():
        first = ends[bad].iloc[:1][labels]
        came = ", ".join(f"{n} of {name}" for name, n in ends.merge(first, on=labels)[["feature", "touches"]].to_numpy())
        raise AacmmError(
            f"{Place.of(touches.merge(first, on=labels))}: touches "
            f"{came}; expected two features with 1 touch each, or with {LEAST} and more all over a sphere"
        )


def _check_pairs(touches: pd.DataFrame) -> None:
    """No end of a length without the other: it might be the one that does not conform."""
    for length in _groups(touches, *LENGTH):
        if length["feature"].nunique() < 2:
            raise AacmmError(f"{Place.of(length)}: only one end was touched; expected two, with the same labels")


def _length_errors(touches: pd.DataFrame, both_sides: bool) -> Evaluated:
    lengths = measured_lengths(touches, both_sides)
    of_lengths = _groups(lengths, "length_id")
    missing = 21 * max(5 - len(of_lengths), 0)
    if missing := missing + sum(_short(map(len, _groups(one, "position")), 3, 7) for one in of_lengths):
        return _without(len(lengths), missing, [*_not_there(touches, lengths)])
    _check_pairs(touches)
    return _worst([*lengths["error"]], [*lengths["u"]], len(lengths), lengths["rows"])


def _not_there(touches: pd.DataFrame, lengths: pd.DataFrame) -> Iterator[str]:
    """Which of three repeats in seven positions are not among the ``lengths``, as far as labels elsewhere tell."""
    there = {*zip(*(lengths[name] for name in LENGTH), strict=True)}
    positions, repeats = touches["position"].unique(), touches["repeat"].unique()
    begun = touches[["length_id", "position"]].drop_duplicates().itertuples(index=False, name=None)
    places = product(touches["length_id"].unique(), positions) if len(positions) <= 7 else begun
    for length, position in places:
        if sum((length, position, repeat) in there for repeat in repeats) < 3:
            for repeat in repeats:
                if (length, position, repeat) not in there:
                    yield _named(dict(zip(LENGTH, (length, position, repeat), strict=True)))


def _volumetric(touches: pd.DataFrame, rms: bool) -> Evaluated:
    lengths = measured_lengths(touches, both_sides=False)
    places = len(lengths[["length_id", "position"]].drop_duplicates())
    errors = lengths["error"].to_numpy()
    if missing := max(20 - places, 2 - lengths["length_id"].nunique(), 0):
        begun = [group for group in _groups(touches, *LENGTH) if group["feature"].nunique() < 2]
        return _without(len(errors), missing, _begun(begun, len(touches) + 1))
    _check_pairs(touches)
    if not rms:
        return _worst([*errors], [*lengths["u"]], len(errors), lengths["rows"])
    # A common error of the calibrated lengths moves the RMS by as much as itself at most.
    return _worst([2 * np.sqrt(np.mean(errors**2))], [2 * lengths["u"].max(skipna=False)], len(errors))


def _single_point(touches: pd.DataFrame, statistic: Callable[[Array], float] | None) -> Evaluated:
    """The worst statistic of a place; without one, the touch farthest from the mean of its place."""
    places = _groups(touches, "position")
    if missing := _short(map(len, places), 10, 3):
        return _without(len(touches), missing, _begun(places, 10))
    if statistic is None:
        deviations = np.concatenate([_deviations(points_of(place)) for place in places])
        rows = ((row,) for place in places for row in _rows(place))
        return _worst([*deviations], [np.nan] * len(deviations), len(touches), rows)
    return _worst([statistic(points_of(p)) for p in places], [np.nan] * len(places), len(touches), map(_rows, places))


def _single_point_part(touches: pd.DataFrame, high: bool) -> Evaluated:
    """Of the touches whose posture was predicted to be accurate, or of the others; each place needs one at least."""
    places = _groups(touches, "position")
    chosen = [((place["part"] == PART) == high).to_numpy() for place in places]
    if missing := _short(map(len, places), 10, 3) + sum(not flags.any() for flags in chosen):
        return _without(len(touches), missing, _begun(places, 10))
    pairs = [*zip(places, chosen, strict=True)]
    found = [single_point_statistics(points_of(place), flags).part for place, flags in pairs]
    return _worst(found, [np.nan] * len(found), len(touches), (_rows(place[flags]) for place, flags in pairs))


def _deviations(points: Array) -> Array:
    return np.asarray(np.linalg.norm(points - points.mean(axis=0), axis=1))


def _sigma(points: Array) -> float:
    return single_point_statistics(points).sigma


def _two_sigma(points: Array) -> float:
    return 2 * _sigma(points)


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
"""Where the points of ASME B89.4.22 stand; the standard's text rules. Touches do not say whether they did."""
STANDARDS = {"iso10360-12": ISO, "asme-b89.4.22": ASME}
"""What ``standard`` can be, and whose figures are then evaluated."""
_PLACE = ("feature", "position")
DEFINITIONS = (
    Definition(
        "P_Form.Sph.1x25", ISO, "probing form error", "sphere",
        "range of the radial distances of 25 touches from their least-squares sphere; the worse of two positions",
        partial(_of_spheres, by=_PLACE, each=25, count=2, size=False),
    ),
    Definition(
        "P_Size.Sph.1x25", ISO, "probing size error", "sphere",
        "diameter of the least-squares sphere of 25 touches minus the calibrated one; the worse of two positions",
        partial(_of_spheres, by=_PLACE, each=25, count=2, size=True),
    ),
    Definition(
        "L_Dia.5x5", ISO, "articulated location error", "location",
        "diameter of the smallest sphere round the centres of one sphere by five touches in each of five articulations",
        _location,
    ),
    Definition(
        "E_Uni", ISO, "unidirectional length measurement error", "length-uni",
        "largest error of five lengths, each in seven positions three times",
        partial(_length_errors, both_sides=False), "lengths",
    ),
    Definition(
        "E_Bi", ISO, "bidirectional length measurement error", "length-bi",
        "largest error of five lengths touched from opposite sides, each in seven positions three times",
        partial(_length_errors, both_sides=True), "lengths",
    ),
    Definition(
        "EffectiveDiameter", ASME, "effective diameter performance test", "effective-diameter",
        "largest error of the diameter of a sphere touched nine times, in three repeats",
        partial(_of_spheres, by=(*_PLACE, "repeat"), each=9, count=3, size=True),
    ),
    Definition(
        "SPAT.Max", ASME, "single-point articulation performance test", "single-point",
        f"largest distance of a touch from the mean of one point in ten articulations; worst of three distances, {ZONES}",
        partial(_single_point, statistic=None),
    ),
    Definition(
        "SPAT.2s", ASME, "single-point articulation performance test", "single-point",
        f"twice the standard deviation of one point in ten articulations; worst of three distances, {ZONES}",
        partial(_single_point, statistic=_two_sigma),
    ),
    Definition(
        "Volumetric.Max", ASME, "volumetric performance test", "volumetric",
        "largest error of two calibrated lengths in twenty positions",
        partial(_volumetric, rms=False), "lengths",
    ),
    Definition(
        "Volumetric.2RMS", ASME, "volumetric performance test", "volumetric",
        "twice the root mean square error of two calibrated lengths in twenty positions",
        partial(_volumetric, rms=True), "lengths",
    ),
    Definition(
        "SinglePoint.Sigma", PAPER, "single point, eqs. 16 and 17", "single-point",
        "standard deviation of the position of one point in ten articulations; the worst of three distances",
        partial(_single_point, statistic=_sigma),
    ),
    Definition(
        "SinglePoint.Part", PAPER, "single point, eqs. 18 and 19", "single-point",
        "RMS distance from the mean of all touches, of those in postures predicted to be accurate; the worst distance",
        partial(_single_point_part, high=True), column="part",
    ),
    Definition(
        "SinglePoint.Rest", PAPER, "single point, eqs. 18 and 19", "single-point",
        "the same of the other touches",
        partial(_single_point_part, high=False), column="part",
    ),
)  # fmt: skip


def definitions(standard: str | None) -> list[Definition]:
    """The figures of a standard; of all where none is named.

    Raises:
        UnknownNameError: no such standard.
    """
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    return [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
