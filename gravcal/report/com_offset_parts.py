"""Parts of the result document of a centre-of-mass event, each read from one or two products."""

import numpy as np

from gravcal.report.plain import chi_square_test, estimate, gps_text, number, numbers, offset_block
from gravcal.report.roll_response import roll_response

KINDS = ("roll", "pitch", "yaw")
HIGH_LATITUDE = np.radians(45.0)
WAVE_HZ = 1 / 12


def variants(combined):
    """Combined offset of every angular acceleration.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    """
    return {name: _variant(combined, i) for i, name in enumerate(combined.attrs["variants"].split())}


def _variant(combined, index):
    determined = combined["determined"].values[index]
    offset = combined["offset"].values[index]
    block = offset_block(offset, combined["covariance"].values[index], determined)
    total = offset_block(offset, combined["covariance_total"].values[index], determined)
    return block | {"sigma_total_um": total["sigma_um"], "covariance_total_um2": total["covariance_um2"]}


def manoeuvres(combined, smoothed, field, detected):
    """One entry for each manoeuvre, in order of time.

    Parameters
    ----------
    combined, smoothed, field, detected : Dataset, "com_offset.combine", "attitude", "field", "detect"
    """
    return [_manoeuvre(combined, smoothed, field, detected, i) for i in range(combined.sizes["manoeuvre"])]


def _manoeuvre(combined, smoothed, field, detected, index):
    start, stop = (float(combined[name].values[index]) for name in ("start", "stop"))
    latitude = _latitude(field, (start + stop) / 2)
    names = combined.attrs["variants"].split()
    return {
        "kind": KINDS[int(combined["kind"].values[index])],
        "start": start,
        "stop": stop,
        "rod": "xyz"[int(detected["rod"].values[index])],
        "regular": bool(detected["regular"].values[index]),
        "latitude_deg": None if latitude is None else float(np.degrees(latitude)),
        "latitude_class": None if latitude is None else "high" if abs(latitude) > HIGH_LATITUDE else "low",
        "variants": {name: _single(combined, i, index) for i, name in enumerate(names)},
        "acc_shift_s": _pick(smoothed, "acc_shift", index),
        "sca_shift_s": _pick(smoothed, "sca_shift", index),
        "torque_scale": _pick(smoothed, "torque_scale", index),
        "angular_scale": _pick(smoothed, "angular_scale", index),
        "attitude_rms_urad": numbers(1e6 * smoothed["residual_rms"].values[index]),
    }


def _single(combined, variant, index):
    """Offset of one manoeuvre for one angular acceleration, with its fit."""
    covariance = combined["manoeuvre_covariance"].values[variant, index]
    determined = combined["manoeuvre_determined"].values[variant, index]
    block = offset_block(combined["manoeuvre_offset"].values[variant, index], covariance, determined)
    fit = chi_square_test(
        combined["manoeuvre_chi2"].values[variant, index], combined["manoeuvre_dof"].values[variant, index]
    )
    return block | {"fit": fit}


def _pick(smoothed, name, index):
    return estimate(smoothed[name].values[index], smoothed[f"{name}_sigma"].values[index])


def _latitude(field, time):
    """Geocentric latitude at an epoch, None outside the orbit."""
    known = field["time_orbit"].values
    if known.size == 0 or not known[0] <= time <= known[-1]:
        return None
    return float(np.interp(time, known, field["latitude"].values))


def delays(smoothed):
    """Tags late against the torquer telemetry.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    """
    return {
        name: estimate(smoothed[f"{name}_delay"].values, smoothed[f"{name}_delay_sigma"].values)
        for name in ("sca", "acc")
    }


def scales(smoothed):
    """Scales of torque and angular accelerometer, weighted means over the manoeuvres.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"

    Returns
    -------
    scales : {"torque", "angular"}, each {"value", "sigma"} per axis; null where no manoeuvre turns the axis
    """
    return {
        "torque": _mean(smoothed["torque_scale"].values, smoothed["torque_scale_sigma"].values, 0.09),
        "angular": _mean(smoothed["angular_scale"].values, smoothed["angular_scale_sigma"].values, 0.2),
    }


def _mean(values, sigmas, limit):
    """Weighted mean per axis of what is known better than the limit."""
    known = np.isfinite(values) & np.isfinite(sigmas) & (sigmas > 0)
    weight = np.where(known, 1 / np.where(known, sigmas, 1.0) ** 2, 0.0)
    total = weight.sum(axis=0)
    seen = total > limit**-2
    mean = np.sum(weight * np.where(known, values, 0.0), axis=0) / np.where(seen, total, 1.0)
    return estimate(np.where(seen, mean, np.nan), np.where(seen, 1 / np.sqrt(np.where(seen, total, 1.0)), np.nan))


def field_check(field):
    """Magnetometer against the model in the body, nanotesla.

    Parameters
    ----------
    field : Dataset, "com_offset.field"
    """
    return {
        "bias_nt": numbers(1e9 * field["bias"].values),
        "rms_nt": numbers(1e9 * field["rms"].values),
        "max_nt": numbers(1e9 * field["maximum"].values),
        "samples": int(np.sum(field["used"].values != 0)),
        "model": f"IGRF-{int(field.attrs['igrf_generation'])}",
    }


def attitude(smoothed):
    """Star camera against the fitted dynamics over all that was fitted, microradian.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    """
    residual = smoothed["sca_residual_b"].values
    rms = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else np.full(3, np.nan)
    return {"rms_urad": numbers(1e6 * rms), "samples": len(residual)}


def roll(aligned, field):
    """Slope of roll acceleration on (m x B)_x, for records without a manoeuvre.

    Parameters
    ----------
    aligned, field : Dataset, "com_offset.align", "com_offset.field"
    """
    return None if aligned.sizes["manoeuvre"] else roll_response(aligned, field)


def noise(solved):
    """Where the noise of the linear channels was measured, and its density at the frequency of the wave.

    Parameters
    ----------
    solved : sequence of Dataset, "com_offset.solve"
    """
    first = solved[0]
    density = [np.interp(WAVE_HZ, first["frequency"].values, row) for row in first["noise_density"].values]
    return {
        "source": first.attrs["noise_source"],
        "frequency_hz": WAVE_HZ,
        "density_m_s2_rthz": numbers(np.sqrt(density)),
    }


def record(detected):
    """First and last torquer sample.

    Parameters
    ----------
    detected : Dataset, "com_offset.detect"
    """
    return {name: number(detected[f"record_{name}"].values) for name in ("start", "stop")}


def span_text(detected):
    """Words for the time that was searched.

    Parameters
    ----------
    detected : Dataset, "com_offset.detect"
    """
    span = record(detected)
    if None in span.values():
        return ""
    return f" of {gps_text(span['start'])} to {gps_text(span['stop'])} GPS"
