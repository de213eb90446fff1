"""The processing as printed in the source paper, for comparison: its operators, weights, errors and row selection."""

import numpy as np

from gravcal.estimation import least_squares
from gravcal.estimation.resampling import lowpass_resampler
from gravcal.physics import kinematics, sensing

LOWPASS_HZ = 0.166  # Sec. 4.3
WEIGHTS = np.array([1.0, 0.09, 1.0])  # Sec. 3.1
ORBITAL_PERIOD_S = 97.13 * 60.0  # Sec. 3.4; erratum C-7
HIGH_LATITUDE = np.radians(45.0)  # between the areas of Table 3


def calibrated(measured: np.ndarray, torquer: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Angular accelerometer adjusted to the torquer axis by axis with orbital Fourier terms, eqs. 31-33.

    Parameters
    ----------
    measured, torquer : (n, 3) rad s-2
    time : (n,) s
    """
    phase = 2 * np.pi * (time - time[0]) / ORBITAL_PERIOD_S
    slow = [np.ones_like(phase), np.sin(phase), np.sin(2 * phase), np.cos(phase), np.cos(2 * phase)]
    adjusted = np.empty_like(measured)
    for axis in range(3):
        columns = np.stack([measured[:, axis], *slow], axis=1)
        scale = np.linalg.norm(columns, axis=0)
        unknown = np.linalg.lstsq(columns / np.where(scale > 0, scale, 1), torquer[:, axis], rcond=None)[0]
        adjusted[:, axis] = (columns / np.where(scale > 0, scale, 1)) @ unknown
    return adjusted


def differenced(sca_time, quaternion, time) -> np.ndarray:
    """Angular acceleration by central differences of the attitude, eq. 15, interpolated to the epochs.

    Parameters
    ----------
    sca_time : (m,) s; quaternion : (m, 4), NaN where missing
    time : (n,) s
    """
    known = np.isfinite(quaternion).all(axis=1)
    _, rate_dot = kinematics.published_rates_from_attitude(sca_time[known], quaternion[known])
    inside = np.isfinite(rate_dot).all(axis=1)
    at = sca_time[known][inside]
    return np.stack([np.interp(time, at, rate_dot[inside, axis]) for axis in range(3)], axis=1)


def components(kind: int, latitude: float) -> list[int]:
    """Components that the paper prints for a manoeuvre (Table 7): two of pitch and roll at high latitude, else all."""
    if abs(latitude) <= HIGH_LATITUDE:
        return [0, 1, 2]
    return {0: [1, 2], 1: [0, 2]}.get(kind, [0, 1, 2])


def solve_one(time, good, linear, rates, solved) -> tuple[np.ndarray, np.ndarray]:
    """Offset and formal covariance of one manoeuvre, eqs. 3-9, samples counted as independent (erratum C-12).

    Parameters
    ----------
    time : (n,) s; good : (n,) bool
    linear : (n, 3) m s-2
    rates : (n, 3) rad s-1 and (n, 3) rad s-2
    solved : components estimated, the others held at zero

    Returns
    -------
    offset : (3,) m, proof mass to centre of mass
    covariance : (3, 3) m2, infinite variance for components not estimated
    """
    reading = linear - linear[good].mean(axis=0)
    operator = lowpass_resampler(time, good, time, lowpass_hz=LOWPASS_HZ, half_width_s=6.0)
    filtered = operator(np.nan_to_num(np.concatenate([reading, *rates], axis=1)))[operator.valid]
    at = time[operator.valid]
    series = least_squares.without(np.stack([np.ones_like(at), at - at[0]], axis=1), filtered)
    A = sensing.published_offset_matrix(series[:, 3:6], series[:, 6:9]).reshape(-1, 3)[:, solved]
    weight, observed = np.tile(WEIGHTS, len(series)), series[:, :3].ravel()
    inverse = least_squares.stable_inverse(A.T @ (weight[:, None] * A))
    value = inverse @ A.T @ (weight * observed)
    residual = observed - A @ value
    offset, covariance = np.full(3, np.nan), np.diag(np.full(3, np.inf))
    offset[solved] = value
    covariance[np.ix_(solved, solved)] = inverse * float(weight @ residual**2) / (observed.size - len(solved))
    return offset, covariance


def selected(kind, latitude, offset, sigma) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of the rows that the paper keeps: x of pitch, y and z of roll, at high latitude.

    The error is the weighted mean of the errors, as printed (erratum C-9).

    Parameters
    ----------
    kind : (k,) 0 roll, 1 pitch, 2 yaw
    latitude : (k,) rad
    offset, sigma : (k, 3) m

    Returns
    -------
    mean, error : (3,) m, NaN where no row is kept
    """
    mean, error = np.full(3, np.nan), np.full(3, np.nan)
    high = np.abs(latitude) > HIGH_LATITUDE
    for axis, wanted in enumerate((1, 0, 0)):
        rows = high & (kind == wanted) & np.isfinite(offset[:, axis])
        if rows.any():
            weight = 1 / sigma[rows, axis] ** 2
            mean[axis] = np.sum(weight * offset[rows, axis]) / weight.sum()
            error[axis] = np.sum(weight * sigma[rows, axis]) / weight.sum()
    return mean, error
