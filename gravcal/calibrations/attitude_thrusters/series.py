"""Level-1 records of routine attitude as arrays: star camera, firings with their nominal impulses, orbit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.align import QUATERNION, sorted_samples
from gravcal.errors import EstimationError
from gravcal.estimation import timing
from gravcal.physics import frames

LOW_RATE = 0b11000000  # quality bits of SCA1B: made from low-rate data
THRUSTERS = 12  # the two orbit thrusters are left out


@dataclass(frozen=True)
class Camera:
    """Attitude as the star cameras give it.

    Attributes
    ----------
    time : (n,) s
    quaternion : (n, 4) scalar first, continuous in sign
    head : (n,) which camera or combination
    quality : (n,) rad, root of the sum of squares given by the product
    step_s : s
    """

    time: np.ndarray
    quaternion: np.ndarray
    head: np.ndarray
    quality: np.ndarray
    step_s: float

    def part(self, rows: np.ndarray) -> Camera:
        """Camera with some of its epochs."""
        chosen = (v[rows] for v in (self.time, self.quaternion, self.head, self.quality))
        return Camera(*chosen, self.step_s)


@dataclass(frozen=True)
class Firings:
    """Attitude thrusters.

    Attributes
    ----------
    time : (k,) s, middle of each firing
    impulse_b : (k, 3) N m s, lever arm x force x time on of the catalogue
    """

    time: np.ndarray
    impulse_b: np.ndarray


def camera(observed: xr.Dataset) -> Camera:
    """Usable epochs of SCA1B.

    Parameters
    ----------
    observed : Dataset, "ingest" of SCA1B
    """
    tags = timing.normalised(observed["time_second"].values, observed["time_fraction"].values)
    low = (observed["qualflg"].values & LOW_RATE) != 0
    time, values, flag, _ = sorted_samples(observed, tags, (*QUATERNION, "sca_id", "qual_rss"), low)
    norm = np.linalg.norm(values[:, :4], axis=1)
    good = (flag == 0) & np.isfinite(values).all(axis=1) & (np.abs(norm - 1) < 1e-3)
    if good.sum() < 500:
        raise EstimationError(
            f"{observed.attrs.get('file', 'SCA1B')}: found {int(good.sum())} usable attitudes, expected at least 500. "
            f"Give a longer record.",
            usable=int(good.sum()),
        )
    time, values = time[good], values[good]
    quaternion = frames.continuous(values[:, :4] / norm[good, None])
    return Camera(time, quaternion, values[:, 4].astype(int), values[:, 5], float(np.median(np.diff(time))))


def firings(observed: xr.Dataset, position_b: np.ndarray, force_b: np.ndarray) -> Firings:
    """Attitude firings of THR1B with the impulses of the thruster table.

    Parameters
    ----------
    observed : Dataset, "ingest" of THR1B
    position_b, force_b : (14, 3) m and N, in the order of the columns of THR1B
    """
    names = [name for name in observed.data_vars if name.startswith("on_time")][:THRUSTERS]
    tags = timing.normalised(observed["time_second"].values, observed["time_fraction"].values)
    time, values, flag, _ = sorted_samples(observed, tags, tuple(names))
    seconds = 1e-3 * values[flag == 0]  # ms in the file
    torque = np.cross(np.asarray(position_b)[:THRUSTERS], np.asarray(force_b)[:THRUSTERS])
    used = seconds.sum(axis=1) > 0
    middle = time[flag == 0] + seconds.max(axis=1) / 2
    return Firings(middle[used], seconds[used] @ torque)
