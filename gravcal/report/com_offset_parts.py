"""Parts of the result document of a centre-of-mass event, each read from one or two products."""

import numpy as np

from gravcal.report.plain import chi_square_test, estimate, gps_text, number, numbers, offset_block

KINDS = ("roll", "pitch", "yaw")
HIGH_LATITUDE = np.radians(45.0)
WAVE_HZ = 1 / 12
SCALE_SHARE = 0.5  # of its prior: a torque scale known no better says nothing of its own
ANGULAR_LIMIT = 0.2
GAPS = {"orbit": 1, "star camera": 2}  # bits of a gap too long to use a manoeuvre


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


def manoeuvres(combined, detected, told):
    """One entry for each manoeuvre, in order of time.

    Parameters
    ----------
    combined, detected : Dataset, "com_offset.combine", "com_offset.detect"
    told : list of dict, what the instruments said of each, of `instruments`
    """
    names = combined.attrs["variants"].split()
    combined, detected = _arrays(combined), _arrays(detected)
    each = [_manoeuvre(combined, detected, i) | rest for i, rest in enumerate(told)]
    return [one | {"variants": {n: _single(combined, k, i) for k, n in enumerate(names)}} for i, one in enumerate(each)]


def instruments(smoothed, field, detected, settings):
    """Parts of the document that no solution changes: field check, attitude, delays, scales, and of each manoeuvre.

    Parameters
    ----------
    smoothed, field, detected : Dataset, "com_offset.attitude", "com_offset.field", "com_offset.detect"
    settings : mapping with torque_scale_sigma and inertia_scale_sigma, the priors

    Returns
    -------
    parts : dict of plain values; "manoeuvres": list of dict
    """
    parts = {"field_check": field_check(field), "attitude": attitude(smoothed)}
    if not detected.sizes["manoeuvre"]:
        return parts | {"manoeuvres": []}
    middle = (detected["start"].values + detected["stop"].values) / 2
    values, orbit = _arrays(smoothed), _arrays(field)
    each = [_place(orbit, time) | _instruments(values, settings, i) for i, time in enumerate(middle.tolist())]
    return parts | {"delays_s": delays(smoothed), "scales": scales(smoothed, settings), "manoeuvres": each}


def _arrays(product):
    """Variables of a product as bare arrays, by name; taking one from a dataset takes longer than its use."""
    return {name: variable.values for name, variable in product.variables.items()}


def _manoeuvre(combined, detected, index):
    return {
        "kind": KINDS[int(combined["kind"][index])],
        "start": float(combined["start"][index]),
        "stop": float(combined["stop"][index]),
        "rod": "xyz"[int(detected["rod"][index])],
        "regular": bool(detected["regular"][index]),
    }


def _place(field, time):
    """Latitude at an epoch, and whether it is high."""
    latitude = _latitude(field, time)
    if latitude is None:
        return {"latitude_deg": None, "latitude_class": None}
    return {
        "latitude_deg": float(np.degrees(latitude)),
        "latitude_class": "high" if abs(latitude) > HIGH_LATITUDE else "low",
    }


def _instruments(smoothed, settings, index):
    """Gaps, shifts, scales and residual of one manoeuvre; a scale that only repeats its prior is not determined."""
    limit = SCALE_SHARE * float(settings["torque_scale_sigma"])
    return {
        "gaps": [name for name, bit in GAPS.items() if int(smoothed["gap"][index]) & bit],
        "acc_shift_s": _pick(smoothed, "acc_shift", index),
        "sca_shift_s": _pick(smoothed, "sca_shift", index),
        "torque_scale": _pick(smoothed, "torque_scale", index, limit),
        "angular_scale": _pick(smoothed, "angular_scale", index, ANGULAR_LIMIT),
        "attitude_rms_urad": numbers(1e6 * smoothed["residual_rms"][index]),
    }


def _single(combined, variant, index):
    """Offset of one manoeuvre for one angular acceleration, with its fit."""
    offset, covariance, determined, chi2, dof = (
        combined[f"manoeuvre_{name}"][variant, index] for name in ("offset", "covariance", "determined", "chi2", "dof")
    )
    return offset_block(offset, covariance, determined) | {"fit": chi_square_test(chi2, dof)}


def _pick(smoothed, name, index, limit=np.inf):
    """Value and error of one manoeuvre where the error is below a limit."""
    sigma = smoothed[f"{name}_sigma"][index]
    return estimate(smoothed[name][index], np.where(sigma < limit, sigma, np.nan))


def _latitude(field, time):
    """Geocentric latitude at an epoch, None outside the orbit."""
    known = field["time_orbit"]
    if known.size == 0 or not known[0] <= time <= known[-1]:
        return None
    return float(np.interp(time, known, field["latitude"]))


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


def scales(smoothed, settings):
    """Scales of torque, moments of inertia and angular accelerometer, weighted means over the manoeuvres.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    settings : mapping with torque_scale_sigma and inertia_scale_sigma, the priors

    Returns
    -------
    scales : {"angular", "inertia", "torque"}, each {"value", "sigma"} per axis; null where no manoeuvre turns the axis
    """
    known = {"angular": ANGULAR_LIMIT}
    for name in ("torque", "inertia"):
        if f"{name}_scale" in smoothed and f"{name}_scale_sigma" in settings:
            known[name] = SCALE_SHARE * float(settings[f"{name}_scale_sigma"])
    return {
        name: _mean(smoothed[f"{name}_scale"].values, smoothed[f"{name}_scale_sigma"].values, limit)
        for name, limit in sorted(known.items())
    }


def _mean(values, sigmas, limit):
    """Weighted mean per axis of what is known better than the limit."""
    known = np.isfinite(values) & (sigmas > 0) & (sigmas < limit)
    weight = np.where(known, 1 / np.where(known, sigmas, 1.0) ** 2, 0.0)
    total = weight.sum(axis=0)
    seen = total > 0
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


def roll_response(survey, settings):
    """Slope of the measured roll motion on (m x B)_x, beside what the catalogue expects; for want of a manoeuvre.

    Parameters
    ----------
    survey : Dataset, "com_offset.survey", or None
    settings : mapping; roll_response and roll_response_sigma of the satellite, if known

    Returns
    -------
    response : {"value", "sigma", "unit", "samples", "expected"}, or None
    """
    if survey is None:
        return None
    slope = estimate(survey["slope"].values, survey["slope_sigma"].values)
    if slope["value"] is None:
        return None
    seen = np.isfinite(survey["roll_impulse"].values) & np.isfinite(survey["roll_rate"].values)
    known = [settings.get(name) for name in ("roll_response", "roll_response_sigma")]
    expected = None if None in known else estimate(*known)
    return slope | {"unit": survey["slope"].attrs["units"], "samples": int(seen.sum()), "expected": expected}


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
