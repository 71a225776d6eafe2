"""What residuals may depend on in a way that no cause of the library has, and where it may act."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.shared_exclusions import MOST_LABELS, as_numbers
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.encoder import LEAST_SPREAD
from aacmm_pin.measurements.records import Measurements

FEWEST_GROUPS = 3
"""With fewer groups than this nobody can say which one is the odd one out."""
FEWEST_RECORDS = 3
"""A group has more records than this, or its own shift explains them whatever they are."""
SMOOTH = (5, 20)
"""Numbers of cosines over the ranks of a covariate: a slow change; one with many turns, where it may shift the tip."""
LATER = 3
"""Number of cosines over the ranks of the time with which an error of a joint changes."""
SLOPES = 2
"""Powers of the time since the middle of a session with which the tip may shift inside it."""
CENTRES = 24
"""So many places at most in the room round which a field may have its own shift …"""
NARROWEST = 0.1
"""… and it does not change within this distance [m]."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Smooth functions of a covariate, and what they act on.

    Attributes:
        functions: (n, m), root mean square one, the constant first: whatever depends on something also has a mean.
        carrier: ``room`` (the tip shifts along the axes of the reference frame), ``target`` (along those of the last body),
            ``before j`` (along those of the body before row j), ``angle j`` (the angle of row j; ``slide j`` where it
            slides), ``lengths`` (all lengths grow).
    """

    functions: Array
    carrier: str

    @property
    def acts_on(self) -> str:
        """The carrier in words."""
        what, _, row = self.carrier.partition(" ")
        words = {
            "room": "the tip shifts in the room",
            "target": "the target sits elsewhere on the last body",
            "before": f"the tip shifts along the body before joint {row}",
            "angle": f"the angle of joint {row} is off",
            "slide": f"the position of joint {row} is off",
            "lengths": "all lengths grow",
        }
        return words[what]

    @property
    def quantities(self) -> dict[str, float]:
        """What it changes: names with unit, and how many SI units one of them is."""
        what, _, row = self.carrier.partition(" ")
        if what in ("angle", "slide"):
            return {f"delta{row}_{'urad' if what == 'angle' else 'um'}": 1e-6}
        return {"growth_um_per_m": 1e-6} if what == "lengths" else dict.fromkeys(("x_mm", "y_mm", "z_mm"), MM)


@dataclass(frozen=True, eq=False)
class Covariate:
    """Something that residuals may depend on.

    Attributes:
        name: ``joint 4``, ``joint 2 × joint 4``, ``time``, ``temperature``, ``place``, ``bar left``, or an unknown column.
        depends_on: the single covariates in it: ``joint 2``, ``time``, ``x``, …
        variants: ways in which it may act.
        values: the covariates themselves, n rows; a column of numbers has its unit in its name, others are labels.
    """

    name: str
    depends_on: tuple[str, ...]
    variants: tuple[Carried, ...]
    values: pd.DataFrame


def covariates(arm: Arm, measurements: Measurements) -> list[Covariate]:
    """Everything known of the records that residuals may depend on."""
    conditions = measurements.conditions
    rows = [place // 2 for place in arm.chain.moving_axes()]
    angles = [f"angle {row}" for row in rows]
    numbers = [(j, row) for j, row in enumerate(rows) if np.ptp(measurements.q[:, j]) > LEAST_SPREAD]
    found = [_of(f"joint {row}", measurements.q[:, j], [f"before {row}"]) for j, row in numbers]
    named: list[tuple[str, Iterable[object], list[str]]] = [
        (name, known, ["room", *angles, "lengths"])
        for name in ("time", "temperature", "session")
        if (known := getattr(conditions, name)) is not None
    ]
    if conditions.torque is not None:
        named += [(f"torque {row}", conditions.torque[:, j], ["room", *angles]) for j, row in enumerate(rows)]
    if measurements.operator is not None:
        named.append(("operator", measurements.operator, ["room", *angles]))
    named += [(str(name), measurements.extra[name], ["room", *angles, "lengths"]) for name in measurements.extra]
    found += [_of(name, values, carriers) for name, values, carriers in named]
    products = [_product(measurements.q, one, other) for one, other in itertools.combinations(numbers, 2)]
    if conditions.time is not None and np.ptp(conditions.time) > 0.0:
        products += [_over_time(measurements.q[:, j], row, conditions.time) for j, row in numbers]
    single = [_with_time(c, conditions) for c in found if c is not None]
    sliding = [row for row, slides in zip(rows, arm.chain.prismatic, strict=True) if slides]
    of_joints = [_along(covariate, sliding) for covariate in (*single, *products)]
    return [*of_joints, _place(arm, measurements), _scale(arm, measurements), *_groups(measurements)]


def _of(name: str, values: Iterable[object], carriers: Sequence[str]) -> Covariate | None:
    """A column of numbers or labels that may act on each of the carriers."""
    if (numbers := as_numbers(values)) is not None:
        slow, quick = (_cosines(numbers, count) for count in SMOOTH)
        variants = [Carried(slow, carrier) for carrier in carriers]
        if carriers[0] == "room" and len(numbers) > 3 * SMOOTH[1]:
            variants.append(Carried(quick, "room"))
        return Covariate(name, (name,), tuple(variants), _table(name, numbers.to_numpy(dtype=np.float64)))
    labels = pd.Series(values).astype(str)
    if not 2 <= labels.nunique() <= MOST_LABELS:
        return None
    dummies = _of_size_one(pd.get_dummies(labels, dtype=float).to_numpy())
    return Covariate(
        name, (name,), tuple(Carried(dummies, carrier) for carrier in carriers), _table(name, labels.to_numpy())
    )


def _along(covariate: Covariate, sliding: Sequence[int]) -> Covariate:
    """The covariate with the positions of joints that slide, and errors of these, as such."""
    values, variants = covariate.values, covariate.variants
    for row in sliding:
        if (name := f"theta{row}_deg") in values and pd.api.types.is_numeric_dtype(values[name]):
            values = values.assign(**{name: values[name] * (DEG / MM)}).rename(columns={name: f"joint{row}_mm"})
        variants = tuple(replace(v, carrier=f"slide {row}") if v.carrier == f"angle {row}" else v for v in variants)
    return replace(covariate, values=values, variants=variants)


UNITS = {"time": ("time_s", 1.0), "temperature": ("temperature_c", 1.0)}


def _table(name: str, values: NDArray[Any]) -> pd.DataFrame:
    """The covariate as a column with its unit in its name."""
    what, _, row = name.partition(" ")
    column, unit = (f"theta{row}_deg", DEG) if what == "joint" else UNITS.get(name, (name, 1.0))
    return pd.DataFrame({column: values / unit if np.issubdtype(values.dtype, np.number) else values})


def _with_time(covariate: Covariate, conditions: Conditions) -> Covariate:
    """Sessions and time belong together: time may go on anew in each session, and one session is later than the other."""
    session, time = conditions.session, conditions.time
    if session is None or time is None or covariate.name not in ("time", "session"):
        return covariate
    if covariate.name == "session":
        return replace(covariate, depends_on=("session", "time"))
    inside = pd.get_dummies(pd.Series(session), dtype=float).to_numpy()
    if not 2 <= inside.shape[1] <= MOST_LABELS:
        return covariate
    since = time[:, None] - (inside * time[:, None]).sum(axis=0) / inside.sum(axis=0)
    powers = [inside * (since / max(np.ptp(time), 1e-9)) ** k for k in range(1 + SLOPES)]
    return replace(covariate, variants=(*covariate.variants, Carried(_of_size_one(np.hstack(powers)), "room")))


def _cosines(numbers: pd.Series, count: int) -> Array:
    turned = np.pi * (numbers.rank(method="average").to_numpy() - 0.5) / len(numbers)
    return _of_size_one(np.cos(np.arange(count + 1) * turned[:, None]))


def _product(q: Array, one: tuple[int, int], other: tuple[int, int]) -> Covariate:
    """The angle of one of two joints depends on where both stand."""
    (j, row), (k, further) = one, other
    wave = [np.stack([np.ones(len(q)), np.cos(q[:, n]), np.sin(q[:, n])], axis=1) for n in (j, k)]
    whole = _of_size_one(np.einsum("na,nb->nab", *wave).reshape(len(q), -1)[:, 1:])
    variants = [Carried(whole, f"angle {at}") for at in (row, further)]
    names = (f"joint {row}", f"joint {further}")
    return Covariate(" × ".join(names), names, tuple(variants), _table(names[0], q[:, j]).join(_table(names[1], q[:, k])))


def _over_time(angle: Array, row: int, time: Array) -> Covariate:
    """The angle of a joint is off by where it stands, and otherwise later: an encoder that was knocked midway."""
    wave, later = np.stack([np.cos(angle), np.sin(angle)], axis=1), _cosines(pd.Series(time), LATER)
    variant = Carried(_of_size_one(np.einsum("na,nb->nab", wave, later).reshape(len(angle), -1)), f"angle {row}")
    values = _table(f"joint {row}", angle).join(_table("time", time))
    return Covariate(f"joint {row} × time", (f"joint {row}", "time"), (variant,), values)


def _place(arm: Arm, measurements: Measurements) -> Covariate:
    """Where the tip is: a field of shifts in the room, as a table that bends or a tracker's own error would give."""
    tip = arm.chain.walk(measurements.q)[1][-1]
    apart = len(np.unique(np.round(tip / NARROWEST), axis=0))
    count = int(np.clip(apart // 2, 1, CENTRES))
    centres, nearest = scipy.cluster.vq.kmeans2(tip, count, minit="++", rng=np.random.default_rng(count))
    width = max(1.5 * float(np.sqrt(np.square(tip - centres[nearest]).sum(axis=1).mean())), NARROWEST)
    distance = np.linalg.norm(tip[:, None] - centres, axis=2)
    values = pd.DataFrame(tip / MM, columns=["tip_x_mm", "tip_y_mm", "tip_z_mm"])
    bumps = np.exp(-0.5 * (distance / width) ** 2)
    return Covariate("place", ("x", "y", "z"), (Carried(_of_size_one(bumps), "room"),), values)


def _scale(arm: Arm, measurements: Measurements) -> Covariate:
    """All lengths are too long or too short by one factor: a wrong unit, another reference temperature."""
    tip = arm.chain.walk(measurements.q)[1][-1]
    values = pd.DataFrame({"distance_mm": np.linalg.norm(tip, axis=1) / MM})
    return Covariate("scale", ("scale",), (Carried(np.ones((len(tip), 1)), "lengths"),), values)


def _groups(measurements: Measurements) -> list[Covariate]:
    """One group of records, a bar or else a seat of unknown place, in which the target sat elsewhere on the arm."""
    labels = measurements.bar if measurements.bar is not None else measurements.conditions.seat
    what = "bar" if measurements.bar is not None else "seat"
    if labels is None or measurements.known.any():
        return []
    names = [name for name in dict.fromkeys(labels) if name and np.sum(labels == name) > FEWEST_RECORDS]
    if len(names) < FEWEST_GROUPS:
        return []
    inside = [(f"{what} {name}", (labels == name).astype(np.float64)[:, None]) for name in names]
    column = pd.DataFrame({what: labels})
    return [Covariate(name, (name,), (Carried(_of_size_one(mine), "target"),), column) for name, mine in inside]


def _of_size_one(functions: Array) -> Array:
    return np.asarray(functions / np.sqrt(np.maximum(np.square(functions).mean(axis=0), 1e-12)))
