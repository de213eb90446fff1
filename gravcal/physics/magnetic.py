"""International Geomagnetic Reference Field along an orbit, one epoch per point.

The coefficient files IGRF13.shc and IGRF14.shc are those of IAGA (https://doi.org/10.5281/zenodo.14012302 and its
forerunner), as shipped by ppigrf 2.1.0; ``coefficient_digest`` identifies them in a product.
"""

import hashlib
from functools import lru_cache
from math import factorial
from pathlib import Path

import numpy as np
from numba import njit

from gravcal.physics.constants import IGRF_RADIUS
from gravcal.physics.shapes import check_shape, refuse

GENERATIONS = (13, 14)
DEGREE = 13


def field_e(time_gps, position_e, generation):
    """Main field of the Earth.

    Parameters
    ----------
    time_gps : (n,) GPS s, or one epoch for all points
    position_e : (n, 3) m, geocentric, Earth-fixed
    generation : int, 13 or 14

    Returns
    -------
    field_e : (n, 3) T, Earth-fixed components

    Raises
    ------
    GravcalError : an epoch outside the model, an unknown generation, a point near the Earth's centre

    Notes
    -----
    B = -grad a sum (a/r)^(n+1) (g cos m phi + h sin m phi) P_nm(cos theta), Schmidt semi-normalised, coefficients
    linear between epochs; Alken et al. 2021, eq. 1. Evaluated as solid harmonics in x, y, z: no pole is special.
    """
    position = check_shape("position_e", position_e, (None, 3))
    year = np.broadcast_to(decimal_year(time_gps), position.shape[:1])
    epochs, cartesian = _cartesian(generation)
    if year.size == 0:
        return np.empty((0, 3))
    if not (year.min() >= epochs[0] and year.max() <= epochs[-1]):
        found, expected = f"{year.min():.3f} to {year.max():.3f}", f"{epochs[0]:.0f} to {epochs[-1]:.0f}"
        refuse(f"IGRF-{generation}", found, expected, "Choose another generation.", first=year.min(), last=year.max())
    if not np.min(np.einsum("ij,ij->i", position, position)) > 1e12:
        refuse("position_e", "a point near the Earth's centre, or NaN", "an orbit in metres", "Check units and gaps.")
    interval = np.clip(np.searchsorted(epochs, year, side="right") - 1, 0, epochs.size - 2)
    field = np.empty_like(position)
    for k in np.unique(interval):
        here = interval == k
        slope = (cartesian[k + 1] - cartesian[k]) / (epochs[k + 1] - epochs[k])
        field[here] = sum_field(position[here] / IGRF_RADIUS, year[here] - epochs[k], cartesian[k], slope)
    return field * 1e-9


def decimal_year(time_gps):
    """Calendar year and the fraction of it that has passed (365 or 366 days), in GPS time.

    Parameters
    ----------
    time_gps : (...,) GPS s

    Returns
    -------
    year : (...,) the 18 s between GPS and UTC change the field by less than 1e-4 nT
    """
    time = np.asarray(time_gps, float)
    years, starts = _year_starts()
    at = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, years.size - 2)
    return years[at] + (time - starts[at]) / (starts[at + 1] - starts[at])


def coefficient_file(generation):
    """Path of the coefficients of a generation."""
    if generation not in GENERATIONS:
        refuse("IGRF", f"generation {generation}", "13 or 14", "Set igrf_generation.", generation=generation)
    return Path(__file__).with_name(f"IGRF{generation}.shc")


def coefficient_digest(generation):
    """SHA-256 of the coefficient file, for the provenance of a product."""
    return hashlib.sha256(coefficient_file(generation).read_bytes()).hexdigest()


@lru_cache
def gauss_coefficients(generation):
    """Epochs (k,) in years, g and h (k, 14, 14) in nT by degree and order, Schmidt semi-normalised."""
    lines = [line.split() for line in coefficient_file(generation).read_text().splitlines() if not line.startswith("#")]
    epochs = np.array(lines[1], float)
    g, h = np.zeros((2, epochs.size, DEGREE + 1, DEGREE + 1))
    for degree, order, *values in lines[2:]:
        table = h if int(order) < 0 else g
        table[:, int(degree), abs(int(order))] = np.array(values, float)
    return epochs, g, h


@lru_cache
def _year_starts():
    years = np.arange(1890, 2051)
    starts = (years - 1970).astype("datetime64[Y]").astype("datetime64[s]") - np.datetime64("2000-01-01T12:00:00")
    return years, starts.astype(float)


@lru_cache
def _cartesian(generation):
    """Coefficients of the components: B = sum c V_nm + s W_nm, degrees to 14; (k, 15, 15, 6) in nT.

    V + i W = (a/r)^(n+1) P_nm exp(i m phi) with P_nm not normalised. Their gradients are again such functions of degree
    n + 1 (Montenbruck and Gill 2000, eq. 3.33), so that the derivative is taken once, on the coefficients.
    """
    epochs, g, h = gauss_coefficients(generation)
    out = np.zeros((epochs.size, DEGREE + 2, DEGREE + 2, 6))  # last axis: x, y, z of V, then of W
    for n in range(1, DEGREE + 1):
        for m in range(n + 1):
            schmidt = np.sqrt((2 - (m == 0)) * factorial(n - m) / factorial(n + m))
            C, S = schmidt * g[:, n, m], schmidt * h[:, n, m]
            _add_gradient(out[:, n + 1], C, S, n, m)
    return epochs, np.ascontiguousarray(out)


def _add_gradient(out, C, S, n, m):
    """Add -grad of (C V_nm + S W_nm) to the coefficients of degree n + 1."""
    x, y, z, xw, yw, zw = range(6)
    out[:, m, z] += (n - m + 1) * C
    out[:, m, zw] += (n - m + 1) * S
    half = 1.0 if m == 0 else 0.5
    out[:, m + 1, x] += half * C
    out[:, m + 1, xw] += half * S
    out[:, m + 1, y] -= half * S
    out[:, m + 1, yw] += half * C
    if m > 0:
        down = 0.5 * (n - m + 1) * (n - m + 2)
        out[:, m - 1, x] -= down * C
        out[:, m - 1, xw] -= down * S
        out[:, m - 1, y] -= down * S
        out[:, m - 1, yw] += down * C


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
