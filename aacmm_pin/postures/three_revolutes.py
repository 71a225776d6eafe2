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

from aacmm_pin._support.angles import wrapped
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
ROOT_CELL = np.pi / 24
"""Roots in one of these are less sharp, and come last [rad]."""
PHASES = np.linspace(-np.pi, np.pi, 8, endpoint=False)
"""Angles φ0, of which each form has the best [rad]."""
COS, SIN, ONE = np.cos(PHASES), np.sin(PHASES), np.ones(len(PHASES))
IN_HALF_ANGLE = np.array([[ONE, 0 * ONE, ONE], [COS, -2 * SIN, -COS], [SIN, 2 * COS, -SIN]])
"""(1 + t²) (1, cos φ, sin φ) by (1, t, t²), with t = tan((φ - φ0)/2): (3, 3, angles)."""


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

    Angles close to no other come first.

    In t = tan((φ - φ0)/2) the form is a quartic, whose roots are the eigenvalues of its companion
    matrix. Its leading coefficient is the value of the form half a turn from φ0.
    """
    half_a_turn_on = IN_HALF_ANGLE[:, 2]
    values = np.einsum("ik,nij,jk->nk", half_a_turn_on, form, half_a_turn_on)
    best = np.abs(values).argmax(axis=1)
    basis = IN_HALF_ANGLE[:, :, best]
    products = np.einsum("ikn,nij,jln->nkl", basis, form, basis)
    leading = products[:, 2, 2]
    companion = np.tile(np.eye(4, k=-1), (len(form), 1, 1))
    for power in range(4):
        antidiagonal = np.trace(products[:, ::-1], offset=power - 2, axis1=1, axis2=2)
        companion[:, power, 3] = -antidiagonal / np.where(leading == 0.0, 1.0, leading)
    half = np.arctan(np.linalg.eigvals(companion).astype(np.complex128))
    phi = np.sort(wrapped(PHASES[best, None] + 2 * half.real) + 2j * half.imag, axis=1)
    near = np.abs(phi.imag) < NEARLY
    beside = near[:, 1:] & near[:, :-1] & (np.diff(np.floor(phi.real / ROOT_CELL)) == 0.0)
    is_first = np.pad(beside, [(0, 0), (0, 1)])
    is_second = np.pad(beside, [(0, 0), (1, 0)])
    sharp = near & ~is_first & ~is_second
    _, row, number = np.nonzero(np.stack([sharp, is_first, is_second]))
    return phi.real[row, number], row


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
