"""Stage torque: relative angular acceleration of test mass and satellite for each zonal degree, and its spectrum."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque import laws
from gravcal.calibrations.gradient_torque.gradient import cube_side, field_of
from gravcal.calibrations.gradient_torque.pointing import R_bo, orbit_frame
from gravcal.calibrations.gradient_torque.schemas import TORQUE
from gravcal.physics import earth, gravity, gravity_field


def torque(
    modelled: xr.Dataset,
    observed: xr.Dataset,
    stored: xr.Dataset,
    *,
    lowest_degree: int,
    highest_degree: int,
    spectrum_step_s: float,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Amplitude spectra by zonal degree beside the angular noise of the sensor.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient", for the attitude
    observed : Dataset, "ingest", for the orbit
    stored : Dataset, "gradient_torque.field"
    lowest_degree, highest_degree : int
    spectrum_step_s : s
    elongation : 1, of the test mass
    satellite : inertia, test_mass, test_mass_inertia, angular_noise_density

    Returns
    -------
    torque : Dataset, "gradient_torque.torque"
    """
    time, position = observed["time"].values, observed["position"].values
    every = slice(None, None, max(1, round(spectrum_step_s / float(np.median(np.diff(time))))))
    R_ei = earth.R_ei(time[every])
    R_oi = orbit_frame(position[every], observed["velocity"].values[every])
    R_be = R_bo(modelled["angle"].values[-1][every]) @ R_oi @ np.swapaxes(R_ei, 1, 2)
    place = np.matvec(R_ei, position[every])
    field, degrees = field_of(stored), np.arange(lowest_degree, highest_degree + 1)
    test_mass = laws.box_inertia(satellite["test_mass"], cube_side(satellite), elongation)
    body = np.array(satellite["inertia"])
    rows = []
    for degree in degrees:
        tensor = gravity.rotate_tensor(R_be, gravity_field.gradient_e(gravity_field.zonal(field, degree), place))
        rows.append((laws.gradient_angular_acceleration(test_mass, body, tensor), free_part(test_mass, tensor)))
    series = np.array([row[0] for row in rows])
    step = float(np.median(np.diff(time[every])))
    frequency, amplitude = amplitude_spectrum(series, step)
    values = {
        "degree": degrees,
        "frequency": frequency,
        "amplitude": np.moveaxis(amplitude, 1, 2),
        "rms": np.sqrt(np.mean(series**2, axis=1)),
        "test_mass_rms": np.sqrt(np.mean(np.array([row[1] for row in rows]) ** 2, axis=1)),
        "sensitivity": np.array(satellite["angular_noise_density"]) * np.sqrt(2 * 1.5 / (step * series.shape[1])),
    }
    return build(TORQUE, values, title="Gravity-gradient torque by zonal degree", elongation=elongation)


def free_part(test_mass_inertia, tensor):
    """Part of the test mass, (n, 3) rad s-2; zero for a cube (erratum S-5)."""
    return laws.free_mass_angular_acceleration(test_mass_inertia, tensor, np.zeros(3))


def amplitude_spectrum(series, step):
    """Amplitude of the sine in each spectral line, with a Hann window.

    Parameters
    ----------
    series : (..., n, k) evenly spaced
    step : s

    Returns
    -------
    frequency : (m,) Hz, without zero
    amplitude : (..., m, k) unit of the series
    """
    n = series.shape[-2]
    window = np.hanning(n)[:, None]
    missing = ~np.isfinite(series).all(axis=-1)
    if missing.any() and not missing.all():
        series = _bridged(series, missing)
    spectrum = np.fft.rfft(window * (series - series.mean(axis=-2, keepdims=True)), axis=-2)
    return np.fft.rfftfreq(n, step)[1:], np.abs(spectrum[..., 1:, :]) * 2 / window.sum()


def _bridged(series, missing):
    """Straight lines over missing epochs (..., n, 3)."""
    flat, gone = series.reshape(-1, *series.shape[-2:]).copy(), missing.reshape(-1, series.shape[-2])
    index = np.arange(series.shape[-2])
    for one, lost in zip(flat, gone, strict=True):
        if not lost.all():
            one[lost] = np.stack([np.interp(index[lost], index[~lost], column[~lost]) for column in one.T], axis=1)
    return flat.reshape(series.shape)
