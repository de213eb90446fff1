"""Difference of both sensors in its own unit, from whitened rows and the model that these are the difference to."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.gradient_torque import discovery_series as series
from gravcal.calibrations.gradient_torque.discovery_view import View
from gravcal.estimation.noise import unwhiten
from gravcal.physics import sensing


def reading(seen: View, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Difference of the linear readings that their distance predicts, and whitened rows in its unit.

    Parameters
    ----------
    seen : View
    rows : (3 m, q) 1, of the channel linear, axis after axis

    Returns
    -------
    time : (m,) s
    model : (m, 3) m s-2
    columns : (q, m, 3) m s-2, NaN where there is no sample
    """
    about = seen.fine
    tensor = sensing.offset_tensor(about.rate_b, about.rate_dot_b, about.gradient_b)
    apart = about.extra["positions"][0] - about.extra["positions"][1]
    time, good = seen.time["linear"], seen.good["linear"]
    parts = rows.reshape(3, time.size, -1)
    columns = [unwhiten(seen.noise["linear"][a], parts[a], good) for a in range(3)]
    model = series.means(-np.matvec(tensor, apart), seen.width["linear"])
    return time, model, np.moveaxis(np.stack(columns, axis=1), 2, 0)
