"""Drag from plain arrays: readings of test masses, modelled motion and gravity gradient."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.gradient_torque.laws import drag_from
from gravcal.physics.sensing import offset_tensor


def drag(
    linear_b: np.ndarray,
    rate_b: np.ndarray,
    rate_dot_b: np.ndarray,
    gradient_b: np.ndarray,
    com_to_test_mass_b: np.ndarray,
) -> np.ndarray:
    """Non-gravitational acceleration of the centre of mass from one sensor or two.

    Parameters
    ----------
    linear_b : (n, k, 3) m s-2, test masses relative to the spacecraft
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2
    gradient_b : (n, 3, 3) s-2, dg/dr
    com_to_test_mass_b : (k, 3) m

    Returns
    -------
    drag_b : (n, 3) m s-2

    Notes
    -----
    a_drag = -mean(a_k) + (G - M) mean(r_k); S-GRS paper, eqs. 4-6 and 10, corrected (errata S-2, S-3). Errors of one
    sensor are those of T r: `gravcal.calibrations.gradient_torque.estimate` adds them up.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import gradient_torque
    >>> gradient = np.diag([-1.2e-6, -1.2e-6, 2.4e-6])
    >>> place, still = np.array([[0.1, 0.0, 0.0]]), np.zeros((5, 3))
    >>> reading = np.tile(gradient @ place[0] - [1e-7, 0.0, 0.0], (5, 1, 1))
    >>> found = gradient_torque.drag(reading, still, still, np.tile(gradient, (5, 1, 1)), place)
    >>> bool(np.allclose(found, [1e-7, 0.0, 0.0], atol=1e-20))
    True
    """
    tensor = offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    return drag_from(linear_b, tensor, com_to_test_mass_b)
