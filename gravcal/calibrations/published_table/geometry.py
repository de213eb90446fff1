"""Geometry of the published manoeuvres: which rod, in which field, what an error of a reading does to the offset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gravcal.physics import earth, magnetic

EPOCH = 633830400.0  # s GPS, 2020-02-01 12:00
HEIGHT_M = 490e3
SPEED = 2 * np.pi / 5660.0  # rad s-1, along the orbit
WEIGHTS = np.array([1.0, 0.09, 1.0])  # CoM paper eq. 7
PERIOD_S, LENGTH_S, STEP_S = 12.0, 180.0, 0.5
#: Rod and middle of the area (latitude, longitude in deg) by kind and latitude class; Tables 2 and 3, erratum C-8.
AREAS = {
    ("pitch", "low"): (2, 15.0, -45.0),
    ("pitch", "high"): (0, 70.0, 0.0),
    ("roll", "high"): (1, 70.0, 0.0),
    ("yaw", "low"): (1, 15.0, 130.0),
}


@dataclass(frozen=True)
class Arc:
    """One manoeuvre."""

    dipole_b: np.ndarray  #: (n, 3) A m2
    alpha_b: np.ndarray  #: (n, 3) rad s-2, angular acceleration by it
    solution: np.ndarray  #: (3, 3 n) offset from the weighted rows of the reading, CoM paper eq. 6

    def answer(self, reading_b: np.ndarray) -> np.ndarray:
        """Change (3, q) m of the estimated offset by errors (n, 3, q) m s-2 of the reading.

        Parameters
        ----------
        reading_b : (n, 3, q) m s-2
        """
        return self.solution @ detrended(reading_b)


def detrended(reading_b: np.ndarray) -> np.ndarray:
    """Weighted rows (3 n, q) of a reading (n, 3, q) with mean and trend of each axis removed."""
    time = np.linspace(-1, 1, reading_b.shape[0])
    shape = np.linalg.qr(np.stack([np.ones_like(time), time], axis=1))[0]
    slow = shape @ (shape.T @ reading_b.reshape(len(shape), -1))
    rest = reading_b - slow.reshape(reading_b.shape)
    return (np.sqrt(WEIGHTS)[:, None] * rest).reshape(-1, reading_b.shape[2])


def euler_columns(alpha_b: np.ndarray) -> np.ndarray:
    """Reading (n, 3, 3) per offset from the proof mass to the centre of mass: -[alpha x].

    Parameters
    ----------
    alpha_b : (n, 3) rad s-2

    Notes
    -----
    CoM paper eq. 5, its first term; the centrifugal one is below 1 % of it at 12 s.
    """
    return np.stack([-np.cross(alpha_b, unit) for unit in np.eye(3)], axis=2)


@lru_cache(maxsize=32)
def arc(kind: str, latitude_class: str, heading: int, about: tuple) -> Arc:
    """Manoeuvre in the middle of its area.

    Parameters
    ----------
    kind, latitude_class : key of AREAS
    heading : +1 where x of the body points north, -1 south
    about : principal moments (3,) kg m2, dipole of a rod A m2, generation of the IGRF
    """
    moments, dipole, generation = about
    rod, latitude, longitude = AREAS[kind, latitude_class]
    time = np.arange(-LENGTH_S / 2, LENGTH_S / 2, STEP_S)
    position = earth.position_from_geodetic(
        np.radians(latitude) + SPEED * time, np.full(time.size, np.radians(longitude)), np.full(time.size, HEIGHT_M)
    )
    field_e = magnetic.field_e(EPOCH + time, position, generation)
    north_east_down = np.matvec(earth.R_en_from_position(position).swapaxes(1, 2), field_e)
    field_b = north_east_down * np.array([heading, heading, 1.0])
    wave = np.where((time // (PERIOD_S / 2)) % 2 == 0, 1.0, -1.0)
    dipole_b = dipole * wave[:, None] * np.eye(3)[rod]
    alpha = np.cross(dipole_b, field_b) / np.array(moments)
    return Arc(dipole_b, alpha, np.linalg.pinv(detrended(euler_columns(alpha))))
