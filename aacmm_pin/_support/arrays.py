"""Arrays: their types, checks of shape and numbers, long batches in parts, products, angles."""

from __future__ import annotations

import operator
import reprlib

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support import plausible
from aacmm_pin.errors import AacmmError, ShapeError

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
RANGES = {
    "m": plausible.COORDINATE,
    "rad": plausible.READING,
    "s": plausible.CLOCK,
    "°C": plausible.TEMPERATURE,
    "N·m": plausible.TORQUE,
}
"""Possible numbers of each unit."""
MOST_LENGTH_ERROR = 2e-3
"""Of a unit vector or quaternion: four numbers with three decimals give at most 1e-3."""


def batch(values: ArrayLike, columns: int, name: str, unit: str) -> Array:
    """The ``values`` as floats (n, columns).

    Raises:
        ShapeError: wrong shape, not numbers, not finite, or too large.
    """
    array = _floats(values, name)
    if array.ndim == 1 and array.size == columns:
        raise ShapeError(
            f"{name} has shape {array.shape}; expected (n, {columns}) [{unit}], one row per "
            f"record; for one record pass {name}[None, :]"
        )
    if array.ndim != 2 or array.shape[1] != columns:
        raise ShapeError(f"{name} has shape {array.shape}; expected (n, {columns}) [{unit}]")
    _check_plausible(array, name, unit)
    return array


def vector(values: ArrayLike, length: int, name: str, unit: str) -> Array:
    """The ``values`` as floats (length,).

    Raises:
        ShapeError: see :func:`batch`.
    """
    array = _floats(values, name)
    if array.shape != (length,):
        raise ShapeError(f"{name} has shape {array.shape}; expected ({length},) [{unit}]")
    _check_plausible(array, name, unit)
    return array


def width_of(values: ArrayLike) -> int:
    """Number of columns."""
    shape = (
        values.shape if isinstance(values, np.ndarray) else np.asarray(values, dtype=object).shape
    )
    return int(shape[-1]) if shape else 1


def unit_vector(values: ArrayLike, name: str) -> Array:
    """The ``values`` (3,) at length 1.

    Raises:
        ShapeError: see :func:`batch`.
        AacmmError: of length zero.
    """
    direction = vector(values, 3, name, "1")
    largest = float(np.abs(direction).max())
    if largest == 0:
        raise AacmmError(f"{name} is [0, 0, 0]; expected a direction, not all zeros")
    direction = direction / largest  # the square of a tiny length would be zero
    return direction / np.linalg.norm(direction)


def is_no_unit(length: Array) -> Mask:
    """Lengths that differ from 1 by more than rounding; not NaN."""
    return np.asarray(np.abs(length - 1.0) > MOST_LENGTH_ERROR)


def whole(value: object, least: int, name: str) -> int:
    """Return ``value`` as an int.

    Raises:
        AacmmError: not whole, below ``least``, or above :data:`plausible.LARGEST_COUNTS` of this
            name.
    """
    argument = name.partition(" ")[0]
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise AacmmError(f"{argument} is {value!r}; expected a whole number") from None
    if number < least:
        raise AacmmError(f"{argument} is {number}; expected at least {least}")
    most, cost = plausible.LARGEST_COUNTS[name]
    if number > most:
        came = f"{argument} is {reprlib.repr(number)}"
        raise AacmmError(f"{came}; expected at most {most}, which need about {cost}")
    return number


def _floats(values: ArrayLike, name: str) -> Array:
    """A copy; refuses text, booleans, complex numbers, masks."""
    try:
        array = np.array(values)
    except ValueError as error:
        raise ShapeError(f"{name}: {error}; expected an array of numbers") from None
    if array.dtype.kind not in "iuf" or isinstance(values, np.ma.MaskedArray):
        kind = "masked" if isinstance(values, np.ma.MaskedArray) else array.dtype
        raise ShapeError(f"{name} is of type {kind}; expected an array of numbers")
    return array.astype(np.float64, copy=False)


def _check_plausible(array: Array, name: str, unit: str) -> None:
    """Refuse numbers not finite, outside the range of ``unit``, or in degrees."""
    # NaN is the smallest and the largest.
    if array.size and not np.isfinite([array.min(), array.max()]).all():
        not_finite = np.argwhere(~np.isfinite(array))
        indices = ", ".join(str(i) for i in not_finite[0])
        raise ShapeError(
            f"{name}[{indices}] is {array[tuple(not_finite[0])]}; expected a finite number"
        )
    if unit in RANGES:
        RANGES[unit].check(array, name, ShapeError)
    if (
        unit == "rad"
        and array.size
        and plausible.like_degrees(max(float(array.max()), -float(array.min())))
    ):
        in_degrees = np.argwhere(plausible.mostly_like_degrees(np.atleast_2d(array)))
        if len(in_degrees):
            place = in_degrees[0][-array.ndim :]
            raise ShapeError(
                f"{name}[{', '.join(map(str, place))}] "
                f"{plausible.like_degrees(array[tuple(place)])}"
            )


ROWS_PER_BATCH = 2048
"""Their results fit the processor's cache."""


def chunks(n: int, size: int = ROWS_PER_BATCH) -> list[slice]:
    """Slices that cover ``range(n)``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def cross(u: Array, v: Array) -> Array:
    """u × v along the last axis but one (..., 3, n); numpy.cross copies, and is several times
    slower.
    """
    product = np.empty(np.broadcast_shapes(u.shape, v.shape))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        ahead = u[..., j, :] * v[..., k, :]
        product[..., i, :] = ahead - u[..., k, :] * v[..., j, :]
    return product


def wrapped(angles: Array) -> Array:
    """The same directions in [-π, π) [rad]."""
    within_turn = (angles + np.pi) % (2 * np.pi)
    return within_turn - np.pi


def spread_angles(count: int, joints: int) -> Array:
    """Evenly spread angles (count, joints) in [-π, π) [rad], without randomness.

    Additive recurrence with the powers of the root of x^(d+1) = x + 1 (M. Roberts, 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (joints + 1))
    steps = root ** -np.arange(1.0, joints + 1)
    return (np.arange(1, count + 1)[:, None] * steps % 1.0) * (2 * np.pi) - np.pi
