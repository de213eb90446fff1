"""Phase centres of both ranging antennas from plain arrays: lines of sight, and ranging less orbit."""

import numpy as np

from gravcal.calibrations.kbr_phase_centre.pointing import PARAMETERS
from gravcal.estimation.estimate import Estimate
from gravcal.estimation.estimate import estimate as solve
from gravcal.estimation.least_squares import polynomial
from gravcal.estimation.noise import NoiseModel


def estimate(
    line_of_sight_b: np.ndarray,
    range_less_orbit: np.ndarray,
    time: np.ndarray,
    noise: NoiseModel,
    drift_degree: int = 15,
) -> Estimate:
    """Vectors from the centres of mass to the phase centres, from one wiggle or several minutes of any turning.

    Parameters
    ----------
    line_of_sight_b : (n, 2, 3) 1, unit vector from each satellite to the other, in its own SRF
    range_less_orbit : (n,) m, measured range, light time corrected, less the distance of the centres of mass; NaN where
        missing
    time : (n,) s, evenly spaced
    noise : NoiseModel of the range, m
    drift_degree : of the polynomial that stands for the range bias and slow orbit errors

    Returns
    -------
    estimate : Estimate of x_a, y_a, z_a, x_b, y_b, z_b in m (SRF); what one wiggle does not turn is NaN or has a large
        error

    Notes
    -----
    rho - norm(r_b - r_a) = -e_a . c_a - e_b . c_b; Remote Sens. 2022, 14, 3395, eq. 10, each line towards the other
    satellite. The part square in the offsets (c^2 / 2 rho, 0.01 mm) is left to the pipeline.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import kbr_phase_centre
    >>> from gravcal.estimation.noise import fit_noise
    >>> rng, time = np.random.default_rng(2), 5.0 * np.arange(756)
    >>> noise = fit_noise([1e-6 * rng.standard_normal(3000)], 1, 5.0)
    >>> pitch = np.deg2rad(2 + np.sin(2 * np.pi * time / 250))
    >>> turned = np.stack([np.cos(pitch), 0 * pitch, -np.sin(pitch)], axis=1)
    >>> line = np.stack([turned, np.tile([1.0, 0.0, 0.0], (756, 1))], axis=1)
    >>> rho = -turned @ [1.444, 0.0, 0.0003] - 1.445 + 1e-6 * rng.standard_normal(756)
    >>> found = kbr_phase_centre.estimate(line, rho, time, noise)
    >>> bool(abs(found.value[2] - 0.0003) < 4 * found.sigma[2]), bool(np.isnan(found.value[3]))
    (True, True)
    """
    time, line = np.asarray(time, dtype=float), np.asarray(line_of_sight_b, dtype=float)
    columns = -line.reshape(len(line), 1, 6)
    drift = polynomial(time, drift_degree, time[0], time[-1])
    return solve(np.asarray(range_less_orbit, dtype=float)[:, None], columns, [noise], drift, PARAMETERS, "m")
