"""Linear reading of a swing in its own unit, from whitened rows and the model that these are the difference to."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.inertial_sensor.discovery_view import View
from gravcal.calibrations.inertial_sensor.swing import FACTORS
from gravcal.estimation.noise import unwhiten


def reading(seen: View, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linear reading that the offset predicts, and whitened rows in its unit.

    The attitude has none: what is left of its prediction wanders with the integrated noise of the voltages.

    Parameters
    ----------
    seen : View
    rows : (3 m, q) 1, of the linear channel, axis after axis

    Returns
    -------
    time : (m,) s
    model : (m, 3) m s-2
    columns : (q, m, 3) m s-2, NaN where there is no sample
    """
    parts = rows.reshape(3, seen.record.time.size, -1)
    columns = [seen.k[a] * unwhiten(seen.record.noise[a], parts[a], seen.good) for a in range(3)]
    model = np.matvec(np.nan_to_num(seen.tensor), seen.start[FACTORS + 1 :])
    return seen.record.time, model, np.moveaxis(np.stack(columns, axis=1), 2, 0)
