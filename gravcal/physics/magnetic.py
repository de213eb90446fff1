"""International Geomagnetic Reference Field along an orbit, one epoch per point.

The coefficient files IGRF13.shc and IGRF14.shc are those of IAGA (https://doi.org/10.5281/zenodo.14012302 and its
forerunner), as shipped by ppigrf 2.1.0; ``coefficient_digest`` identifies them in a product.
"""

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from gravcal.physics import check_shape, earth, frames, orbit_environment, refuse
from gravcal.physics.constants import IGRF_RADIUS
from gravcal.physics.gravity import derivative, kernel_tables, sum_series

GENERATIONS = (13, 14)
DEGREE = 13


def field_e(time_gps, position_e, generation):
    """Main field of the Earth.

    Parameters
    ----------
    time_gps : (n,) GPS s, or one epoch for all points
    position_e : (n, 3) m, geocentric, Earth-fixed
    generation : int, 13 or 14

    Returns
    -------
    field_e : (n, 3) T, Earth-fixed components

    Raises
    ------
    GravcalError : an epoch outside the model, an unknown generation, a point near the Earth's centre

    Notes
    -----
    B = -grad a sum (a/r)^(n+1) (g cos m phi + h sin m phi) P_nm(cos theta), Schmidt semi-normalised, coefficients
    linear between epochs; Alken et al. 2021, eq. 1. Evaluated as solid harmonics in x, y, z: no pole is special.
    """
    position = check_shape("position_e", position_e, (None, 3))
    year = np.broadcast_to(decimal_year(time_gps), position.shape[:1])
    epochs = gauss_coefficients(generation)[0]
    if year.size == 0:
        return np.empty((0, 3))
    if not (year.min() >= epochs[0] and year.max() <= epochs[-1]):
        years, expected = f"{year.min():.3f} to {year.max():.3f}", f"{epochs[0]:.0f} to {epochs[-1]:.0f}"
        refuse(f"IGRF-{generation}", years, expected, "Choose another generation.", first=year.min(), last=year.max())
    if not np.min(np.einsum("ij,ij->i", position, position)) > 1e12:
        refuse("position_e", "a point near the Earth's centre, or NaN", "an orbit in metres", "Check units and gaps.")
    interval = np.clip(np.searchsorted(epochs, year, side="right") - 1, 0, epochs.size - 2)
    field = np.empty_like(position)
    for k in np.unique(interval):
        here = interval == k
        sums = sum_series(position[here] / IGRF_RADIUS, *_series(generation, k))
        field[here] = sums[:, :3] + (year[here] - epochs[k])[:, None] * sums[:, 3:]
    return field * -1e-9


def decimal_year(time_gps):
    """Calendar year and the fraction of it that has passed (365 or 366 days) of GPS seconds (...,), in GPS time.

    The 18 s between GPS and UTC change the field by less than 1e-4 nT.
    """
    date = np.datetime64("2000-01-01T12:00:00") + (1e9 * np.asarray(time_gps, float)).astype("timedelta64[ns]")
    year = date.astype("datetime64[Y]")
    return 1970 + year.astype(int) + (date - year) / ((year + 1).astype("datetime64[ns]") - year)


def coefficient_file(generation):
    """Path of the coefficients of a generation."""
    if generation not in GENERATIONS:
        refuse("IGRF", f"generation {generation}", "13 or 14", "Set igrf_generation.", generation=generation)
    return Path(__file__).with_name(f"IGRF{generation}.shc")


def coefficient_digest(generation):
    """SHA-256 of the coefficient file, for the provenance of a product."""
    return hashlib.sha256(coefficient_file(generation).read_bytes()).hexdigest()


@lru_cache
def gauss_coefficients(generation):
    """Epochs (k,) in years, g and h (k, 14, 14) in nT by degree and order, Schmidt semi-normalised."""
    lines = [line.split() for line in coefficient_file(generation).read_text().splitlines() if not line.startswith("#")]
    epochs = np.array(lines[1], float)
    g, h = np.zeros((2, epochs.size, DEGREE + 1, DEGREE + 1))
    for degree, order, *values in lines[2:]:
        (h if int(order) < 0 else g)[:, int(degree), abs(int(order))] = np.array(values, float)
    return epochs, g, h


@lru_cache
def _series(generation, interval):
    """Kernel tables of the derivatives by x, y, z of the potential, and of their change per year, between two epochs.

    The potential over a is a series of solid harmonics, which `gravity` differentiates and sums. Schmidt
    functions are the fully normalised ones over sqrt(2n + 1).
    """
    epochs, g, h = gauss_coefficients(generation)
    K = (g - 1j * h) / np.sqrt(2 * np.arange(DEGREE + 1) + 1)[:, None]
    change = (K[interval + 1] - K[interval]) / (epochs[interval + 1] - epochs[interval])
    return kernel_tables([derivative(part, axis) for part in (K[interval], change) for axis in "xyz"])


def body_field(orbit_time, position_e, sca_time, quaternion, generation: int):
    """Function (n,) s -> geomagnetic field (n, 3) T and direction of the main dipole (n, 3) in the body.

    Earth-fixed positions (k, 3) m of an orbit (k,) s, attitudes (m, 4) of continuous sign at times (m,) s.
    """
    to_inertial = np.swapaxes(earth.R_ei(orbit_time), 1, 2)
    field_i = CubicSpline(orbit_time, np.matvec(to_inertial, field_e(orbit_time, position_e, generation)))
    axis_i = CubicSpline(orbit_time, orbit_environment.dipole_axis_i(orbit_time))

    def at(time):
        R_bi = frames.R_bi_from_quaternion(frames.interpolate(sca_time, quaternion, time))
        return np.matvec(R_bi, field_i(time)), np.matvec(R_bi, axis_i(time))

    return at
