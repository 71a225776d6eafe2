"""All positions of three revolute joints that bring a point to a place, in closed form.

``p = B0 Rz(φ1) B1 Rz(φ2) B2 Rz(φ3) c`` with constant transforms B. With ``u = B2 Rz(φ3) c`` and ``w
= B0⁻¹ p``, a rotation about the first axis keeps |w|² and w_z. With R and t of B and ``v = Rz(φ2)
u``: ``R1ᵀt1 · v = (|w|² - |t1|² - |u|²) / 2`` and ``R1ᵀe_z · v = w_z - t1_z``. Since v_z = u_z, the
in-plane part g of v obeys ``N g = h``, and |g|² = u_x² + u_y². Rows of N are the in-plane parts of
the *normals* R1ᵀt1 and R1ᵀe_z; u and h are affine in (cos φ3, sin φ3). Elimination of φ2 gives
``|adj(N) h|² = det(N)² (u_x² + u_y²)``, a quadratic form in (1, cos φ3, sin φ3). Nothing is divided
by the offset of the first two axes, which may be tiny: if they intersect, roots pair up.
Derivation: own, after D. L. Pieper's reduction of the three-joint regional structure (Stanford,
1968).
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array, Index, wrapped

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
    rotated_shift = np.einsum("nji,nj->ni", b1[:, :3, :3], b1[:, :3, 3])
    rotated_z = b1[:, 2, :3]
    normals = np.stack([rotated_shift, rotated_z], axis=1)
    affine_u = _affine_point(b2, c)
    affine_h = _affine_right_side(b1, affine_u, c, b2, w, normals)
    phi3, row = _roots(_quadratic_form(normals[:, :, :2], affine_u, affine_h))
    basis = np.stack([np.ones_like(phi3), np.cos(phi3), np.sin(phi3)], axis=1)
    u, h = (np.einsum("nik,nk->ni", affine[row], basis) for affine in (affine_u, affine_h))
    phi2, root = _second_angle(normals[row], u, h)
    row = row[root]
    phi3 = phi3[root]
    cosine = np.cos(phi2)
    sine = np.sin(phi2)
    x, y, z = u[root].T
    v = np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])
    x, y, z = (np.einsum("nij,nj->ni", b1[row, :3, :3], v) + b1[row, :3, 3]).T
    wanted_x, wanted_y, wanted_z = w[row].T
    phi1 = np.arctan2(wanted_y, wanted_x) - np.arctan2(y, x)
    radial = np.hypot(x, y) - np.hypot(wanted_x, wanted_y)
    miss = np.hypot(radial, z - wanted_z)
    # The second half has the other φ2 of each φ3 of the first.
    miss_of_other = np.roll(miss, len(miss) // 2)
    near = miss < np.minimum(MAX_MISS, ROUNDING + WORSE * miss_of_other)
    return np.column_stack([phi1, phi2, phi3])[near], row[near]


def _affine_point(b2: Array, c: Array) -> Array:
    """B2 Rz(φ) c as an affine function of (1, cos φ, sin φ): (n, 3, 3), coefficients last."""
    x_axis, y_axis, z_axis, shift = b2[:, :3].transpose(2, 0, 1)
    x, y, z = c.T[:, :, None]
    constant = shift + z_axis * z
    cosine = x_axis * x + y_axis * y
    sine = y_axis * x - x_axis * y
    return np.stack([constant, cosine, sine], axis=2)


def _affine_right_side(
    b1: Array, affine_u: Array, c: Array, b2: Array, w: Array, normals: Array
) -> Array:
    """h as an affine function of (1, cos φ3, sin φ3): (n, 2, 3), coefficients last.

    ``|u - t2| = |c|`` makes ``|u|² = 2 t2·u + |c|² - |t2|²`` affine, too.
    """
    t1, t2 = b1[:, :3, 3], b2[:, :3, 3]
    affine_z = affine_u[:, 2]
    u_squared = 2 * np.einsum("ni,nik->nk", t2, affine_u)
    u_squared[:, 0] += _square(c) - _square(t2)
    h1 = -0.5 * u_squared - normals[:, 0, 2:3] * affine_z
    h1[:, 0] += 0.5 * (_square(w) - _square(t1))
    h2 = -normals[:, 1, 2:3] * affine_z
    h2[:, 0] += w[:, 2] - t1[:, 2]
    return np.stack([h1, h2], axis=1)


def _square(vectors: Array) -> Array:
    """(n, 3) to (n,)."""
    return np.asarray(np.square(vectors).sum(axis=1))


def _quadratic_form(matrix: Array, affine_u: Array, affine_h: Array) -> Array:
    """|adj(N) h|² - det(N)² (u_x² + u_y²) as symmetric forms (n, 3, 3) in (1, cos φ3, sin φ3), for
    matrices N (n, 2, 2).
    """
    (a, b), (c, d) = matrix.transpose(1, 2, 0)
    adjugate = np.stack([d, -b, -c, a], axis=1).reshape(-1, 2, 2)
    determinant = a * d - b * c
    left = adjugate @ affine_h
    right = determinant[:, None, None] * affine_u[:, :2]
    left_squared = left.transpose(0, 2, 1) @ left
    right_squared = right.transpose(0, 2, 1) @ right
    return np.asarray(left_squared - right_squared)


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
    real = np.abs(phi.imag) < NEARLY
    same_cell = np.diff(np.floor(phi.real / ROOT_CELL)) == 0.0
    close_pair = real[:, 1:] & real[:, :-1] & same_cell
    is_first = np.pad(close_pair, [(0, 0), (0, 1)])
    is_second = np.pad(close_pair, [(0, 0), (1, 0)])
    sharp = real & ~is_first & ~is_second
    _, row, number = np.nonzero(np.stack([sharp, is_first, is_second]))
    return phi.real[row, number], row


def _second_angle(normals: Array, u: Array, h: Array) -> tuple[Array, Index]:
    """Both φ2 of each u (n, 3), and the row of u (2n,): all first ones, then all second ones.

    The line ``normal · g = h`` of the better conditioned equation meets the circle of g twice.
    """
    length = np.linalg.norm(normals, axis=2)
    in_plane = np.linalg.norm(normals[:, :, :2], axis=2) / np.maximum(length, 1e-300)
    in_plane[:, 0] *= 0.999  # the z equation where both are as good
    better = np.argmax(in_plane, axis=1)
    number = np.arange(len(u))
    normal = normals[number, better, :2]
    value = h[number, better]
    x, y, _ = u.T
    largest = np.linalg.norm(normal, axis=1) * np.hypot(x, y)
    half = np.arccos(np.clip(value / np.maximum(largest, 1e-300), -1.0, 1.0))
    middle = np.arctan2(normal[:, 1], normal[:, 0]) - np.arctan2(y, x)
    return np.concatenate([middle + half, middle - half]), np.concatenate([number, number])
