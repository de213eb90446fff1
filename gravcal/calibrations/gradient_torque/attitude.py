"""Attitude over time from star camera and angular accelerations together: angles, rates and their covariance.

Three small angles from the orbit frame are splines of degree five in time. Torque changes slowly; how slowly is
estimated from the record. Least squares over the record has banded normal equations, and the elements needed of their
inverse lie inside the band.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline, CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.blas import dsbmv
from scipy.ndimage import binary_opening, maximum_filter1d
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from gravcal.errors import EstimationError, refuse
from gravcal.physics import frames, kinematics
from gravcal.physics.frames import cross_matrix

ITERATIONS = 3  # Gauss-Newton; angles of 1e-2 rad make the second one exact to 1e-4 of the first
ANGLE_PRIOR = 0.1  # rad, keeps splines in gaps from floating away; 1e-10 of the weight of data
NODE_STEP = 10.0  # s; 1e-2 rad of orbit, a polynomial of degree six over seven nodes is exact to rounding
DEGREE = 5  # second derivatives are cubic
ACTIVE = DEGREE + 1  # splines that differ from zero at an epoch
WIDTH = 3 * ACTIVE
CORNERS = np.log([0.3, 0.1])  # of torque, over the rate of the knots: where the search begins
LIMITS = np.log([0.05, 10.0])  # below normal equations lose their digits, above splines are free
TOLERANCE = {"xatol": 0.03, "fatol": 0.5}  # of the logarithms of corners and of their evidence
RARE = 45.0  # squared sum of angular readings beyond the fit over its median: 4.5 sigma, once in two days by chance
LOST = 100  # knot intervals in a row without attitude: the prior is set free there, or equations lose all digits
JERK = np.diff(np.eye(ACTIVE), 3, axis=0)  # coefficients of the third derivative, a quadratic spline
GRAM = np.array([[6, 13, 1], [13, 54, 13], [1, 13, 6]]) / 120  # its square over a knot interval, integrated
BEND = np.outer([1, -2, 1], [1, -2, 1])  # that of the fifth derivative, which is constant


def orbit_frame(position_i, velocity_i):
    """Rotation (n, 3, 3) from i to the orbit frame: z to nadir, y against the orbit normal, x forward; m, m s-1."""
    return frames.flight_frame(np.concatenate([position_i, velocity_i], axis=1))[:, ::-1] * [[1], [1], [-1]]


def orbit_rates(time, position_i, velocity_i):
    """Rate (n, 3) rad s-1 of the orbit frame against i, in its own axes, and its derivative; orbits may have gaps."""
    since = time - time[0]
    every = max(1, int(NODE_STEP / np.median(np.diff(time))))
    kept = np.unique(np.append(np.arange(0, time.size, every), time.size - 1))
    path = CubicHermiteSpline(since[kept], position_i[kept], velocity_i[kept])
    speed = CubicSpline(since[kept], velocity_i[kept])
    nodes = np.linspace(0, since[-1], max(8, int(np.ceil(since[-1] / NODE_STEP)) + 1))
    q = frames.quaternion_from_R_bi(orbit_frame(path(nodes), speed(nodes)))
    rates = kinematics.rates_from_attitude(nodes, frames.continuous(q), half_width=3, degree=6)
    return tuple(CubicSpline(nodes, rate)(since) for rate in rates)


def angles(quaternion, R_oi):
    """Angles (n, 3) rad from the orbit frame to the body, R_bo = R1(roll) R2(pitch) R3(yaw); R_oi (n, 3, 3)."""
    R = frames.R_bi_from_quaternion(quaternion) @ np.swapaxes(R_oi, -1, -2)
    roll, pitch = np.arctan2(R[:, 1, 2], R[:, 2, 2]), -np.arcsin(np.clip(R[:, 0, 2], -1, 1))
    return np.stack([roll, pitch, np.arctan2(R[:, 0, 1], R[:, 0, 0])], axis=1)


def R_bo(angle):
    """Rotation (n, 3, 3) from orbit to body components of angles (n, 3) rad."""
    return np.swapaxes(Rotation.from_euler("ZYX", angle[:, ::-1]).as_matrix(), 1, 2)


def axes(angle):
    """Axes (n, 3, 3) in b, as columns, about which the three angles (n, 3) rad turn."""
    cx, sx, cy, sy = np.cos(angle[:, 0]), np.sin(angle[:, 0]), np.cos(angle[:, 1]), np.sin(angle[:, 1])
    one, zero = np.ones_like(cx), np.zeros_like(cx)
    rows = [[one, zero, -sy], [zero, cx, sx * cy], [zero, -sx, cx * cy]]
    return np.moveaxis(np.array(rows), -1, 0)


def body_rates(angle, angle_dot, angle_ddot, rate_o, rate_dot_o):
    """Rate rad s-1 and angular acceleration rad s-2 (n, 3) of the body against i, in b.

    From angles (n, 3) rad with two derivatives, and the same (n, 3) of the orbit frame o, in o.
    w = E phi' + R_bo w_o; w' = E phi'' + E' phi' - (E phi') x (R_bo w_o) + R_bo w_o'.
    """
    E, R = axes(angle), R_bo(angle)
    carried = np.matvec(R, rate_o)
    relative = np.matvec(E, angle_dot)
    by_x = angle_dot * [1.0, 0.0, 0.0]  # rates after one turn and after two
    by_y = by_x + E[:, :, 1] * angle_dot[:, 1:2]
    axes_dot = -np.cross(by_x, E[:, :, 1]) * angle_dot[:, 1:2] - np.cross(by_y, E[:, :, 2]) * angle_dot[:, 2:3]
    rate_dot = np.matvec(E, angle_ddot) + axes_dot - np.cross(relative, carried) + np.matvec(R, rate_dot_o)
    return relative + carried, rate_dot


@dataclass(frozen=True)
class Basis:
    """Splines of degree five with even knots, at the epochs."""

    values: np.ndarray  #: (3, n, 6) active splines and their first and second derivatives
    start: np.ndarray  #: (n,) index of the first active spline
    order: np.ndarray  #: (n,) number of an epoch within its knot interval
    count: int  #: number of splines
    step: float  #: s, distance of the knots


def basis(time, knot_step):
    """Basis of the epochs (n,) s with knots every `knot_step` s."""
    pieces = max(1, int(np.ceil((time[-1] - time[0]) / knot_step)))
    unit = (time - time[0]) / (time[-1] - time[0]) * pieces
    start = np.minimum(unit.astype(int), pieces - 1)
    step = (time[-1] - time[0]) / pieces
    shape = BSpline.basis_element(np.arange(DEGREE + 2), extrapolate=False)
    at = (unit - start)[:, None] + np.arange(DEGREE, -1, -1)
    values = [np.nan_to_num(shape.derivative(k)(at) if k else shape(at)) / step**k for k in range(3)]
    order = np.arange(time.size) - np.searchsorted(start, start)
    return Basis(np.array(values), start, order, pieces + DEGREE, step)


def _by_interval(table, rows):
    """Rows (n, ...) of the epochs sorted by knot interval, (intervals, most epochs in one, ...), padded with zeros."""
    placed = np.zeros((table.count - DEGREE, table.order.max() + 1, *rows.shape[1:]))
    placed[table.start, table.order] = rows
    return placed


def _design(operator, table):
    """Design matrix (intervals, epochs, 3, 18) of observed vectors by the active splines of their knot interval."""
    return _by_interval(table, np.einsum("ndri,dnj->nrji", operator, table.values).reshape(len(operator), 3, WIDTH))


def normal(blocks, table):
    """Banded normal matrix, lower band (18, 3 count), and right side (3 count,).

    Blocks are operator (n, 3, 3, 3) and residual (n, 3) over their standard deviations; operator[:, d] is the
    derivative of the observed vector by the d-th derivative of the angles.
    """
    band, right = np.zeros((WIDTH, 3 * table.count)), np.zeros(3 * table.count)
    last = 3 * (table.count - ACTIVE) + 1
    for operator, residual in blocks:
        rows = _design(operator, table).reshape(table.count - DEGREE, -1, WIDTH)
        band += _banded(np.swapaxes(rows, 1, 2) @ rows, 3)
        products = np.einsum("pki,pk->pi", rows, _by_interval(table, residual).reshape(len(rows), -1))
        for i in range(WIDTH):
            right[i : i + last : 3] += products[:, i]
    return band, right


def _banded(squares, shift):
    """Lower band of the sum of squares (m, k, k) of knot intervals, each `shift` unknowns after the one before."""
    pieces, width = squares.shape[:2]
    last = shift * (pieces - 1) + 1
    band = np.zeros((width, last + width - 1))
    for i in range(width):
        for j in range(i + 1):
            band[i - j, j : j + last : shift] += squares[:, i, j]
    return band


def torque_prior(corners, white, free, step):
    """Lower bands of the prior precision of one angle: of coefficients (6, count), third derivatives (3, count - 3).

    Corners (2,) are logarithms of frequencies over the rate of the knots, white rad2 s-3 the density of the angular
    noise, free (count - 5,) the knot intervals in which torque may change at will, step s the distance of the knots.
    Torque over inertia has the density white / [(w/w1)^2 + (w/w3)^6], a random walk that falls steeply beyond a corner:
    -2 log p is the integral of [(d3/w1)^2 + (d5/w3^3)^2] / white, with d3 and d5 the derivatives of the angle.
    """
    w = 2 * np.pi * np.exp([corners, np.full(2, LIMITS[1])]) / step
    costs = step / white * np.stack([GRAM / w1**2 + BEND / step**4 / w3**6 for w1, w3 in w])
    kind = free.astype(int)
    return _banded((JERK.T @ costs @ JERK / step**6)[kind], 1), _banded(costs[kind], 1)


def _pull(inner, coefficients, step):
    """Prior precision P times coefficients c (count,), and c^T P c; by differences of c, which lose no digits."""
    jerk = np.diff(coefficients, 3) / step**3
    force = dsbmv(2, 1.0, inner, jerk, lower=1)
    return -np.diff(np.pad(force, 3), 3) / step**3, jerk @ force


def unlikeliness(corners, data, right, start, *prior):
    """Minus the log evidence (marginal likelihood) of the observations of one angle, less what no corner changes.

    Data and right are the normal equations of the observations at the coefficients start, prior the arguments of
    torque_prior. 2 log p = log|M| - log|N + P| + g^T (N + P)^-1 g - c^T P c with g = A^T r - P c, and M the prior of
    the third derivative: of angle, rate and torque at the start P says nothing.
    """
    splines, inner = torque_prior(corners, *prior)
    pull, square = _pull(inner, start, prior[-1])
    posterior, jerk = (cholesky_banded(band, lower=True, check_finite=False) for band in (data + splines, inner))
    fit = (right - pull) @ cho_solve_banded((posterior, True), right - pull, check_finite=False) - square
    return np.sum(np.log(posterior[0])) - np.sum(np.log(jerk[0])) - fit / 2


def solve(band, right):
    """Solution (m,) of the banded system, band (18, m), right (m,)."""
    if not np.isfinite(right).all():
        raise np.linalg.LinAlgError("readings of infinite size")
    return cho_solve_banded((cholesky_banded(band, lower=True, check_finite=False), True), right, check_finite=False)


def band_covariance(band):
    """Inverse of a lower band (18, 3 count) inside the band: blocks (b, 18, 18) on the diagonal, and right of it.

    Blocks of six splines make the matrix block-tridiagonal; Z_kk = D_k^-1 + U_k Z_(k+1)(k+1) U_k^T with D_k the Schur
    complements and U_k = D_k^-1 A_k(k+1).
    """
    size = band.shape[1]
    count = -(-size // WIDTH)
    padded = np.zeros((WIDTH, (count + 1) * WIDTH))
    padded[:, :size] = band
    padded[0, size:] = 1.0  # the last block is filled up with ones
    i, j = np.arange(WIDTH)[:, None], np.arange(WIDTH)[None, :]
    origin = WIDTH * np.arange(count)[:, None, None]
    lower = np.where(i >= j, padded[np.abs(i - j), origin + np.minimum(i, j)], 0)
    A = lower + np.swapaxes(np.tril(lower, -1), 1, 2)
    offset = WIDTH + j - i
    B = np.where(offset < WIDTH, padded[np.minimum(offset, WIDTH - 1), origin + i], 0)[: count - 1]
    inverse, right, upper = np.empty_like(A), np.empty_like(B), np.zeros_like(A)
    schur = A[0]
    for k in range(count):
        inverse[k] = np.linalg.inv(schur)
        if k + 1 < count:
            right[k] = inverse[k] @ B[k]
            schur = A[k + 1] - B[k].T @ right[k]
    for k in range(count - 2, -1, -1):
        upper[k] = -right[k] @ inverse[k + 1]
        inverse[k] = inverse[k] - upper[k] @ right[k].T
    return inverse, upper


def propagate(operator, table, covariance):
    """Covariance (n, 3, 3) of linear functions of the angles and their derivatives, operators as for `normal`."""
    diagonal, upper = covariance
    unknown = 3 * np.arange(table.count - DEGREE)[:, None] + np.arange(WIDTH)
    row = np.minimum(unknown[:, :, None], unknown[:, None, :])
    column = np.maximum(unknown[:, :, None], unknown[:, None, :])
    at = (row // WIDTH, row % WIDTH, column % WIDTH)
    C = np.where(row // WIDTH == column // WIDTH, diagonal[at], upper[at])
    rows = _design(operator, table)
    half = rows.reshape(len(rows), -1, WIDTH) @ C
    return (half.reshape(rows.shape) @ np.swapaxes(rows, -1, -2))[table.start, table.order]


@dataclass(frozen=True)
class Attitude:
    """Smoothed attitude."""

    angle: np.ndarray  #: (n, 3) rad, from the orbit frame
    angle_dot: np.ndarray  #: (n, 3) rad s-1
    R_bi: np.ndarray  #: (n, 3, 3)
    rate_b: np.ndarray  #: (n, 3) rad s-1
    rate_dot_b: np.ndarray  #: (n, 3) rad s-2
    #: derivative of (small rotation in b, rate_b, rate_dot_b) by the angles and their first two derivatives
    operators: tuple[np.ndarray, ...]  #: each (n, 3, 3, 3)
    table: Basis  #: splines
    covariance: tuple  #: blocks of the covariance of the splines
    chi2: float  #: of star camera and angular accelerations together
    dof: float  #: observations less what of them the fit takes up

    def covariance_of(self, by_angle, by_rate, by_rate_dot):
        """Covariance (n, 3, 3) of a vector with these derivatives (n, 3, 3) by rotation in b, rate and its change."""
        parts = zip((by_angle, by_rate, by_rate_dot), self.operators, strict=True)
        return propagate(sum(by[:, None] @ operator for by, operator in parts), self.table, self.covariance)


def smooth(time, quaternion, angular_b, orbit, free_test_mass, *, angle_sigma, angular_sigma, knot_step):
    """Least squares for the angles as splines, from attitudes and angular accelerations.

    Attitudes (n, 4), b to i, and accelerations (n, 3) of the test mass relative to the satellite are NaN where not
    usable; orbit is R_oi (n, 3, 3) with rate_o and rate_dot_o (n, 3), free_test_mass (R_bi, rate_b) -> (n, 3) rad s-2
    its acceleration when free. Sigmas (3,) are of each attitude and of each sample; knot_step is in s.

    Notes
    -----
    al_TM/B = al_TM - w_B'; equations.md, section 8.5. The rates come out consistent with the attitude. How slowly the
    torque of each axis changes is what makes the record most likely; where readings deny it splines have no prior.
    """
    table = basis(time, knot_step)
    R_oi, *rates_o = orbit
    usable = np.isfinite(quaternion).all(axis=1)
    if usable.sum() < 10:
        refuse("star camera", f"{usable.sum()} usable attitudes", "at least 10", "Check the file.", EstimationError)
    unit = np.where(usable[:, None], quaternion, [1.0, 0, 0, 0])
    measured = angles(unit / np.linalg.norm(unit, axis=1, keepdims=True), R_oi)
    coefficients, corners = np.zeros((table.count, 3)), np.tile(CORNERS, (3, 1))
    long_gap = binary_opening(~_by_interval(table, usable).any(axis=1), np.ones(LOST))
    white, free = angular_sigma**2 * np.median(np.diff(time)), np.repeat(long_gap[:, None], 3, axis=1)
    for iteration in range(ITERATIONS + 1):
        active = coefficients[table.start[:, None] + np.arange(ACTIVE)]
        angle, angle_dot, angle_ddot = np.einsum("dnk,nki->dni", table.values, active)
        rate_b, rate_dot_b = body_rates(angle, angle_dot, angle_ddot, *rates_o)
        R_bi = R_bo(angle) @ R_oi
        angle_residual = (measured - angle + np.pi) % (2 * np.pi) - np.pi
        angle_residual[~usable] = np.nan
        angular_residual = angular_b - (free_test_mass(R_bi, rate_b) - rate_dot_b)
        if iteration < ITERATIONS:  # the derivatives of the last step hold for its result
            E, R = axes(angle), R_bo(angle)
            w, wd = (cross_matrix(np.matvec(R, rate)) @ E for rate in rates_o)
            zero = np.zeros_like(E)
            operators = tuple(np.stack(part, axis=1) for part in ((E, zero, zero), (w, E, zero), (wd, w, E)))
        by_angle = np.zeros_like(operators[0])
        by_angle[:, 0] = np.eye(3)
        blocks = [_whitened(by_angle, angle_residual, angle_sigma)]
        blocks.append(_whitened(-operators[2], angular_residual, angular_sigma))
        if iteration < ITERATIONS:
            band, right = normal(blocks, table)
            band[0] += 1 / ANGLE_PRIOR**2
            right -= coefficients.ravel() / ANGLE_PRIOR**2
            if iteration:
                # knot intervals in which angular readings deny a torque that changes slowly, and their neighbours
                residual = blocks[1][1]
                rows = _by_interval(table, residual)
                excess = rows.sum(axis=1) ** 2 / np.maximum(np.count_nonzero(rows, axis=1), 1)
                usual = np.median(excess[rows.any(axis=(1, 2))], axis=0) if rows.any() else np.inf
                free |= maximum_filter1d(excess > RARE * usual, 5, axis=0)
            for k, start in enumerate(coefficients.T):
                prior = white[k], free[:, k], table.step
                if iteration:
                    data = band[::3, k::3].copy(), right[k::3].copy(), start, *prior
                    search = {"method": "Nelder-Mead", "bounds": [LIMITS] * 2, "options": TOLERANCE}
                    corners[k] = minimize(unlikeliness, corners[k], data, **search).x
                splines, inner = torque_prior(corners[k], *prior)
                band[::3, k::3] += splines
                right[k::3] -= _pull(inner, start, table.step)[0]
            coefficients = coefficients + solve(band, right).reshape(-1, 3)
    covariance = band_covariance(band)
    chi2 = sum(float(np.sum(residual**2)) for _, residual in blocks)
    rows = sum(int(np.count_nonzero(np.any(operator != 0, axis=(1, 3)))) for operator, _ in blocks)
    fitted = sum(float(np.einsum("nii->", propagate(operator, table, covariance))) for operator, _ in blocks)
    smoothed = (angle, angle_dot, R_bi, rate_b, rate_dot_b)
    return Attitude(*smoothed, operators, table, covariance, chi2, rows - fitted)


def _whitened(operator, residual, sigma):
    """Operator (n, 3, 3, 3) and residual (n, 3) over standard deviations (3,), zero where not usable."""
    weight = np.where(np.isfinite(residual), 1 / sigma, 0.0)
    return operator * weight[:, None, :, None], np.nan_to_num(residual) * weight
