"""Stage `bias`: segments of a roll solved and joined by a robust mean; what rolling about y cannot tell is said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import roll_segments, schemas
from gravcal.calibrations.inertial_sensor.robust_mean import robust_mean
from gravcal.errors import EstimationError

ENOUGH = 3  # segments, of which a mean and its scatter can be told
SEPARABLE = (1, 0, 1)  # about y the direction cosines are constant: b_y and the constant acceleration are one sum (T-9)


@dataclass(frozen=True)
class Sensor:
    """Scale factors and offset used.

    Attributes
    ----------
    k, k_sigma : (3,) m s-2 V-1, with the error of geometry
    offset : (3,) m, centre of mass to test mass; covariance : (3, 3) m2, scale factors held
    covariance_total : (3, 3) m2, with the error of the scale factors
    """

    k: np.ndarray
    k_sigma: np.ndarray
    offset: np.ndarray
    covariance: np.ndarray
    covariance_total: np.ndarray


def sensor_of(swing: tuple[xr.Dataset, ...], assumed: dict) -> Sensor:
    """Scale factors and offset of the swing, or assumed ones where there is none.

    Parameters
    ----------
    swing : () or (scale, offset) products
    assumed : {"k", "k_sigma" m s-2 V-1; "offset_um", "offset_sigma_um" um}
    """
    if not swing:
        size = 1e-6 * np.array(assumed["offset_sigma_um"])
        k, k_sigma = np.array(assumed["k"]), np.array(assumed["k_sigma"])
        return Sensor(k, k_sigma, 1e-6 * np.array(assumed["offset_um"]), np.diag(size**2), np.diag(size**2))
    scaled, found = swing
    arm = int(scaled.chosen_arm)
    k, k_sigma = scaled.k.values[arm], scaled.k_sigma_total.values[arm]
    choice = int(found.adopted)
    both = (found[name].values[choice] for name in ("covariance", "covariance_total"))
    return Sensor(k, k_sigma, found.offset.values[choice], *both)


def bias(
    segmented: xr.Dataset,
    *swing: xr.Dataset,
    method,
    segment_s,
    uniformity_limit,
    share_limit,
    trend_degree,
    amplitude_degree,
    amplitude_harmonics,
    k_z_before,
    assumed,
) -> xr.Dataset:
    """Bias of the linear axes.

    Parameters
    ----------
    segmented : Dataset, "inertial_sensor.segment"
    swing : Dataset, "inertial_sensor.scale" and "inertial_sensor.offset", or none
    method : "gravcal" or "published" (no offset term, amplitudes straight lines)
    segment_s : s; uniformity_limit, share_limit : 1; trend_degree, amplitude_degree : of polynomials
    amplitude_harmonics : of the revolution, by which non-gravitational accelerations change
    k_z_before : m s-2 V-1, factor with which the noise of z was stated before
    assumed : scale factors and offset where there is no swing

    Returns
    -------
    biased : Dataset, "inertial_sensor.bias"; beside a swing also without usable segments, the bias NaN

    Raises
    ------
    EstimationError : fewer than three usable segments and no swing, so that nothing is delivered
    """
    sensor = sensor_of(swing, assumed)
    bins = {name: segmented[name].values for name in segmented.variables}
    step = roll_segments.bin_length(bins["time"], segment_s)
    limits = {"step_s": step, "segment_s": segment_s, "uniformity": uniformity_limit, "share": share_limit}
    printed = method == "published"
    changes = (1, 0) if printed else (amplitude_degree, amplitude_harmonics)
    model = roll_segments.Model(trend_degree, *changes, not printed)
    solved = roll_segments.solve(bins, sensor.k, sensor.offset, model, limits)
    facts = {"method": method, "factors_from": "swing" if swing else "assumed"}
    few = _too_few(solved, limits)
    if not few:
        values = estimates(solved, sensor) | spectra(bins, solved, sensor, k_z_before, limits)
        return build(schemas.BIAS, values | _segments(solved), **facts)
    if not swing:
        raise EstimationError(f"roll: {few}", segments=int(solved.used.size))
    return build(schemas.BIAS, _undetermined() | _segments(solved), not_determined=few, **facts)


def _too_few(solved, limits):
    """Why the segments do not suffice; empty if they do."""
    usable = int(np.count_nonzero(solved.used))
    if usable >= ENOUGH:
        return ""
    return (
        f"found {usable} usable of {solved.used.size} segments, expected {ENOUGH}. Raise uniformity_limit "
        f"({limits['uniformity']:g}), lower share_limit ({limits['share']:g}), or give a longer roll."
    )


def _undetermined():
    """Values of a roll that tells no bias."""
    own = [name for name, stated in schemas.BIAS.items() if stated["dims"] == "axis"]
    unknown = dict.fromkeys(own, np.full(3, np.nan)) | {"separable": SEPARABLE, "amplitude": np.full((2, 2), np.nan)}
    return unknown | {"frequency": np.zeros(0), "density": np.zeros((3, 0))}


def estimates(solved: roll_segments.Segments, sensor: Sensor) -> dict:
    """Joined bias and the parts of its error.

    Parameters
    ----------
    solved : Segments; sensor : Sensor

    Notes
    -----
    b = -(constant of k V); sigma holds the noise of the segments and the error of the offset, which is common to
    all of them; the total adds the relative error of k, which multiplies b (erratum T-8).
    """
    used = solved.used
    edges = np.flatnonzero(np.diff(np.concatenate([[1], used, [1]]).astype(int)))
    lost = (edges[1::2] - edges[::2]).tolist()
    means = [robust_mean(-solved.constant[used, axis], solved.sigma[used, axis], lost) for axis in range(3)]
    volts = [
        robust_mean(-solved.volt[used, axis], solved.sigma[used, axis] / sensor.k[axis], lost) for axis in range(3)
    ]
    slope = solved.offset_slope[used].mean(axis=0)
    value = np.array([m.value for m in means])
    statistical = np.array([m.sigma for m in means])
    common, wider = (
        np.sqrt(np.diag(slope @ matrix @ slope.T)) for matrix in (sensor.covariance, sensor.covariance_total)
    )
    sigma = np.hypot(statistical, common)
    factor = np.abs(value) * sensor.k_sigma / sensor.k
    return {
        "bias": value,
        "bias_sigma": sigma,
        "bias_sigma_total": np.hypot(np.hypot(statistical, wider), factor),
        "bias_volt": [m.value for m in volts],
        "bias_volt_sigma": [m.sigma for m in volts],
        "separable": SEPARABLE,
        "statistical_sigma": statistical,
        "offset_sigma": common,
        "factor_sigma": factor,
        "wander": [m.wander for m in means],
        "offset_effect": -slope @ sensor.offset,
        "amplitude": solved.amplitude[used].mean(axis=0),
    }


def _segments(solved):
    return {
        "time_segment": solved.time,
        "segment_bias": -solved.constant.reshape(-1, 3),
        "segment_sigma": solved.sigma.reshape(-1, 3),
        "used": solved.used,
        "uniformity": solved.uniformity,
    }


def spectra(bins: dict, solved: roll_segments.Segments, sensor: Sensor, k_z_before: float, limits: dict) -> dict:
    """Amplitude spectra of the z axis: with the old factor, with the new one, and with motion and drag taken off too.

    Parameters
    ----------
    bins : of roll_bins; solved : Segments; sensor : Sensor; k_z_before : m s-2 V-1; limits : as for solve

    Notes
    -----
    Median over the segments, over what the median of so many periodograms is of the mean: 0.69 to 1 in power. White
    noise keeps its density in means of bins: what their roll-off takes, aliasing gives back.
    """
    from scipy.signal import welch

    parts = roll_segments.cut(bins["time"], limits["step_s"], limits["segment_s"])
    kept = [part for part, used in zip(parts, solved.used, strict=True) if used]
    raw = np.array([bins["linear_volt"][part, 2] for part in kept])
    left = np.array([_residual(bins, part, sensor, limits["step_s"]) for part in kept])
    spectrum = {"fs": 1 / limits["step_s"], "nperseg": raw.shape[1], "noverlap": 0, "average": "median"}
    frequency, volts = welch(raw.ravel(), detrend="linear", **spectrum)
    _, rest = welch(left.ravel(), **spectrum)
    density = np.sqrt([volts, rest])
    shown = np.array([k_z_before * density[0], sensor.k[2] * density[0], density[1]])
    return {"frequency": frequency[2:], "density": shown[:, 2:]}


def _residual(bins, part, sensor, step_s):
    """Z reading of a segment without everything that is modelled."""
    one = {name: values[part] for name, values in bins.items()}
    tensor = roll_segments.offset_terms(one["rate_b"], one["gradient_b"], step_s)
    reading = sensor.k[2] * one["linear_volt"][:, 2] - (tensor @ sensor.offset)[:, 2]
    phase = roll_segments.orbital_phase(one["gradient_b"], step_s)
    return roll_segments.solve_axis(2, reading[:, None], one["R_bo"], roll_segments.Model(3, 1, 2), phase)[2][:, 0]
