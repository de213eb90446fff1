"""Stages gradient and torque: gravity gradient along the orbit in b, rates for both ways of using sensors, spectra."""

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque import attitude, laws
from gravcal.errors import EstimationError, refuse
from gravcal.physics import earth, gravity, gravity_field

SCHEMAS = schemas.of("gradient_torque.toml")

METHODS = ("one_sensor", "two_sensor")


def field(read: gravity_field.Field) -> xr.Dataset:
    """Product "gradient_torque.field" of a gravity field."""
    values = {name: getattr(read, name) for name in SCHEMAS["field"]}
    return build(SCHEMAS["field"], values, title="Gravity field", field=read.name)


def truth(read: xr.Dataset) -> xr.Dataset:
    """Product "gradient_torque.truth" of the "ingest" of a file of truth."""
    values = {"time": read["time"].values, "drag_b": read["drag"].values}
    return build(SCHEMAS["truth"], values, title="Drag of a simulated day")


def field_of(stored: xr.Dataset) -> gravity_field.Field:
    """Gravity field of a product "gradient_torque.field"."""
    parts = (stored[name].values for name in ("cosine", "sine", "cosine_sigma", "sine_sigma"))
    return gravity_field.Field(float(stored["gm"]), float(stored["radius"]), *parts, name=stored.attrs.get("field", ""))


def orbit(observed: xr.Dataset, gap_limit_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Position m and velocity m s-1 in i, (n, 3) each, missing rows filled by a cubic spline.

    Parameters
    ----------
    observed : Dataset, "ingest" of an SGRS file
    gap_limit_s : s, longest gap filled
    """
    time, columns = observed["time"].values, []
    for name in ("position", "velocity"):
        values = observed[name].values
        good = np.isfinite(values).all(axis=1)
        if not good.all():
            known = time[good]
            worst = max(np.diff(known).max(), known[0] - time[0], time[-1] - known[-1]) if known.size > 3 else np.inf
            if worst > gap_limit_s:
                raise EstimationError(
                    f"SGRS file: found {worst:.0f} s without position or velocity, expected at most {gap_limit_s:g} s. "
                    f"Cut the record there, or raise gap_limit_s.",
                    gap=float(worst),
                )
            values = CubicSpline(known - time[0], values[good])(time - time[0])
        columns.append(values)
    return tuple(columns)


def gradient(
    observed: xr.Dataset,
    stored: xr.Dataset,
    *,
    field_degree: int,
    knot_step_s: float,
    gap_limit_s: float,
    single_sensor: int,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Tensor of the gravity gradient in b, rates and their errors.

    Parameters
    ----------
    observed : Dataset, "ingest" of an SGRS file
    stored : Dataset, "gradient_torque.field"
    field_degree : highest degree of the field
    knot_step_s, gap_limit_s : s
    single_sensor : 1 or 2, the one that the one-sensor methods use
    elongation : 1, of the test masses
    satellite : attitude_noise, angular_noise_density, test_mass, test_mass_inertia of the catalogue
    """
    time, places = observed["time"].values, observed["sensor_position"].values
    if single_sensor > len(places):
        raise EstimationError(
            f"single_sensor {single_sensor}: found {len(places)} sensor, expected that many. Set it to 1."
        )
    if time.size < 60:
        raise EstimationError(f"SGRS file: found {time.size} epochs, expected at least 60. Give a longer record.")
    worst = float(np.diff(time).max())
    if worst > gap_limit_s:
        raise EstimationError(
            f"SGRS file: found a gap of {worst:.0f} s, expected none above {gap_limit_s:g} s. "
            f"Cut the record there, or raise gap_limit_s (errors grow in the gap).",
            gap=worst,
        )
    model = gravity_field.truncated(field_of(stored), 0, field_degree)
    position, velocity = orbit(observed, gap_limit_s)
    R_ei = earth.R_ei(time)
    gradient_e = gravity_field.gradient_e(model, np.matvec(R_ei, position))
    gradient_i = gravity.rotate_tensor(np.swapaxes(R_ei, 1, 2), gradient_e)
    frame = attitude.orbit_frame(position, velocity), *attitude.orbit_rates(time, position, velocity)
    quaternion = observed["q"].values
    quaternion = np.where(np.linalg.norm(quaternion, axis=1, keepdims=True) > 0.5, quaternion, np.nan)
    inertia, density = laws.box_inertia(satellite, elongation), np.array(satellite["angular_noise_density"])

    def free(R_bi, rate_b):
        return laws.free_mass_angular_acceleration(inertia, gravity.rotate_tensor(R_bi, gradient_i), rate_b)

    sensors = {"one_sensor": [min(single_sensor, len(places)) - 1], "two_sensor": list(range(len(places)))}
    smoothed, covariance = [], []
    for used in (sensors[name] for name in METHODS):
        motion = attitude.smooth(
            time,
            quaternion,
            observed["angular"].values[:, used].mean(axis=1),
            frame,
            free,
            angle_sigma=np.array(satellite["attitude_noise"]),
            angular_sigma=density / np.sqrt(2 * float(np.median(np.diff(time))) * len(used)),
            knot_step=knot_step_s,
        )
        gradient_b = gravity.rotate_tensor(motion.R_bi, gradient_i)
        errors = laws.offset_tensor_error(motion.rate_b, gradient_b, places[used].mean(axis=0))
        smoothed.append(motion)
        covariance.append(motion.covariance_of(*errors))
    values = {
        "time": time,
        "linear_b": observed["linear"].values,
        "angular_b": observed["angular"].values,
        "sensor_position_b": places,
        "gradient_b": gradient_b,  # with the attitude by all sensors
        "gradient_variance": gravity_field.error_covariance(model, np.linalg.norm(position, axis=1).mean()),
        "up_b": np.matvec(motion.R_bi, position / np.linalg.norm(position, axis=1, keepdims=True)),
        "motion_covariance": np.stack(covariance),
        "attitude_chi2": [motion.chi2 for motion in smoothed],
        "attitude_dof": [motion.dof for motion in smoothed],
    }
    for name in ("angle", "angle_dot", "rate_b", "rate_dot_b"):
        values[name] = np.stack([getattr(motion, name) for motion in smoothed])
    return build(SCHEMAS["gradient"], values, title="Gravity gradient and rates along the orbit", field=model.name)


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
    """Amplitude spectra of the torque by zonal degree beside the angular noise of the sensor.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient", for the attitude
    observed : Dataset, "ingest", for the orbit
    stored : Dataset, "gradient_torque.field"
    lowest_degree, highest_degree : int
    spectrum_step_s : s
    elongation : 1, of the test mass
    satellite : inertia, test_mass, test_mass_inertia, angular_noise_density
    """
    time, position = observed["time"].values, observed["position"].values
    every = slice(None, None, max(1, round(spectrum_step_s / float(np.median(np.diff(time))))))
    R_ei = earth.R_ei(time[every])
    R_oi = attitude.orbit_frame(position[every], observed["velocity"].values[every])
    R_be = attitude.R_bo(modelled["angle"].values[-1][every]) @ R_oi @ np.swapaxes(R_ei, 1, 2)
    position_e, known = np.matvec(R_ei, position[every]), field_of(stored)
    if known.degree < highest_degree:
        remedy = f"Give highest_degree={known.degree}, or a field that goes further."
        refuse(known.name or "field", f"degree {known.degree}", f"at least highest_degree {highest_degree}", remedy)
    degrees = np.arange(lowest_degree, highest_degree + 1)
    test_mass, body = laws.box_inertia(satellite, elongation), np.array(satellite["inertia"])
    relative, own = np.zeros((2, degrees.size, len(position_e), 3))
    for k, degree in enumerate(degrees):
        tensor = gravity.rotate_tensor(R_be, gravity_field.gradient_e(gravity_field.zonal(known, degree), position_e))
        relative[k] = laws.gradient_angular_acceleration(test_mass, body, tensor)
        own[k] = laws.free_mass_angular_acceleration(test_mass, tensor, np.zeros(3))
    step = float(np.median(np.diff(time[every])))
    frequency, amplitude = amplitude_spectrum(relative, step)
    values = {
        "degree": degrees,
        "frequency": frequency,
        "amplitude": np.moveaxis(amplitude, 1, 2),
        "rms": np.sqrt(np.mean(relative**2, axis=1)),
        "test_mass_rms": np.sqrt(np.mean(own**2, axis=1)),
        "sensitivity": np.array(satellite["angular_noise_density"]) * np.sqrt(2 * 1.5 / (step * relative.shape[1])),
    }
    return build(SCHEMAS["torque"], values, title="Gravity-gradient torque by zonal degree", elongation=elongation)


def amplitude_spectrum(series: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude of the sine in each spectral line, with a Hann window; straight lines over missing epochs.

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
    window, index = np.hanning(n)[:, None], np.arange(n)
    missing = ~np.isfinite(series).all(axis=-1)
    if missing.any():
        series = series.copy()
        for place in np.ndindex(series.shape[:-2]):
            lost = missing[place]
            for one in series[place].T if not lost.all() else ():
                one[lost] = np.interp(index[lost], index[~lost], one[~lost])
    spectrum = np.fft.rfft(window * (series - series.mean(axis=-2, keepdims=True)), axis=-2)
    return np.fft.rfftfreq(n, step)[1:], np.abs(spectrum[..., 1:, :]) * 2 / window.sum()
