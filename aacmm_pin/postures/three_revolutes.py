"""All positions of a general chain of three revolute joints that bring a point to a place, in closed form.

``p = B0 Rz(φ1) B1 Rz(φ2) B2 Rz(φ3) c`` for any constant transforms B. With ``u = B2 Rz(φ3) c`` and ``w = B0⁻¹ p``, turning
about the first axis keeps |w|² and w_z; both conditions are linear in the in-plane part g of ``Rz(φ2) u``:
``N g = h``, and |g|² = u_x² + u_y². Eliminating φ2 gives ``|adj(N) h|² = det(N)² (u_x² + u_y²)``, a quadratic form in
(1, cos φ3, sin φ3), that is a polynomial of degree four in exp(iφ3), whose solutions lie on the unit circle. There is no
division by the (possibly tiny) offset between the first two axes: where they intersect, the roots pair up.
Derivation: own, after D. L. Pieper's reduction of the three-joint regional structure (Stanford, 1968).
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array, Index

ON_CIRCLE = 0.25
"""Roots whose modulus differs from 1 by less are kept as candidates: paired roots lose half their digits."""


def candidates(b0: Array, b1: Array, b2: Array, c: Array, p: Array) -> tuple[Array, Index]:
    """Candidates for the three angles; every solution is near one, but not every candidate is a solution.

    Args:
        b0, b1, b2: constant transforms (n, 4, 4) [m].
        c: point in the last frame (n, 3) [m].
        p: place that it shall reach (n, 3) [m].

    Returns:
        angles (m, 3) [rad] to be polished by Newton's method, and the row (m,) that each belongs to.
    """
    w = np.einsum("nji,nj->ni", b0[:, :3, :3], p - b0[:, :3, 3])
    rows = np.stack([np.einsum("nji,nj->ni", b1[:, :3, :3], b1[:, :3, 3]), b1[:, 2, :3]], axis=1)  # R1ᵀ t1, R1ᵀ e_z
    u = _affine_point(b2, c)
    h = _affine_right_side(b1, u, c, b2, w, rows)
    phi3, who = _roots(_quadratic_form(rows[:, :, :2], u, h))
    basis = np.stack([np.ones_like(phi3), np.cos(phi3), np.sin(phi3)], axis=1)
    u3, h3 = (np.einsum("nik,nk->ni", affine[who], basis) for affine in (u, h))
    phi2, twice = _second_angle(rows[who], u3, h3)
    who, phi3, u3 = who[twice], phi3[twice], u3[twice]
    cosine, sine = np.cos(phi2), np.sin(phi2)
    v = np.column_stack([cosine * u3[:, 0] - sine * u3[:, 1], sine * u3[:, 0] + cosine * u3[:, 1], u3[:, 2]])
    v = np.einsum("nij,nj->ni", b1[who, :3, :3], v) + b1[who, :3, 3]
    phi1 = np.arctan2(w[who, 1], w[who, 0]) - np.arctan2(v[:, 1], v[:, 0])
    return np.column_stack([phi1, phi2, phi3]), who


def _affine_point(b2: Array, c: Array) -> Array:
    """B2 Rz(φ) c as an affine function of (1, cos φ, sin φ): (n, 3, 3), coefficients last."""
    rotation = b2[:, :3, :3]
    constant = b2[:, :3, 3] + rotation[:, :, 2] * c[:, 2:3]
    cosine = rotation[:, :, 0] * c[:, 0:1] + rotation[:, :, 1] * c[:, 1:2]
    sine = rotation[:, :, 1] * c[:, 0:1] - rotation[:, :, 0] * c[:, 1:2]
    return np.stack([constant, cosine, sine], axis=2)


def _affine_right_side(b1: Array, u: Array, c: Array, b2: Array, w: Array, rows: Array) -> Array:
    """h as an affine function of (1, cos φ3, sin φ3): (n, 2, 3). |u|² is affine, because |B2 Rz c|² - |c|² - |t2|² is."""
    shift = b2[:, :3, 3]
    square = 2 * np.einsum("ni,nik->nk", shift, u)
    square[:, 0] += np.square(c).sum(axis=1) - np.square(shift).sum(axis=1)
    first = -0.5 * square - rows[:, 0, 2:3] * u[:, 2]
    first[:, 0] += 0.5 * (np.square(w).sum(axis=1) - np.square(b1[:, :3, 3]).sum(axis=1))
    second = -rows[:, 1, 2:3] * u[:, 2]
    second[:, 0] += w[:, 2] - b1[:, 2, 3]
    return np.stack([first, second], axis=1)


def _quadratic_form(plane: Array, u: Array, h: Array) -> Array:
    """|adj(N) h|² - det(N)² (u_x² + u_y²) as symmetric forms (n, 3, 3) in (1, cos φ3, sin φ3)."""
    adjugate = np.stack(
        [np.stack([plane[:, 1, 1], -plane[:, 0, 1]], axis=1), np.stack([-plane[:, 1, 0], plane[:, 0, 0]], axis=1)], axis=1
    )
    determinant = plane[:, 0, 0] * plane[:, 1, 1] - plane[:, 0, 1] * plane[:, 1, 0]
    left = adjugate @ h
    right = determinant[:, None, None] * u[:, :2]
    return np.asarray(left.transpose(0, 2, 1) @ left - right.transpose(0, 2, 1) @ right)


def _roots(form: Array) -> tuple[Array, Index]:
    """Angles φ with (1, cos φ, sin φ) form (…)ᵀ ≈ 0, and the row that each belongs to."""
    size = np.abs(form).max(axis=(1, 2), keepdims=True)
    form = form / np.where(size > 1e-200, size, 1.0)  # of an arm without lengths there is nothing left
    one, cc, ss = form[:, 0, 0], form[:, 1, 1], form[:, 2, 2]
    lead = 0.25 * (cc - ss) - 0.5j * form[:, 1, 2]  # coefficient of exp(2iφ); the others follow by conjugation
    next_ = form[:, 0, 1] - 1j * form[:, 0, 2]
    middle = one + 0.5 * (cc + ss)
    lead = np.where(np.abs(lead) < 1e-13, 1e-13, lead)
    companion = np.zeros((len(form), 4, 4), dtype=complex)
    companion[:, 0, :] = -np.stack([next_, middle, next_.conj(), lead.conj()], axis=1) / lead[:, None]
    companion[:, 1, 0] = companion[:, 2, 1] = companion[:, 3, 2] = 1.0
    roots = np.linalg.eigvals(companion)
    who, which = np.nonzero(np.abs(np.abs(roots) - 1) < ON_CIRCLE)
    return np.angle(roots[who, which]), who


def _second_angle(rows: Array, u: Array, h: Array) -> tuple[Array, Index]:
    """Angles φ2 from the better one of the two linear equations: line and circle meet in two points."""
    weight = np.linalg.norm(rows[:, :, :2], axis=2) / np.maximum(np.linalg.norm(rows, axis=2), 1e-300)
    weight[:, 0] *= 0.999  # the z equation where both are as good
    pick = np.argmax(weight, axis=1)
    each = np.arange(len(u))
    normal, value = rows[each, pick, :2], h[each, pick]
    radius = np.hypot(u[:, 0], u[:, 1])
    cosine = value / np.maximum(np.linalg.norm(normal, axis=1) * radius, 1e-300)
    half = np.arccos(np.clip(cosine, -1.0, 1.0))
    middle = np.arctan2(normal[:, 1], normal[:, 0]) - np.arctan2(u[:, 1], u[:, 0])
    return np.concatenate([middle + half, middle - half]), np.concatenate([each, each])
