"""All positions of three revolute joints that bring a point to a place, in closed form.

``p = B0 Rz(φ1) B1 Rz(φ2) B2 Rz(φ3) c`` with constant transforms B. With ``u = B2 Rz(φ3) c`` and ``w
= B0⁻¹ p``, a rotation about the first axis keeps |w|² and w_z. Both conditions are linear in the
in-plane part g of ``Rz(φ2) u``: ``N g = h``, and |g|² = u_x² + u_y². Elimination of φ2 gives
``|adj(N) h|² = det(N)² (u_x² + u_y²)``, a quadratic form in (1, cos φ3, sin φ3). Nothing is divided
by the offset of the first two axes, which may be tiny: if they intersect, roots pair up.
Derivation: own, after D. L. Pieper's reduction of the three-joint regional structure (Stanford,
1968).
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array, Index

MAX_MISS = 0.1
"""Candidates that miss by more solve one equation only [m]."""
WORSE, ROUNDING = 1e3, 1e-6
"""So do those that miss by so many times the other candidate with their φ3, and by more than
rounding [m].
"""
NEARLY = 0.25
"""Pairs of roots with a smaller imaginary part are candidates: rounding separates double roots
[rad].
"""
GRID, STEPS = 48, 6
"""Angles between two of which there are at most two roots, and steps to each."""


def candidates(b0: Array, b1: Array, b2: Array, c: Array, p: Array) -> tuple[Array, Index]:
    """Candidates for the three angles: every solution is close to one.

    Args:
        b0, b1, b2: constant transforms (n, 4, 4) [m].
        c: point in the last frame (n, 3) [m].
        p: its wanted place (n, 3) [m].

    Returns:
        angles (m, 3) [rad] for Newton's method, and the row of each (m,).
    """
    w = np.einsum("nji,nj->ni", b0[:, :3, :3], p - b0[:, :3, 3])
    # R1ᵀ t1, R1ᵀ e_z.
    first = np.einsum("nji,nj->ni", b1[:, :3, :3], b1[:, :3, 3])
    rows = np.stack([first, b1[:, 2, :3]], axis=1)
    u = _affine_point(b2, c)
    h = _affine_right_side(b1, u, c, b2, w, rows)
    phi3, who = _roots(_quadratic_form(rows[:, :, :2], u, h))
    basis = np.stack([np.ones_like(phi3), np.cos(phi3), np.sin(phi3)], axis=1)
    u3, h3 = (np.einsum("nik,nk->ni", affine[who], basis) for affine in (u, h))
    phi2, twice = _second_angle(rows[who], u3, h3)
    who = who[twice]
    phi3 = phi3[twice]
    u3 = u3[twice]
    cosine = np.cos(phi2)
    sine = np.sin(phi2)
    x, y, z = u3.T
    v = np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])
    x, y, z = (np.einsum("nij,nj->ni", b1[who, :3, :3], v) + b1[who, :3, 3]).T
    wanted_x, wanted_y, wanted_z = w[who].T
    phi1 = np.arctan2(wanted_y, wanted_x) - np.arctan2(y, x)
    radial = np.hypot(x, y) - np.hypot(wanted_x, wanted_y)
    miss = np.hypot(radial, z - wanted_z)
    of_twin = np.roll(miss, len(miss) // 2)
    near = miss < np.minimum(MAX_MISS, ROUNDING + WORSE * of_twin)
    return np.column_stack([phi1, phi2, phi3])[near], who[near]


def _affine_point(b2: Array, c: Array) -> Array:
    """B2 Rz(φ) c as an affine function of (1, cos φ, sin φ): (n, 3, 3), coefficients last."""
    x_axis, y_axis, z_axis, shift = b2[:, :3].transpose(2, 0, 1)
    x, y, z = c.T[:, :, None]
    constant = shift + z_axis * z
    cosine = x_axis * x + y_axis * y
    sine = y_axis * x - x_axis * y
    return np.stack([constant, cosine, sine], axis=2)


def _affine_right_side(b1: Array, u: Array, c: Array, b2: Array, w: Array, rows: Array) -> Array:
    """h as an affine function of (1, cos φ3, sin φ3): (n, 2, 3). |B2 Rz c|² - |c|² - |t2|² is
    affine, so |u|² is.
    """
    shift = b2[:, :3, 3]
    along = np.einsum("ni,nik->nk", shift, u)
    square = 2 * along
    square[:, 0] += _square(c) - _square(shift)
    first = -0.5 * square - rows[:, 0, 2:3] * u[:, 2]
    first[:, 0] += 0.5 * (_square(w) - _square(b1[:, :3, 3]))
    second = -rows[:, 1, 2:3] * u[:, 2]
    second[:, 0] += w[:, 2] - b1[:, 2, 3]
    return np.stack([first, second], axis=1)


def _square(vectors: Array) -> Array:
    """(n, 3) to (n,)."""
    return np.asarray(np.square(vectors).sum(axis=1))


def _quadratic_form(plane: Array, u: Array, h: Array) -> Array:
    """|adj(N) h|² - det(N)² (u_x² + u_y²) as symmetric forms (n, 3, 3) in (1, cos φ3, sin φ3)."""
    (a, b), (c, d) = plane.transpose(1, 2, 0)
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    determinant = a * d - b * c
    left = adjugate @ h
    right = determinant[:, None, None] * u[:, :2]
    square = left.transpose(0, 2, 1) @ left
    return np.asarray(square - right.transpose(0, 2, 1) @ right)


def _roots(form: Array) -> tuple[Array, Index]:
    """Angles φ with (1, cos φ, sin φ) form (…)ᵀ ≈ 0, and the row of each.

    Between grid angles the form, a wave of first and second order, has one root at a change of
    sign, and up to two where its curvature allows. Steps go to the osculating parabola's root with
    the right slope, or its vertex.
    """
    size = np.abs(form).max(axis=(1, 2), keepdims=True)
    # Of an arm without lengths there is nothing left.
    form = form / np.where(size > 1e-200, size, 1.0)
    (one, c, s), (_, cc, cs), (_, _, ss) = form.transpose(1, 2, 0)
    constant = one + 0.5 * (cc + ss)
    terms = np.stack([constant, 2 * c, 2 * s, 0.5 * (cc - ss), cs])
    step = 2 * np.pi / GRID
    grid = step * np.arange(GRID + 1) - np.pi
    wave = np.stack(
        [np.ones(GRID + 1), np.cos(grid), np.sin(grid), np.cos(2 * grid), np.sin(2 * grid)]
    )
    value = terms.T @ wave
    slope = terms[[2, 1, 4, 3]].T @ (wave[1:] * [[1], [-1], [2], [-2]])
    # |form|' step/2.
    half = 0.5 * step * np.sign(value) * slope
    bend = np.hypot(terms[1], terms[2]) + 4 * np.hypot(terms[3], terms[4])  # at most
    # Where half is below this, the form may come to zero within half a step.
    margin = 0.125 * step**2 * bend[:, None] - np.abs(value)
    passes = (value[:, :-1] < 0) != (value[:, 1:] < 0)
    may_turn_after = ~passes & (half < margin)[:, :-1]
    may_turn_before = ~passes & (-half < margin)[:, 1:]
    kind, row, interval = np.nonzero(np.stack([passes, may_turn_after, may_turn_before]))
    begin = value[row, interval]
    end = value[row, interval + 1]
    terms = terms[:, row]
    part = begin / np.where(kind == 0, begin - end, 1.0)
    phi = grid[interval] + step * np.where(kind == 0, part, kind - 1)
    sense = np.where((begin < 0) == (kind < 2), 1.0, -1.0)
    for _ in range(STEPS):
        c = np.cos(phi)
        s = np.sin(phi)
        c2 = 2 * c**2 - 1
        s2 = 2 * c * s
        first = terms[1] * c + terms[2] * s
        second = terms[3] * c2 + terms[4] * s2
        f = terms[0] + first + second
        slope = terms[2] * c - terms[1] * s + 2 * (terms[4] * c2 - terms[3] * s2)
        bend = -first - 4 * second
        square = slope**2 - 2 * f * bend
        with np.errstate(divide="ignore", invalid="ignore"):
            change = -2 * f / (slope + sense * np.sqrt(np.maximum(square, 0.0)))
            change = np.where(square < 0, -slope / bend, change)
        phi = phi + np.clip(np.nan_to_num(change), -step, step)
    from_middle = np.abs(phi - grid[interval] - 0.5 * step)
    good = (square > -((NEARLY * bend) ** 2)) & (from_middle < 0.5 * step + 1e-6)
    return phi[good], row[good]


def _second_angle(rows: Array, u: Array, h: Array) -> tuple[Array, Index]:
    """φ2 from the better conditioned linear equation: a line meets a circle in two points."""
    length = np.linalg.norm(rows, axis=2)
    in_plane = np.linalg.norm(rows[:, :, :2], axis=2) / np.maximum(length, 1e-300)
    in_plane[:, 0] *= 0.999  # the z equation where both are as good
    better = np.argmax(in_plane, axis=1)
    number = np.arange(len(u))
    normal = rows[number, better, :2]
    value = h[number, better]
    x, y, _ = u.T
    largest = np.linalg.norm(normal, axis=1) * np.hypot(x, y)
    half = np.arccos(np.clip(value / np.maximum(largest, 1e-300), -1.0, 1.0))
    middle = np.arctan2(normal[:, 1], normal[:, 0]) - np.arctan2(y, x)
    return np.concatenate([middle + half, middle - half]), np.concatenate([number, number])
