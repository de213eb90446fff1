"""Gravity of the Earth: point mass and flattening along an orbit in i, fields of full degree in the Earth-fixed frame.

A derivative of a series of solid harmonics is again such a series, one degree higher. So the coefficients are
differentiated, twice, and one compiled sum serves all six second derivatives; each of the six has coefficients of its
own, so that the trace is a test and not a construction.

The series share one recursion. With x' = x R/r2, z' = z R/r2, q' = R2/r2 and for every order m

    a_m = 1, a_n = alpha_nm z' a_(n-1) - beta_nm q' a_(n-2)          n > m
    sum_k = (R/r) sum_m Re[(x' + i y')^m sum_n K_knm a_n]

there is no division by the sine of the colatitude: poles are points like any other. Holmes and Featherstone 2002,
J. Geodesy 76, eqs. 11-13, with the powers of sin(colatitude) in (x' + i y')^m. Nearly all of the time goes into the
recursion and the sum over n, a product of matrices for a block of points.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from gravcal.physics import check_shape, refuse
from gravcal.physics.constants import EARTH_RADIUS, GM, J2

NORTH = np.array([0.0, 0.0, 1.0])  # the z axis of i; the pole of date: 20 arcseconds a year, 1e-7 of the J2 term


def acceleration_i(position_i):
    """Gravitational acceleration (..., 3) m s-2 of point mass and J2 at positions (..., 3) m from the Earth's centre.

    Notes
    -----
    g = -mu r/r^3 - 3/2 J2 mu R^2/r^5 [(1 - 5 z^2/r^2) r + 2 z k], z = r.k; Montenbruck and Gill 2000, eq. 3.29 ff.
    """
    r = check_shape("position_i", position_i, (..., 3))
    distance, z = _distance(r)[..., None], r[..., 2:]
    factor = -1.5 * J2 * GM * EARTH_RADIUS**2 / distance**5
    return -GM * r / distance**3 + factor * ((1 - 5 * z**2 / distance**2) * r + 2 * z * NORTH)


def gradient_i(position_i):
    """Gravity-gradient tensor dg/dr (..., 3, 3) s-2, point mass and J2, at positions (..., 3) m.

    Notes
    -----
    G = mu/r^3 (3 e e^T - 1) (equations.md section 1) plus the derivative of the J2 term of acceleration_i, both as the
    series of `gradient_e` of C_00 = 1 and C_20 = -J2 / sqrt(5). Symmetric, without trace; each element by itself.
    """
    position = check_shape("position_i", position_i, (..., 3))
    _distance(position)
    return _gradient(FLATTENED, position)


def rotate_tensor(R_ab, tensor_b):
    """Second-order tensor (..., 3, 3) in another frame: R T R^T, R = R_ab from b to a."""
    R = check_shape("rotate_tensor", R_ab, (..., 3, 3))
    return R @ tensor_b @ np.swapaxes(R, -1, -2)


def _distance(r):
    """Distance (...,) m of positions (..., 3) m, checked to be that of an orbit."""
    distance = np.linalg.norm(r, axis=-1)
    if np.any(distance < 1e6):
        nearest = f"{distance.min():.3f} m from the Earth's centre"
        refuse("position_i", nearest, "an orbit", "Give metres, not kilometres.")
    return distance


# fields of full degree

LIMIT = 600  # highest degree: the recursion stays within the range of float64 at the poles up to there
PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")


@dataclass(frozen=True)
class Field:
    """Coefficients of a gravity field, fully normalised (4 pi), as in ICGEM files."""

    gm: float  #: m3 s-2
    radius: float  #: m, reference radius of the coefficients
    cosine: np.ndarray  #: (n + 1, n + 1) 1, C_nm; C_00 = 1
    sine: np.ndarray  #: (n + 1, n + 1) 1, S_nm
    cosine_sigma: np.ndarray | None = None  #: (n + 1, n + 1) 1, standard deviations, zero where not given
    sine_sigma: np.ndarray | None = None  #: (n + 1, n + 1) 1
    name: str = ""

    @property
    def degree(self) -> int:
        """Highest degree."""
        return self.cosine.shape[0] - 1

    @cached_property
    def tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arguments of `sum_series` for the six second derivatives of PAIRS."""
        once = {axis: derivative(self.cosine - 1j * self.sine, axis) for axis in "xyz"}
        return kernel_tables([derivative(once[first], second) for first, second in PAIRS])


FLATTENED = Field(GM, EARTH_RADIUS, np.array([[1.0, 0, 0], [0, 0, 0], [-J2 / np.sqrt(5), 0, 0]]), np.zeros((3, 3)))


def gradient_e(field, position_e):
    """Gravity-gradient tensor dg/dr (..., 3, 3) s-2 of a Field at positions (..., 3) m, from six independent series.

    Notes
    -----
    U = GM/R sum_nm (R/r)^(n+1) P_nm(sin phi) [C_nm cos(m lambda) + S_nm sin(m lambda)]; Barthelmes 2013, GFZ
    STR09/02, eq. 108. G = grad grad U, from coefficients differentiated twice: Cunningham 1970, Celest. Mech. 2, 207.
    """
    position = check_shape("position_e", position_e, (..., 3))
    if not np.all(np.einsum("...i,...i->...", position, position) > 1e10):
        refuse("position_e", "a point within 100 km of the centre or not finite", "positions in metres", "Convert it.")
    if field.degree > LIMIT:
        refuse(field.name or "field", f"degree {field.degree}", f"at most {LIMIT}", "Use truncated(field, 0, n).")
    return _gradient(field, position)


def _gradient(field, position):
    """Gradient tensor (..., 3, 3) s-2 of a Field at positions (..., 3) m in its frame, not checked."""
    sums = sum_series(np.ascontiguousarray(position.reshape(-1, 3) / field.radius), *field.tables)
    six = (field.gm / field.radius**3 * sums).reshape(*position.shape[:-1], len(PAIRS))
    return six[..., [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def truncated(field, lowest, highest):
    """Field of the degrees from lowest to highest, both kept."""
    kept = slice(0, min(highest, field.degree) + 1)
    blank = np.arange(field.degree + 1)[kept, None] < lowest
    parts = field.cosine, field.sine, field.cosine_sigma, field.sine_sigma
    parts = [None if part is None else np.where(blank, 0.0, part[kept, kept]) for part in parts]
    return Field(field.gm, field.radius, *parts, name=f"{field.name} degrees {lowest} to {highest}")


def zonal(field, degree):
    """Field of the zonal term of one degree."""
    cosine = np.zeros((degree + 1, degree + 1))
    cosine[degree, 0] = field.cosine[degree, 0]
    return Field(field.gm, field.radius, cosine, np.zeros_like(cosine), name=f"{field.name} zonal degree {degree}")


def error_covariance(field, distance):
    """Covariance of the gradient tensor from the standard deviations of the coefficients, averaged over the sphere.

    Parameters
    ----------
    field : Field with standard deviations
    distance : m, from the Earth's centre

    Returns
    -------
    variance_rr, variance_rt, variance_tt : s-4, of radial-radial, of each radial-tangential element and of the
        tangential shear; the tangential diagonal is -G_rr/2 plus and minus an independent element of variance_tt

    Notes
    -----
    Per degree, with s2_n the sum of the variances over the order: (GM/R3)^2 (R/r)^(2n+6) s2_n times
    (n+1)^2 (n+2)^2, n (n+1) (n+2)^2 / 2 and (n-1) n (n+1) (n+2) / 8. For errors alike in all directions; the sum over
    all nine elements, (n+1)(n+2)(2n+1)(2n+3), is that of any solid harmonic.
    """
    n = np.arange(field.degree + 1.0)
    power = sum(np.sum(part**2, axis=1) for part in (field.cosine_sigma, field.sine_sigma) if part is not None)
    weight = power * (field.gm / field.radius**3) ** 2 * (field.radius / distance) ** (2 * n + 6)
    radial = (n + 1) ** 2 * (n + 2) ** 2
    mixed = n * (n + 1) * (n + 2) ** 2 / 2
    shear = (n - 1) * n * (n + 1) * (n + 2) / 8
    return tuple(float(np.sum(weight * factor)) for factor in (radial, mixed, shear))


def derivative(K, axis):
    """Coefficients of R d/d(axis) of the series Re sum K_nm Z_nm, Z_nm the normalised V_nm + i W_nm.

    (d/dx + i d/dy) Z_nm = -Z_(n+1)(m+1), (d/dx - i d/dy) Z_nm = (n-m+1)(n-m+2) Z_(n+1)(m-1) for m > 0,
    d/dz Z_nm = -(n-m+1) Z_(n+1)m before normalisation.
    """
    size = K.shape[0]
    n, m = np.arange(size)[:, None], np.arange(size)[None, :]
    inside = np.where(m <= n, K, 0)
    level = np.sqrt((2 * n + 1) / (2 * n + 3))
    out = np.zeros((size + 1, size + 1), dtype=complex)
    if axis == "z":
        out[1:, :-1] = -inside * level * np.sqrt(np.maximum((n + m + 1) * (n - m + 1), 0))
        return out
    up, down = (-0.5, 0.5) if axis == "x" else (0.5j, 0.5j)
    twice = np.where(m == 0, np.sqrt(2.0), 1.0)  # Z_n0 has no down part; and its norm lacks the factor sqrt 2
    out[1:, 1:] = up * twice * inside * level * np.sqrt((n + m + 1) * (n + m + 2))
    to_zonal = np.where(m == 1, np.sqrt(2.0), 1.0)
    lowered = down * to_zonal * inside * level * np.sqrt(np.maximum((n - m + 1) * (n - m + 2), 0))
    out[1:, : size - 1] += lowered[:, 1:]
    out[:, 0] = out[:, 0].real
    return out


def kernel_tables(series):
    """`sum_series` arguments from coefficients K of each series: by order and degree above it, recursion factors."""
    orders = series[0].shape[0]
    table, (alpha, beta) = np.zeros((orders, orders, 2 * len(series))), np.zeros((2, orders, orders))
    m = np.arange(1, orders)
    ratios = np.where(m == 1, 3.0, (2 * m + 1) / (2 * m))  # squared, of sectorial functions of neighbouring orders
    sectorial = np.sqrt(np.concatenate([[1.0], np.cumprod(ratios)]))
    for m in np.flatnonzero(np.any(series, axis=(0, 1))):
        n = np.arange(m, orders)
        for k, K in enumerate(series):
            table[m, : n.size, 2 * k] = sectorial[m] * K[n, m].real
            table[m, : n.size, 2 * k + 1] = -sectorial[m] * K[n, m].imag
        n = n[1:].astype(float)
        alpha[m, 1 : n.size + 1] = np.sqrt((2 * n - 1) * (2 * n + 1) / ((n - m) * (n + m)))
        inner = (2 * n + 1) * (n + m - 1) * (n - m - 1) / ((2 * n - 3) * (n + m) * (n - m))
        beta[m, 1 : n.size + 1] = np.sqrt(inner)
    return table, alpha, beta


BLOCK = 128  # points side by side: a row of the recursion and the sums stay in the nearest memory


@njit(cache=True, fastmath={"contract"})
def sum_series(point, table, alpha, beta):
    """Sums (n, k) of series at points (n, 3) in units of the reference radius.

    table (orders, degrees, 2 k): real and negative imaginary parts of K in turn, degree counted from the order;
    alpha, beta (orders, degrees): factors of the recursion.
    """
    orders, count = table.shape[0], table.shape[2] // 2
    out, total = np.empty((point.shape[0], count)), np.empty((count, BLOCK))
    rows, lumped = np.ones((orders, BLOCK)), np.empty((2 * count, BLOCK))
    x, y, z, q, real, imaginary = np.empty((6, BLOCK))
    used = [np.any(order) for order in table]
    for start in range(0, point.shape[0], BLOCK):
        size = min(BLOCK, point.shape[0] - start)
        for i in range(BLOCK):  # the last point fills the block
            px, py, pz = point[start + min(i, size - 1)]
            q[i] = 1.0 / (px * px + py * py + pz * pz)
            x[i], y[i], z[i] = px * q[i], py * q[i], pz * q[i]
            real[i], imaginary[i] = np.sqrt(q[i]), 0.0
        total[:] = 0.0
        for m in range(orders):
            for n in range(1, orders - m if used[m] else 0):
                row, last, before = rows[n], rows[n - 1], rows[max(n - 2, 0)]
                a, b = alpha[m, n], beta[m, n]
                for i in range(BLOCK):
                    row[i] = a * z[i] * last[i] - b * q[i] * before[i]
            if used[m]:
                np.dot(table[m, : orders - m].T, rows[: orders - m], lumped)
                for k in range(count):
                    for i in range(BLOCK):
                        total[k, i] += real[i] * lumped[2 * k, i] + imaginary[i] * lumped[2 * k + 1, i]
            for i in range(BLOCK):  # (x' + i y')^m to the next order
                kept = real[i] * x[i] - imaginary[i] * y[i]
                imaginary[i] = real[i] * y[i] + imaginary[i] * x[i]
                real[i] = kept
        out[start : start + size] = total[:, :size].T
    return out
