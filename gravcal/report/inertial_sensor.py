"""What a run of the inertial sensor delivers: result document and page."""

from __future__ import annotations

import json

import numpy as np

from gravcal.calibrations.building import build
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.inertial_sensor import checks
from gravcal.calibrations.inertial_sensor.schemas import REPORT
from gravcal.report import documents
from gravcal.report.plain import AXES, as_plain, estimate, number, numbers
from gravcal.store import product
from gravcal.store.schemas import VERSION, validate

#: The two solutions of the offset, in the order of the product.
OFFSETS = ("com_to_test_mass_um", "com_to_test_mass_without_y_um")
ADOPTED = "smallest total error: least sum of the squares of sigma_total of the three axes"
CLAIMED = {"k": 0.01, "offset in y and z": 0.03, "bias": 1e-3}  # relative, abstract of Remote Sens. 2023, 15, 3817
NOT_DETERMINED = {
    "k_y": "no angular factor is tied to it: neither swing nor roll gives k_y (the value in use is that of the ground)",
    "beta_z": "tied to beta_y: same electrodes, arm and inertia",
    "bias_y": "rolling about y leaves its direction cosines constant: b_y and the constant acceleration of the "
    "satellite along y, solar pressure above all, are one sum (constant_y)",
}


def report(*products, event, names, settings, published):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset of "detect" and, as far as there was a swing or a roll, "align", "scale", "offset", "bias",
        "checks"
    event : str
    names : names of the products, in order
    settings : mapping of all parameters
    published : {section: [{"labels", "value", "sigma"}]} of the catalogue

    Returns
    -------
    dataset : Dataset, "inertial_sensor.report"; files : {name: text}
    """
    given = dict(zip(names, products, strict=True))
    tests = [*of_product(given["checks"]), *checks.result(given, settings)] if "checks" in given else []
    found = documents.judged(document(given, event=event, settings=settings), products, tests)
    validate(found)
    from gravcal.report import inertial_sensor_page

    files = {
        "result.json": json.dumps(found, indent=1, allow_nan=False) + "\n",
        "report.html": inertial_sensor_page.page(found, given, published),
    }
    return _dataset(found), files


def document(given, *, event, settings):
    """Result document, ready for JSON.

    Parameters
    ----------
    given : {name: Dataset}; event : str; settings : mapping of all parameters
    """
    delivered = "scale" in given or "bias" in given
    head = {
        "schema_version": VERSION,
        "status": "delivered" if delivered else "no_manoeuvre",
        "calibration": "inertial_sensor",
        "event": event,
        "method": settings["method"],
        "direction": "com_to_test_mass",
        "manoeuvres": _manoeuvres(given["detect"]),
    }
    if "scale" in given:
        head["swing"] = swing(given["scale"], given["offset"])
    if "bias" in given:
        head["roll"] = roll(given["bias"])
    keys = {f"inertial_sensor.{name}": product.digest_as_read(one)[:12] for name, one in given.items()}
    unknown = NOT_DETERMINED | ({"bias": given["bias"].attrs["not_determined"]} if _without_bias(given) else {})
    tail = {"settings": as_plain(settings), "provenance": {"products": keys}}
    return head | {"not_determined": unknown, "verdict": {"text": verdict(head)}} | tail


def _without_bias(given):
    """Whether there was a roll that tells no bias."""
    return "bias" in given and "not_determined" in given["bias"].attrs


def _manoeuvres(detected):
    """Swings and rolls by their times."""
    return [
        {"kind": kind, "start": float(a), "stop": float(b)}
        for kind in ("swing", "roll")
        for a, b in zip(detected[f"{kind}_start"].values, detected[f"{kind}_stop"].values, strict=True)
    ]


def swing(scaled, moved):
    """Scale factors, offset and delay.

    Parameters
    ----------
    scaled : Dataset, "inertial_sensor.scale"; moved : Dataset, "inertial_sensor.offset"
    """
    arm = int(scaled.chosen_arm)
    beta = [estimate(v, s) for v, s in zip(scaled.beta.values, scaled.beta_sigma.values, strict=True)]
    offset = {name: _offset(moved, choice) for choice, name in enumerate(OFFSETS)}
    adopted = OFFSETS[int(moved.adopted)]
    return {
        "k": _linear(scaled, arm),
        "beta": dict(zip(AXES, beta, strict=True)),
        **offset,
        "adopted": {"solution": adopted, "rule": ADOPTED, **offset[adopted]},
        "delay_s": estimate(scaled.delay, scaled.delay_sigma),
        "arm_x_mm": 1e3 * float(scaled.arm_x[arm]),
        "arms": {f"{1e3 * float(a):.2f} mm": _linear(scaled, i) for i, a in enumerate(scaled.arm_x.values)},
        "k_budget_relative": {
            cause: dict(zip(AXES, numbers(row), strict=True))
            for cause, row in zip(scaled.attrs["causes"].split(), scaled.k_budget.values, strict=True)
        },
        "filter_minus_batch": _agreement(scaled),
        "budget_um": {
            name: numbers(1e6 * one)
            for name, one in zip(moved.attrs["causes"].split(), moved["shift"].values[0], strict=True)
        },
        "noise": {
            "tracker_urad": numbers(1e6 * scaled.tracker_sigma.values),
            "angular_v_rthz": numbers(scaled.voltage_density.values),
            "linear_v_rthz": numbers(moved.noise_density.values),
        },
        "fit": {
            "scale": {"chi2": float(scaled.chi2), "dof": int(scaled.dof)},
            "offset": {"chi2": float(moved.chi2), "dof": int(moved.dof)},
        },
    }


def _linear(scaled, arm):
    """Linear factors of one arm; k_y is not determined."""
    value, sigma, total = (scaled[name].values[arm] for name in ("k", "k_sigma", "k_sigma_total"))
    known = [estimate(v, s) | {"sigma_total": number(t)} for v, s, t in zip(value, sigma, total, strict=True)]
    return {"x": known[0], "y": None, "z": known[2]}


def _offset(moved, choice):
    """Offset in um."""
    held, total = (1e6 * np.sqrt(np.diag(moved[name].values[choice])) for name in ("covariance", "covariance_total"))
    return estimate(1e6 * moved.offset.values[choice], held) | {"sigma_total": numbers(total)}


def _agreement(scaled):
    """Largest difference of filter and batch in standard deviations."""
    last = scaled.filter_value.values[-1] - scaled.batch_value.values
    return {"sigmas": float(np.max(np.abs(last / scaled.filter_sigma.values[-1])))}


def roll(biased):
    """Bias and its parts.

    Parameters
    ----------
    biased : Dataset, "inertial_sensor.bias"
    """
    separable = biased.separable.values.astype(bool)
    shown = lambda name: numbers(np.where(separable, biased[name].values, np.nan))  # noqa: E731
    return {
        "bias": {"value": shown("bias"), "sigma": shown("bias_sigma"), "sigma_total": shown("bias_sigma_total")},
        "bias_volt": {"value": shown("bias_volt"), "sigma": shown("bias_volt_sigma")},
        "segments": int(np.count_nonzero(biased.used)),
        "segments_found": int(biased.used.size),
        "constant_y": {
            "value": number(biased.bias[1]),
            "sigma": number(biased.bias_sigma[1]),
            "sigma_total": number(biased.bias_sigma_total[1]),
            "volt": number(biased.bias_volt[1]),
            "meaning": "b_y minus the constant acceleration of the satellite along y",
        },
        "budget": {
            name: numbers(biased[name].values)
            for name in ("statistical_sigma", "offset_sigma", "factor_sigma", "wander", "offset_effect")
        },
        "z_noise": z_noise(biased) if biased.sizes["frequency"] else None,
        "source": biased.attrs["factors_from"],
    }


def z_noise(biased):
    """Noise of z, root of the mean power between 10 and 50 mHz, with old and new factor; what of it is the factor.

    Parameters
    ----------
    biased : Dataset, "inertial_sensor.bias"
    """
    band = (biased.frequency.values >= 0.01) & (biased.frequency.values <= 0.05)
    before, after, cleared = np.sqrt(np.mean(biased.density.values[:, band] ** 2, axis=1))
    slow = (biased.frequency.values >= 1e-3) & (biased.frequency.values < 3e-3)
    rows = np.sqrt(np.mean(biased.density.values[:, slow] ** 2, axis=1))
    return {
        "before_m_s2_rthz": float(before),
        "after_m_s2_rthz": float(cleared),
        "ratio": float(cleared / before),
        "ratio_of_factors": float(after / before),
        "millihertz": {"before_m_s2_rthz": float(rows[0]), "after_m_s2_rthz": float(rows[2])},
    }


def verdict(found):
    """One line for the terminal.

    Parameters
    ----------
    found : document so far
    """
    if found["status"] != "delivered":
        return "No swing and no roll in the attitude: nothing to calibrate."
    parts = []
    if "swing" in found:
        offset = found["swing"]["adopted"]
        text = ", ".join(f"{v:.0f} +- {s:.0f}" for v, s in zip(offset["value"], offset["sigma_total"], strict=True))
        k = found["swing"]["k"]
        factors = (f"k_{axis} {k[axis]['value']:.3e} +- {k[axis]['sigma_total']:.0e}" for axis in "xz")
        solution = "all axes, k_y of the ground" if offset["solution"] == OFFSETS[0] else "without a_y"
        parts.append(f"{', '.join(factors)} m s-2 V-1; centre of mass to test mass {text} um ({solution})")
    if "roll" in found:
        parts.append(_bias_line(found["roll"]))
    return ". ".join([*parts, *_claims(found)]) + "."


def _claims(found):
    """Whether the total errors reach those that the paper claims; no sentence where nothing was determined."""
    errors = {"k": [], "offset in y and z": [], "bias": []}
    if "swing" in found:
        offset = found["swing"]["adopted"]
        errors["k"] = [(one["value"], one["sigma_total"]) for one in found["swing"]["k"].values() if one]
        errors["offset in y and z"] = list(zip(offset["value"], offset["sigma_total"], strict=True))[1:]
    if "roll" in found:
        bias = found["roll"]["bias"]
        errors["bias"] = list(zip(bias["value"], bias["sigma_total"], strict=True))
    known = {name: [abs(s / v) for v, s in pairs if v and s is not None] for name, pairs in errors.items()}
    worst = {name: max(relative) for name, relative in known.items() if relative}
    said = [f"{name} {100 * one:.2g} % ({'met' if one < CLAIMED[name] else 'not met'}, {100 * CLAIMED[name]:g} %)"
            for name, one in worst.items()]  # fmt: skip
    return [f"Total error against the claim of the paper: {', '.join(said)}"] if said else []


def _bias_line(rolled):
    """Bias of the roll, or that there is none."""
    if rolled["bias"]["value"] == [None] * 3:
        return f"Bias not determined: {rolled['segments']} of {rolled['segments_found']} segments of the roll usable"
    known = zip(AXES, rolled["bias"]["value"], rolled["bias"]["sigma_total"], strict=True)
    text = ", ".join(f"b_{axis} {v:.5e} +- {s:.0e}" for axis, v, s in known if v is not None)
    return f"{text} m s-2 from {rolled['segments']} segments, b_y not separable"


def _dataset(found):
    """Numbers of the document, NaN where not determined."""
    nothing = [None] * 3
    swung, rolled = found.get("swing", {}), found.get("roll", {})
    take = lambda block: [np.nan if not block.get(a) else block[a]["value"] for a in AXES]  # noqa: E731
    number = lambda values, unit=1.0: [np.nan if v is None else unit * v for v in values]  # noqa: E731
    values = {
        "k": take(swung.get("k", {})),
        "beta": take(swung.get("beta", {})),
        "offset": number(swung.get("adopted", {}).get("value", nothing), 1e-6),
        "bias": number(rolled.get("bias", {}).get("value", nothing)),
    }
    return build(REPORT, values, status=found["status"], event=found["event"])
