"""What the instruments write of a simulated motion: noise, bias, quantisation, tags."""

from __future__ import annotations

import numpy as np

from gravcal.estimation.noise import coloured
from gravcal.physics import frames


def quantised(values: np.ndarray, step) -> np.ndarray:
    """Values rounded to multiples of the step (any unit)."""
    return np.round(values / step) * step


def table_density(frequency_hz, amplitude):
    """One-sided power density from amplitude densities at nodes, joined in log-log.

    Parameters
    ----------
    frequency_hz : (k,) Hz
    amplitude : (k,) unit Hz-1/2

    Returns
    -------
    density : callable, Hz -> unit^2 Hz-1
    """
    log_f, log_a = np.log(frequency_hz), np.log(np.maximum(amplitude, 1e-300))
    return lambda f: np.exp(2 * np.interp(np.log(f), log_f, log_a))


def accelerometer_noise(count: int, step_s: float, chosen, kind: str, rng) -> np.ndarray:
    """Noise of the three axes of the linear or angular channels.

    Parameters
    ----------
    count, step_s : samples and their spacing in s
    chosen : parameters of the simulation
    kind : "linear" or "angular"
    rng : source of randomness

    Returns
    -------
    noise_b : (count, 3) m s-2 or rad s-2
    """
    tables = [getattr(chosen, f"{kind}_noise_{axis}") for axis in "xyz"]
    columns = [coloured(table_density(chosen.noise_frequency_hz, t), count, step_s, rng) for t in tables]
    return chosen.noise_scale * np.stack(columns, axis=1)


def star_camera_noise(count: int, chosen, rng) -> np.ndarray:
    """White and first-order Markov noise of the attitude at 1 Hz.

    Returns
    -------
    angle_b : (count, 3) rad
    """
    from scipy.signal import lfilter

    keep = np.exp(-1.0 / chosen.star_camera_slow_s)
    drive = rng.standard_normal((count + 200, 3)) * chosen.star_camera_slow_rad * np.sqrt(1 - keep**2)
    slow = lfilter([1.0], [1.0, -keep], drive, axis=0)[200:]
    return chosen.noise_scale * (slow + chosen.star_camera_white_rad * rng.standard_normal((count, 3)))


def star_camera(quaternion: np.ndarray, angle_b: np.ndarray, rng) -> np.ndarray:
    """Measured quaternions: the error angle applied in the body, the sign of a few runs flipped.

    Parameters
    ----------
    quaternion : (n, 4) true attitude
    angle_b : (n, 3) rad
    rng : source of randomness
    """
    measured = frames.quaternion_product(quaternion, frames.from_rotation_vector(angle_b))
    sign = np.where(np.cumsum(rng.random(len(measured)) < 2e-4) % 2 == 1, -1.0, 1.0)
    return measured * sign[:, None]


def coil_currents(axis_current_ma: np.ndarray) -> dict[str, np.ndarray]:
    """Readings of the six coils: positive currents in A, negative ones with their sign in B (GRACE-FO).

    Parameters
    ----------
    axis_current_ma : (n, 3) mA
    """
    positive, negative = np.maximum(axis_current_ma, 0), np.minimum(axis_current_ma, 0)
    coils = {f"torque{i + 1}A": positive[:, i] for i in range(3)}
    return coils | {f"torque{i + 1}B": negative[:, i] for i in range(3)}
