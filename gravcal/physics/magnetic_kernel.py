"""Compiled sum of solid harmonics, blocks of points side by side so that each operation works on a whole register."""

import numpy as np
from numba import njit

BLOCK = 128
LIMIT = 14  # highest degree of the sum


@njit(cache=True)
def sum_field(position, elapsed, base, slope):
    """Field (n, 3) at position (n, 3) in units of the reference radius, coefficients base + elapsed * slope."""
    n = position.shape[0]
    out = np.empty((n, 3))
    point, result = np.zeros((4, BLOCK)), np.empty((3, BLOCK))
    work, V, W = np.empty((6, BLOCK)), np.zeros((LIMIT + 2, BLOCK)), np.zeros((LIMIT + 2, BLOCK))
    for start in range(0, n, BLOCK):
        size = min(BLOCK, n - start)
        for i in range(BLOCK):
            k = start + min(i, size - 1)
            for axis in range(3):
                point[axis, i] = position[k, axis]
            point[3, i] = elapsed[k]
        _block(point, base, slope, (work, V, W), result)
        for i in range(size):
            for axis in range(3):
                out[start + i, axis] = result[axis, i]
    return out


@njit(cache=True)
def _block(point, base, slope, scratch, result):
    """Orders outside, degrees inside: V_nm + i W_nm by recursion in n from the sectorial V_mm + i W_mm.

    Row 0 of V and W is zero, row k + 1 holds degree m + k. Each loop over the block writes one array, else the compiler
    would have to check too many overlaps to use vector instructions.
    """
    work, V, W = scratch
    x, y, z, q, sv, sw = work
    for i in range(BLOCK):
        r2 = point[0, i] ** 2 + point[1, i] ** 2 + point[2, i] ** 2
        x[i], y[i], z[i], q[i] = point[0, i] / r2, point[1, i] / r2, point[2, i] / r2, 1 / r2
        sv[i], sw[i] = np.sqrt(1 / r2), 0.0
    result[:] = 0.0
    for m in range(LIMIT + 1):
        if m > 0:
            _sectorial(2 * m - 1, x, y, sv, sw)
        V[1], W[1] = sv, sw
        for n in range(m, LIMIT + 1):
            k = n - m + 1
            if k > 1:
                a, b = (2 * n - 1) / (n - m), (n + m - 1) / (n - m)
                _next_degree(a, b, (z, q), V, k)
                _next_degree(a, b, (z, q), W, k)
            if n > 1:
                for axis in range(3):
                    _accumulate(base[n, m], slope[n, m], axis, (point[3], V[k], W[k]), result[axis])


@njit(cache=True, fastmath={"contract"})
def _sectorial(factor, x, y, sv, sw):
    for i in range(BLOCK):
        v, w = sv[i], sw[i]
        sv[i], sw[i] = factor * (x[i] * v - y[i] * w), factor * (x[i] * w + y[i] * v)


@njit(cache=True, fastmath={"contract"})
def _next_degree(a, b, geometry, table, k):
    z, q = geometry
    before, last, out = table[k - 2], table[k - 1], table[k]
    for i in range(BLOCK):
        out[i] = a * z[i] * last[i] - b * q[i] * before[i]


@njit(cache=True, fastmath={"contract"})
def _accumulate(c, d, axis, values, out):
    dt, v, w = values
    cv, dv, cw, dw = c[axis], d[axis], c[axis + 3], d[axis + 3]
    for i in range(BLOCK):
        out[i] += (cv + dt[i] * dv) * v[i] + (cw + dt[i] * dw) * w[i]
