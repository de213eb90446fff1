"""Result document of a centre-of-mass event: what was found, how well, and whether it may be used."""

import numpy as np

from gravcal.calibrations.checks import at_least, at_most, largest
from gravcal.calibrations.com_offset.align import OUTLIER, REACH
from gravcal.calibrations.com_offset.estimate import adopted
from gravcal.report.documents import WITH_RESULT
from gravcal.report.plain import AXES, as_plain, chi_square_test, estimate, gps_text, number, numbers, offset_block
from gravcal.store.schemas import VERSION

KINDS = ("roll", "pitch", "yaw")
HIGH_LATITUDE = np.radians(45.0)
WAVE_HZ = 1 / 12
SCALE_SHARE = 0.5  # of its prior: a torque scale known no better says nothing of its own
ANGULAR_LIMIT = 0.2
PRODUCTS = {"acc": "ACC1A", "sca": "SCA1B"}
EPOCH = "middle of each manoeuvre"  # of an offset that moves
GAPS = {"orbit": 1, "star camera": 2}  # bits of a gap too long to use a manoeuvre
RULE = (
    "of the angular accelerations that determine most components, that with the smallest total error (sum of the "
    "variances of x, y, z): noise, delays and scales estimated along, inertia and dipole per current of the catalogue."
)
CONFIDENCE = 2.0  # standard deviations between a value and a limit for a clear answer


def document(products, *, event, provenance, settings):
    """Result document of one event, ready for JSON.

    Parameters
    ----------
    products : {stage or "stage.variant": Dataset}; "combine" is None without a manoeuvre, "survey" may be
    event : str
    provenance : mapping, "products" {stage: digest} and what else is known
    settings : mapping, all parameters; requirement_um, accuracy_um, consistency_level are used here
    """
    detected, combined = products["detect"], products["combine"]
    smoothed, field = products["attitude"], products["field"]
    found = detected.sizes["manoeuvre"] > 0 and combined is not None
    residual = smoothed["sca_residual_b"].values
    rms = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else np.full(3, np.nan)
    record = {name: number(detected[f"record_{name}"].values) for name in ("start", "stop")}
    about = {
        "schema_version": VERSION,
        "status": "no_manoeuvre",
        "calibration": "com_offset",
        "event": event,
        "direction": "proof_mass_to_com",
        "manoeuvres": [],
        "record": record,
        "field_check": {
            "bias_nt": numbers(1e9 * field["bias"].values),
            "rms_nt": numbers(1e9 * field["rms"].values),
            "max_nt": numbers(1e9 * field["maximum"].values),
            "samples": int(np.sum(field["used"].values != 0)),
            "model": f"IGRF-{int(field.attrs['igrf_generation'])}",
        },
        "attitude": {"rms_urad": numbers(1e6 * rms), "samples": len(residual)},
        "outliers": {
            PRODUCTS[name]: int(np.sum(products["align"][f"{name}_flag"].values == OUTLIER)) for name in REACH
        },
        "roll_response": None if detected.sizes["manoeuvre"] else roll_response(products["survey"], settings),
        "settings": as_plain(settings),
        "provenance": as_plain(provenance),
    }
    if not found:
        span = (
            ""
            if None in record.values()
            else " of {start} to {stop} GPS".format(**{name: gps_text(time) for name, time in record.items()})
        )
        return about | {"verdict": {"text": f"No manoeuvre in the torquer currents{span}: nothing to calibrate."}}
    solved = next(one for name, one in products.items() if name.startswith("solve."))
    blocks = variants(combined)
    chosen = {"variant": adopted(combined), "rule": RULE}
    agreement = consistency(combined, chosen["variant"], float(settings["consistency_level"]))
    determined = any(item is not None for block in blocks.values() for item in block["offset_um"])
    density = [np.interp(WAVE_HZ, solved["frequency"].values, row) for row in solved["noise_density"].values]
    return about | {
        "status": "delivered" if determined else "failed",
        "verdict": verdict(blocks, chosen, agreement, settings),
        "epoch": EPOCH,
        "method": combined.attrs.get("method", "gravcal"),
        "adopted": chosen,
        "variants": blocks,
        "manoeuvres": manoeuvres(combined, detected, smoothed, field, settings),
        "delays_s": {
            name: estimate(smoothed[f"{name}_delay"].values, smoothed[f"{name}_delay_sigma"].values)
            for name in ("sca", "acc")
        },
        "scales": scales(smoothed, settings),
        "consistency": agreement,
        "noise": {
            "source": solved.attrs["noise_source"],
            "frequency_hz": WAVE_HZ,
            "density_m_s2_rthz": numbers(np.sqrt(density)),
        },
    }


def variants(combined):
    """Combined offset of every angular acceleration, {variant: block of the document}."""
    found = {}
    for index, name in enumerate(combined.attrs["variants"].split()):
        offset, determined = combined["offset"].values[index], combined["determined"].values[index]
        block = offset_block(offset, combined["covariance"].values[index], determined)
        total = offset_block(offset, combined["covariance_total"].values[index], determined)
        found[name] = block | {"sigma_total_um": total["sigma_um"], "covariance_total_um2": total["covariance_um2"]}
    return found


def manoeuvres(combined, detected, smoothed, field, settings):
    """One entry for each manoeuvre, in order of time."""
    joint, wave, attitude = ({n: v.values for n, v in one.variables.items()} for one in (combined, detected, smoothed))
    orbit = field["time_orbit"].values
    names = combined.attrs["variants"].split()
    torque_limit = SCALE_SHARE * float(settings["torque_scale_sigma"])

    def picked(name, index, limit=np.inf):
        """Value and error of one manoeuvre; null where the error only repeats its prior."""
        sigma = attitude[f"{name}_sigma"][index]
        return estimate(attitude[name][index], np.where(sigma < limit, sigma, np.nan))

    def single(variant, index):
        """Offset of one manoeuvre for one angular acceleration, with its fit."""
        keys = ("offset", "covariance", "determined", "chi2", "dof")
        offset, covariance, determined, chi2, dof = (joint[f"manoeuvre_{key}"][variant, index] for key in keys)
        return offset_block(offset, covariance, determined) | {"fit": chi_square_test(chi2, dof)}

    found = []
    for i in range(detected.sizes["manoeuvre"]):
        middle = (wave["start"][i] + wave["stop"][i]) / 2
        latitude = None  # geocentric, where the orbit is known
        if orbit.size and orbit[0] <= middle <= orbit[-1]:
            latitude = float(np.interp(middle, orbit, field["latitude"].values))
        found.append(
            {
                "kind": KINDS[int(joint["kind"][i])],
                "start": float(joint["start"][i]),
                "stop": float(joint["stop"][i]),
                "rod": "xyz"[int(wave["rod"][i])],
                "regular": bool(wave["regular"][i]),
                "latitude_deg": None if latitude is None else float(np.degrees(latitude)),
                "latitude_class": None if latitude is None else "high" if abs(latitude) > HIGH_LATITUDE else "low",
                "gaps": [name for name, bit in GAPS.items() if int(attitude["gap"][i]) & bit],
                "acc_shift_s": picked("acc_shift", i),
                "sca_shift_s": picked("sca_shift", i),
                "torque_scale": picked("torque_scale", i, torque_limit),
                "angular_scale": picked("angular_scale", i, ANGULAR_LIMIT),
                "attitude_rms_urad": numbers(1e6 * attitude["residual_rms"][i]),
                "variants": {name: single(variant, i) for variant, name in enumerate(names)},
            }
        )
    return found


def scales(smoothed, settings):
    """Scales of torque and angular accelerometer, weighted means over the manoeuvres.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    settings : mapping with torque_scale_sigma, the prior

    Returns
    -------
    scales : {"angular", "torque"}, each {"value", "sigma"} per axis; null where no manoeuvre turns the axis
    """
    limits = {"angular": ANGULAR_LIMIT, "torque": SCALE_SHARE * float(settings["torque_scale_sigma"])}
    found = {}
    for name, limit in limits.items():
        values, sigmas = smoothed[f"{name}_scale"].values, smoothed[f"{name}_scale_sigma"].values
        known = np.isfinite(values) & (sigmas > 0) & (sigmas < limit)
        weight = np.where(known, 1 / np.where(known, sigmas, 1.0) ** 2, 0.0)
        total = np.where(known.any(axis=0), weight.sum(axis=0), np.nan)
        found[name] = estimate(np.sum(weight * np.where(known, values, 0.0), axis=0) / total, 1 / np.sqrt(total))
    return found


def roll_response(survey, settings):
    """Slope of the measured roll motion on (m x B)_x, beside what the catalogue expects; for want of a manoeuvre."""
    slope = None if survey is None else estimate(survey["slope"].values, survey["slope_sigma"].values)
    if slope is None or slope["value"] is None:
        return None
    used = np.isfinite(survey["roll_impulse"].values) & np.isfinite(survey["roll_rate"].values)
    known = [settings.get(name) for name in ("roll_response", "roll_response_sigma")]
    expected = None if None in known else estimate(*known)
    return slope | {"unit": survey["slope"].attrs["units"], "samples": int(used.sum()), "expected": expected}


def consistency(combined, name, level):
    """Agreement of manoeuvres (those of the adopted variant; all beside it), measured variants, and the catalogue."""

    def judged(chi2, dof):
        test = chi_square_test(chi2, dof)
        agree = None if test["p"] is None else test["p"] >= level
        words = {True: "consistent", False: "not consistent", None: "not tested"}
        return test | {"consistent": agree, "verdict": words[agree]}

    names = combined.attrs["variants"].split()
    tests = {one: judged(combined["chi2"].values[i], combined["dof"].values[i]) for i, one in enumerate(names)}
    own = tests.get(name, judged(np.nan, 0))
    others = {
        one: judged(combined[f"{one}_chi2"].values, combined[f"{one}_dof"].values) for one in ("variants", "catalogue")
    }
    return {"level": level, "manoeuvres": own | {"variant": name, "by_variant": tests}} | others


def result_checks(combined, consistency, settings):
    """Checks of the result: fit of every manoeuvre, agreement at the level of the verdict, plausible size.

    A variant that determines no component is not judged: nothing of it is delivered.
    """
    fit = [combined[f"manoeuvre_{name}"].values.astype(float) for name in ("chi2", "dof")]
    ratio = np.divide(*fit, out=np.full_like(fit[0], np.nan), where=fit[1] > 0)
    delivered = np.isfinite(combined["offset"].values).any(axis=1)
    found = [
        at_most(f"chi2 per degree of freedom, {name}", largest(ratio[i]), settings["fit_limit"], "1")
        for i, name in enumerate(combined.attrs["variants"].split())
        if delivered[i]
    ]
    words = {"manoeuvres": "manoeuvres", "variants": "angular accelerations", "catalogue": "torquers and catalogue"}
    for name, said in words.items():
        p = consistency[name]["p"]
        found.append(at_least(f"agreement of {said}, p", np.nan if p is None else p, consistency["level"], "1"))
    size = 1e6 * largest(np.abs(combined["offset"].values))
    found.append(at_most("size of the offset", size, settings["plausible_um"], "um"))
    return [one for one in found if not np.isnan(one.value)]


def verdict(variants, chosen, consistency, settings):
    """Answers to the three questions asked of every event, with a sentence for people."""
    limit, accuracy = float(settings["requirement_um"]), float(settings["accuracy_um"])
    if chosen["variant"] is None:
        text = "Manoeuvres were found, but they determine no component of the offset."
        return {"requirement_um": limit, "accuracy_um": accuracy, "text": text}
    values, totals = (variants[chosen["variant"]][name] for name in ("offset_um", "sigma_total_um"))
    within = []
    for value, sigma in zip(values, totals, strict=True):
        if value is None:
            within.append("undetermined")
        elif abs(value) + CONFIDENCE * sigma <= limit:
            within.append("within")
        else:
            within.append("exceeds" if abs(value) - CONFIDENCE * sigma > limit else "undecided")
    met = [None if sigma is None else sigma <= accuracy for sigma in totals]
    agree = {name: consistency[name]["consistent"] for name in ("manoeuvres", "variants", "catalogue")}
    compared = [agree["manoeuvres"], agree["variants"], agree["catalogue"] is not False]
    return {
        "requirement_um": limit,
        "requirement": within,
        "accuracy_um": accuracy,
        "accuracy_met": all(item is True for item in met),
        "consistent": None if None in compared and False not in compared else False not in compared,
        "text": _sentences(chosen["variant"], values, totals, within, limit, met, accuracy, agree),
    }


def _sentences(variant, values, totals, within, limit, met, accuracy, agree):
    """Verdict in words."""
    components = ", ".join(
        f"{axis} not determined" if value is None else f"{axis} {value:.1f} +- {sigma:.1f}"
        for axis, value, sigma in zip(AXES, values, totals, strict=True)
    )
    words = {"within": "met in", "exceeds": "exceeded in", "undecided": "undecided in", "undetermined": "not tested in"}
    groups = {word: [a for a, own in zip(AXES, within, strict=True) if own == name] for name, word in words.items()}
    requirement = "; ".join(f"{word} {', '.join(axes)}" for word, axes in groups.items() if axes)
    short = ", ".join(axis for axis, item in zip(AXES, met, strict=True) if item is not True)
    reached = f"of {accuracy:g} um not reached: {short}" if short else f"better than {accuracy:g} um on all axes"
    said = {None: "were not compared", True: "agree", False: "DISAGREE"}
    catalogue = "; the torquers are FURTHER from the catalogue than its error" if agree["catalogue"] is False else ""
    return (
        f"Delivered: {components} um ({variant}). Requirement of {limit:g} um {requirement}. "
        f"Accuracy {reached}. "
        f"Manoeuvres {said[agree['manoeuvres']]}; angular accelerations {said[agree['variants']]}{catalogue}."
    )


def vcm_line(document, satellite):
    """Adopted offset as a line of the sequence-of-events file, in force from the end of the last manoeuvre.

    Parameters
    ----------
    document : dict of `document`, judged
    satellite : letter

    Returns
    -------
    line : str, a comment unless all data were measured; None unless all three components of the adopted variant are
        determined
    """
    from gravcal.io.vcm import commented, vector_line

    if document["status"] not in WITH_RESULT or document["adopted"]["variant"] is None:
        return None
    name = document["adopted"]["variant"]
    block = document["variants"][name]
    if any(item is None for item in block["offset_um"]):
        return None
    time = float(np.ceil(max(one["stop"] for one in document["manoeuvres"])))
    errors = " ".join(f"{item:.2f}" for item in block["sigma_total_um"])
    doubt = " QUESTIONABLE" if document["status"] == "questionable" else ""
    vector_b = [1e-6 * item for item in block["offset_um"]]
    line = vector_line(time, satellite, vector_b, comment=f"{document['event']} {name} sigma_um {errors}{doubt}")
    return line if document["origin"] == "measured" else commented(line, document["origin"])
