"""The Denavit–Hartenberg table as a value, and its geometry in pure NumPy.

A row is a transform from frame i-1 to frame i:

- ``standard-dh``: ``T_i = Rz(θ_i + θ0_i) Tz(d_i) Tx(a_i) Rx(α_i)``
- ``modified-dh`` (Craig): ``T_i = Rx(α_i) Tx(a_i) Rz(θ_i + θ0_i) Tz(d_i)``

A row that does not move (``moving[i] = False``: a stylus) has θ_i = 0. Batches run along the *last* axis inside this
module, because whole-array arithmetic on contiguous components is several times faster than stacks of 3×3 products.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index, batch
from aacmm_pin._support.compiled import twin_of
from aacmm_pin._support.display import Shown
from aacmm_pin.arm import dh_loop
from aacmm_pin.errors import ShapeError, UnknownNameError

Convention = Literal["standard-dh", "modified-dh"]
KINDS = ("a", "d", "alpha", "theta_offset")
"""The four values of a row, in the order in which sensitivities list them."""

CHUNK = 2048
"""Configurations handled at once: their frames stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class DHTable(Shown):
    """Denavit–Hartenberg values of an arm.

    Attributes:
        a: link lengths, (rows,) [m].
        d: joint distances, (rows,) [m].
        alpha: link twists, (rows,) [rad].
        theta_offset: joint zero offsets, (rows,) [rad].
        moving: (rows,) True where the row has a joint.
        convention: ``standard-dh`` or ``modified-dh``.
    """

    a: Array
    d: Array
    alpha: Array
    theta_offset: Array
    moving: NDArray[np.bool_]
    convention: Convention = "standard-dh"

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.a.shape[0])

    @property
    def nq(self) -> int:
        """Number of joints."""
        return int(self.moving.sum())

    @property
    def standard(self) -> bool:
        """True for standard DH."""
        return self.convention == "standard-dh"

    def values(self) -> Array:
        """All values as (rows, 4): a, d, alpha, theta_offset [m, m, rad, rad]."""
        return np.stack([self.a, self.d, self.alpha, self.theta_offset], axis=1)

    def positions(self, q: Array, row: int | None = None, errors: Array | None = None) -> Array:
        """Origin of frame ``row`` (default: the last) for ``q`` (n, nq) [rad]: (n, 3) [m].

        Args:
            q: configurations (n, nq) [rad].
            row: number of the frame, 0 the base.
            errors: (n, rows, 4) or (rows, 4), added to a, d, alpha, theta_offset; exact, nothing is linearised.
        """
        q = batch(q, self.nq, "q", "rad")
        row = self.rows if row is None else row
        if errors is None:
            return self._walked(q, row, 0)[0]
        positions = np.empty((len(q), 3))
        for part in chunks(len(q)):
            these = errors[part] if errors.ndim == 3 else errors
            positions[part] = self.axes(q[part], these, row)[3][row].T
        return positions

    def links(self) -> Array:
        """Constant transforms L of ``L_0 Rz(q_1) L_1 Rz(q_2) ... Rz(q_nq) L_nq``: (nq + 1, 4, 4) [m]."""
        links = [np.eye(4)]
        for i in range(self.rows):
            before, after = _row_constants(self, i)
            links[-1] = links[-1] @ before
            if self.moving[i]:
                links.append(after)
            else:
                links[-1] = links[-1] @ after
        return np.stack(links)

    def position_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """Origin of the last frame and its derivative, for already checked ``q`` (n, nq): (n, 3) [m], (n, 3, nq) [m/rad]."""
        position, columns = self._walked(q, self.rows, 1)
        return position, np.ascontiguousarray(columns[:, self.moving, 0].transpose(2, 0, 1))

    def sensitivity(self, q: Array, row: int | None = None) -> Array:
        """∂(origin of frame ``row``)/∂(a, d, alpha, theta of each row), closed form: (n, 3, 4 rows) [m/m, m/rad].

        A length moves the point along its own axis, an angle turns the point about its own axis; so for standard DH
        ``∂p/∂d_i = z_{i-1}``, ``∂p/∂a_i = x_i``, ``∂p/∂θ_i = z_{i-1} × (p - o_{i-1})``, ``∂p/∂α_i = x_i × (p - o_i)``.
        In modified DH the axis of a and alpha is x_{i-1}, the axis of d and theta is z_i. Rows beyond ``row`` give zeros.
        """
        return self.position_and_sensitivity(q, row)[1]

    def position_and_sensitivity(self, q: Array, row: int | None = None) -> tuple[Array, Array]:
        """Both :meth:`positions` (n, 3) [m] and :meth:`sensitivity` (n, 3, 4 rows) in one walk."""
        q = batch(q, self.nq, "q", "rad")
        position, columns = self._walked(q, self.rows if row is None else row, len(KINDS))
        return position, columns.reshape(3, 4 * self.rows, len(q)).transpose(2, 0, 1)

    def _walked(self, q: Array, row: int, kinds: int) -> tuple[Array, Array]:
        """Origin of frame ``row`` (n, 3) and its derivatives, the last ``kinds`` of each row: (3, rows, kinds, n)."""
        position, columns = np.empty((len(q), 3)), np.zeros((3, self.rows, kinds, len(q)))
        for part in chunks(len(q)):
            walk(*self._motions(q[part], self.values(), row), self.standard, part.start, position, columns)
        return position, columns

    def axes(self, q: Array, errors: Array | None = None, row: int | None = None) -> tuple[Array, Array, Array, Array]:
        """Axes and origins of the frames 0..row in the base, for already checked ``q`` (n, nq).

        Returns:
            x, y, z, o: each (row + 1, 3, n), components along the middle axis, the batch last.
        """
        values = self.values() if errors is None else self.values() + errors  # (rows, 4) or (n, rows, 4)
        values = values.transpose(1, 2, 0) if values.ndim == 3 else values
        x, y, z, o = _frames(*self._motions(q, values, self.rows if row is None else row), self.standard)
        return x, y, z, o

    def _motions(self, q: Array, values: Array, row: int) -> tuple[Array, Array, Array]:
        """Cosines and sines of the turns about z of the first ``row`` rows (row, n), and a, d, cos α, sin α of each.

        ``values`` are (rows, 4), or (rows, 4, n) where configurations have their own; so are the constants, without the
        rows beyond.
        """
        turns, joints = np.empty((row, len(q))), iter(q.T)
        for turn, moves, offset in zip(turns, self.moving, values[:, 3], strict=False):
            turn[:] = next(joints) + offset if moves else offset
        constants = values[:row].copy()
        constants[:, 2], constants[:, 3] = np.cos(values[:row, 2]), np.sin(values[:row, 2])
        return np.cos(turns), np.sin(turns), constants

    @property
    def joint_frames(self) -> Index:
        """Number of the frame about whose z each joint turns (nq,)."""
        rows = np.flatnonzero(self.moving)
        return rows if self.standard else rows + 1


def _frames(cosine: Array, sine: Array, constants: Array, standard: bool) -> Array:
    """x, y, z and origins of the frames (4, rows + 1, 3, n) for what :meth:`DHTable._motions` gives."""
    rows, n = cosine.shape
    frames = np.empty((4, rows + 1, 3, n))
    frames[:, 0] = np.eye(4, 3)[:, :, None]
    for i in range(rows):
        # Plain floats where all configurations share the values: NumPy multiplies by them fastest.
        a, d, its_cosine, its_sine = constants[i].tolist() if constants.ndim == 2 else constants[i]
        frames[:, i + 1] = frames[:, i]
        x, y, z, o = frames[:, i + 1]
        screws = [(x, y, z, cosine[i], sine[i], d), (y, z, x, its_cosine, its_sine, a)]
        for screw in screws if standard else reversed(screws):
            _move(o, *screw)
    return frames


@twin_of(dh_loop.walk, dh_loop.SIGNATURE)
def walk(cosine: Array, sine: Array, constants: Array, standard: bool, start: int, position: Array, columns: Array) -> None:
    """Origin of the last frame into ``position`` (all, 3), from ``start`` on, and its derivatives into ``columns``.

    These are (3, ≥ rows, 4, all) as in :meth:`DHTable.sensitivity`, (…, 1, all) for those by theta alone, or (…, 0, all).
    The other arguments are those that :meth:`DHTable._motions` gives, with constants that all configurations share.
    """
    rows, part = len(cosine), slice(start, start + cosine.shape[1])
    x, _, z, o = _frames(cosine, sine, constants, standard)
    position[part] = o[rows].T
    kinds = columns.shape[2]
    for i in range(rows if kinds else 0):
        z_frame, x_frame = (i, i + 1) if standard else (i + 1, i)
        cross(z[z_frame], o[rows] - o[z_frame], columns[:, i, kinds - 1, part])
        if kinds > 1:
            columns[:, i, 0, part] = x[x_frame]
            columns[:, i, 1, part] = z[z_frame]
            cross(x[x_frame], o[rows] - o[x_frame], columns[:, i, 2, part])


def _move(
    o: Array, u: Array, v: Array, axis: Array, cosine: float | Array, sine: float | Array, length: float | Array
) -> None:
    """A screw motion of a frame in place: u and v turn about the axis, the origin o shifts along it."""
    turned = cosine * u
    turned += sine * v
    v *= cosine
    v -= sine * u
    u[:] = turned
    if isinstance(length, np.ndarray) or length != 0.0:
        o += length * axis


def _row_constants(dh: DHTable, i: int) -> tuple[Array, Array]:
    """What stands before and behind the joint of row i; Rz(θ0) commutes with the joint and is put behind it."""
    ca, sa = np.cos(dh.alpha[i]), np.sin(dh.alpha[i])
    c, s = np.cos(dh.theta_offset[i]), np.sin(dh.theta_offset[i])
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, dh.d[i]], [0, 0, 0, 1]])
    tilt = np.array([[1, 0, 0, dh.a[i]], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
    return (np.eye(4), turn @ tilt) if dh.standard else (tilt, turn)


def cross(u: Array, v: Array, out: Array | None = None) -> Array:
    """u × v of components along the last axis but one (..., 3, n); numpy.cross copies and is several times slower here."""
    if out is None:
        out = np.empty(np.broadcast_shapes(u.shape, v.shape))
    out[..., 0, :] = u[..., 1, :] * v[..., 2, :] - u[..., 2, :] * v[..., 1, :]
    out[..., 1, :] = u[..., 2, :] * v[..., 0, :] - u[..., 0, :] * v[..., 2, :]
    out[..., 2, :] = u[..., 0, :] * v[..., 1, :] - u[..., 1, :] * v[..., 0, :]
    return out


def chunks(n: int, size: int = CHUNK) -> list[slice]:
    """Slices that cover ``range(n)`` in parts of ``size``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def table(rows: Array, convention: Convention = "standard-dh", moving: list[bool] | None = None) -> DHTable:
    """Make a table from ``rows`` (rows, 4): a, d, alpha, theta_offset [m, m, rad, rad].

    Raises:
        ShapeError: wrong shape, not finite, or another number of ``moving``.
    """
    if convention not in get_args(Convention):
        raise UnknownNameError("convention", convention, list(get_args(Convention)))
    rows = batch(rows, 4, "rows", "m, m, rad, rad")
    flags = np.ones(len(rows), dtype=bool) if moving is None else np.array(moving, dtype=bool)
    if flags.shape != (len(rows),):
        raise ShapeError(f"moving has {flags.size} entries, expected one for each of the {len(rows)} rows")
    return DHTable(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], flags, convention)
