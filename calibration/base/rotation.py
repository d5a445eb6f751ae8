"""Rotations in space: vectors, matrices, cross products; batched over leading axes."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array


def skew(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation_matrix(vector: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), Rodrigues' formula."""
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    k = skew(vector)
    with np.errstate(invalid="ignore", divide="ignore"):
        a = np.where(angle > 1e-8, np.sin(angle) / angle, 1.0 - angle**2 / 6.0)
        b = np.where(angle > 1e-8, (1.0 - np.cos(angle)) / angle**2, 0.5)
    matrix: Array = np.eye(3) + a * k + b * (k @ k)
    return matrix


def rotation_vector(matrix: Array) -> Array:
    """Rotation vectors (n, 3) of rotation matrices (n, 3, 3), for angles well below pi."""
    twice_axis = np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.sqrt(np.sum(twice_axis * twice_axis, axis=-1))
    cosine = 0.5 * (np.trace(matrix, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(sine > 1e-12, 0.5 * angle / sine, 0.5)
    vector: Array = factor[..., None] * twice_axis
    return vector


def rotations_poses_last(vector: Array) -> Array:
    """Rotation matrices (3, 3, n) of rotation vectors (3, n): as `rotation_matrix`, poses last."""
    square = vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2
    angle = np.sqrt(square)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - square / 6.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    x, y, z = vector
    out = np.empty((3, 3, vector.shape[1]))
    out[0, 0], out[1, 1], out[2, 2] = (1.0 - b * (square - c * c) for c in vector)
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x
    return out


def cayley_rotations(vector: Array) -> Array:
    """Rotations (3, 3, n) that agree with those of short vectors (3, n) to the second order, without sines: Cayley's.

    Rotations by 2 atan(|v| / 2) about v. For the steps of an iteration, whose last one vanishes.
    """
    half = 0.5 * vector
    square = half[0] ** 2 + half[1] ** 2 + half[2] ** 2
    scale = 2.0 / (1.0 + square)
    out = np.empty((3, 3, vector.shape[1]))
    scaled = scale * half
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i, i] = 1.0 - scale * (square - half[i] ** 2)
        product = scaled[i] * half[j]
        out[i, j] = product - scaled[k]
        out[j, i] = product + scaled[k]
    return out


def rotations_about_z(angle: Array) -> Array:
    """Rotations of the plane (2, 2, n) by angles (n,)."""
    return _in_plane(np.cos(angle), np.sin(angle))


def cayley_rotations_about_z(angle: Array) -> Array:
    """Rotations of the plane (2, 2, n) by short angles (n,), as `cayley_rotations` makes them."""
    square = 0.25 * angle * angle
    scale = 1.0 / (1.0 + square)
    return _in_plane((1.0 - square) * scale, angle * scale)


def _in_plane(cos: Array, sin: Array) -> Array:
    out = np.empty((2, 2, cos.size))
    out[0, 0] = out[1, 1] = cos
    out[1, 0] = sin
    np.negative(sin, out=out[0, 1])
    return out
