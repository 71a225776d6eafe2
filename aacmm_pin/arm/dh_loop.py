"""The walk along a DH table in loops for numba; see :mod:`aacmm_pin.arm.dh`."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array

SIGNATURE = "void(f8[:, ::1], f8[:, ::1], f8[:, ::1], b1, i8, f8[:, ::1], f8[:, :, :, ::1])"
LANES = 128
"""Configurations side by side in the processor's wide registers; their frames stay in its nearer caches."""


def walk(cosine: Array, sine: Array, constants: Array, standard: bool, start: int, position: Array, columns: Array) -> None:
    """As :data:`aacmm_pin.arm.dh.walk`: every operation, and its order, so that the last bit is the same."""
    rows, n = cosine.shape
    kinds = columns.shape[2]
    frame, origin = np.empty((3, 3, LANES)), np.empty((rows + 1, 3, LANES))  # of each axis, and of each frame
    along, lever = np.empty((2 * rows, 3, LANES)), np.empty((3, LANES))  # the axis that each step turns about
    turn, c, s = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for first in range(0, n, LANES):
        width, here = min(LANES, n - first), start + first
        frame[:], origin[:] = 0.0, 0.0
        for axis in range(3):
            frame[axis, axis] = 1.0
        for step in range(2 * rows):
            i, about_z = step // 2, (step % 2 == 0) == standard
            turning, length = (2, constants[i, 1]) if about_z else (0, constants[i, 0])
            for lane in range(width):
                c[lane] = cosine[i, first + lane] if about_z else constants[i, 2]
                s[lane] = sine[i, first + lane] if about_z else constants[i, 3]
            for axis in range(3):
                u, v, w = frame[(turning + 1) % 3, axis], frame[(turning + 2) % 3, axis], frame[turning, axis]
                o, moved, its = origin[i + step % 2, axis], origin[i + 1, axis], along[step, axis]
                for lane in range(width):
                    turn[lane] = c[lane] * u[lane] + s[lane] * v[lane]
                for lane in range(width):
                    v[lane] = c[lane] * v[lane] - s[lane] * u[lane]
                for lane in range(width):
                    u[lane] = turn[lane]
                for lane in range(width):
                    moved[lane] = o[lane] + length * w[lane]
                for lane in range(width):
                    its[lane] = w[lane]
        for axis in range(3):
            for lane in range(width):
                position[here + lane, axis] = origin[rows, axis, lane]
        for step in range(2 * rows if kinds > 0 else 0):
            i, about_z = step // 2, (step % 2 == 0) == standard
            if kinds == 1 and not about_z:
                continue
            for axis in range(3):
                tip, foot, its = origin[rows, axis], origin[i + step % 2, axis], lever[axis]
                for lane in range(width):
                    its[lane] = tip[lane] - foot[lane]
            for axis in range(3):
                j, k = (axis + 1) % 3, (axis + 2) % 3
                uj, uk, lj, lk = along[step, j], along[step, k], lever[j], lever[k]
                turned = columns[axis, i, kinds - 1 if about_z else 2, here : here + width]
                for lane in range(width):
                    turned[lane] = uj[lane] * lk[lane] - uk[lane] * lj[lane]
                if kinds > 1:
                    its, shifted = along[step, axis], columns[axis, i, 1 if about_z else 0, here : here + width]
                    for lane in range(width):
                        shifted[lane] = its[lane]
