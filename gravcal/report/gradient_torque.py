"""What a run of gradient_torque delivers: result document and page."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.gradient_torque import checks
from gravcal.report import documents
from gravcal.report.plain import as_plain, number, numbers
from gravcal.store import product
from gravcal.store.schemas import VERSION, validate

NAMES = {
    "two_sensor": "two sensors, mounting term kept",
    "one_sensor_published": "one sensor, eqs. 13-16 as printed",
    "one_sensor": "one sensor, tensor and rates modelled",
}


def report(*products, event, settings):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, "combine", "torque", "gradient", "checks" and the drags in the order of the combination
    event : str
    settings : mapping of all parameters

    Returns
    -------
    dataset : Dataset, "gradient_torque.report"; files : {name: text}
    """
    combined, torque, modelled, checked, *drags = products
    methods = [str(name) for name in combined["method"].values]
    given = {"combine": combined, "torque": torque, "gradient": modelled, "checks": checked}
    given |= {f"drag.{name}": one for name, one in zip(methods, drags, strict=True)}
    tests = [*of_product(checked), *checks.result(modelled, dict(zip(methods, drags, strict=True)), settings)]
    found = documents.judged(document(given, event=event, settings=settings), products, tests)
    validate(found)
    from gravcal.report import gradient_torque_page

    files = {
        "result.json": json.dumps(found, indent=1, allow_nan=False) + "\n",
        "report.html": gradient_torque_page.page(found, given),
    }
    return xr.Dataset(
        {"delivered": ((), np.int8(1), {"units": "1"})}, attrs={"time_scale": "GPS", "event": event}
    ), files


def document(given, *, event, settings):
    """Result document, ready for JSON.

    Parameters
    ----------
    given : {name: Dataset} of the products
    event : str
    settings : mapping of all parameters
    """
    combined = given["combine"]
    keys = {f"gradient_torque.{name}": product.digest_as_read(one)[:12] for name, one in given.items()}
    found = {
        "schema_version": VERSION,
        "status": "delivered",
        "calibration": "gradient_torque",
        "event": event,
        "drag": {
            str(name): _method(combined.isel(method=i), given[f"drag.{name}"], keys[f"gradient_torque.drag.{name}"])
            for i, name in enumerate(combined["method"].values)
        },
        "identifiability": identifiability(combined),
        "torque": _torque(given["torque"]),
    }
    found |= {"verdict": {"text": verdict(found, float(settings["requirement_m_s2"]))}}
    tail = {"settings": as_plain(settings), "provenance": {"products": keys}}
    return found | _pressure(given["drag.one_sensor"]) | tail


def _method(one, drag, key):
    """Errors of one method, m s-2."""
    return {
        "rms_error": number(one["error_rms"]),
        "rms_error_without_noise": number(one["clean_error_rms"]),
        "rms_error_bare_reading": number(one["bare_error_rms"]),
        "rms_correction_to_bare_reading": number(one["correction_rms"]),
        "sigma_rms": number(one["sigma_rms"]),
        "sigma_total_rms": number(one["sigma_total_rms"]),
        "error_over_sigma": number(one["error_over_sigma"]),
        "budget": dict(zip(drag.attrs["sources"].split(", "), numbers(drag["budget"].values), strict=True)),
        "series": key,
    }


def identifiability(combined):
    """Rank, null space, and what each piece of knowledge adds.

    Parameters
    ----------
    combined : Dataset, "gradient_torque.combine"
    """
    columns = (combined[f"step{tail}"].values for tail in ("", "_rank", "_unknowns", "_sigma"))
    return {
        "rank": int(combined["single_rank"]),
        "unknowns": combined.sizes["unknown"],
        "null_space": {
            "unknowns": [str(name) for name in combined["unknown"].values],
            "units": "1e-6 s-2 for G, 1e-7 m s-2 for drag",
            "vectors": numbers(combined["null_space"].values),
        },
        "printed": {
            "rank": int(combined["printed_rank"]),
            "unknowns": 6,
            "null": numbers(combined["printed_null"].values),
        },
        "knowledge": [
            {"known": str(name), "rank": int(rank), "unknowns": int(size), "drag_sigma": numbers(sigma)}
            for name, rank, size, sigma in zip(*columns, strict=True)
        ],
    }


def _torque(torque):
    """Relative angular acceleration by degree, rms, and whether a line of the spectrum stands above the sensor's."""
    seen = (torque["amplitude"].values > 3 * torque["sensitivity"].values[:, None]).any(axis=(1, 2))
    return {
        "degrees": [int(n) for n in torque["degree"].values],
        "rms_rad_s2": numbers(torque["rms"].values),
        "test_mass_rms_rad_s2": numbers(torque["test_mass_rms"].values),
        "above_sensitivity": [bool(s) for s in seen],
    }


def _pressure(drag):
    """Centre of pressure, if the torque balance was used."""
    if "pressure" not in drag:
        return {}
    sigma = np.sqrt(np.diag(drag["pressure_covariance"].values))
    found = {"value": numbers(drag["pressure"].values), "sigma": numbers(sigma)}
    prior = numbers(drag["pressure_prior_sigma"].values)
    gain = number(drag["torque_gain"])
    return {"centre_of_pressure_m": found | {"prior_sigma": prior}, "torque_share_of_drag_information": gain}


def verdict(found, requirement):
    """What the one-sensor method gains over the bare reading, in one paragraph.

    Parameters
    ----------
    found : result document so far
    requirement : m s-2, the printed error
    """
    one, printed = found["drag"]["one_sensor"], found["drag"].get("one_sensor_published")
    known = one["rms_error"] is not None
    bare = one["rms_error_bare_reading"] if known else one["rms_correction_to_bare_reading"]
    left = one["rms_error"] if known else one["sigma_rms"]
    if bare is None or left is None:
        return "One sensor: not determined from readings of this size."
    words = "is off by" if known else "differs from the solution by"
    text = f"One sensor: the bare reading {words} {bare:.1e} m/s2 rms; with tensor and rates modelled {left:.1e} "
    text += f"({'error' if known else 'sigma'}) remain, {bare / left:.0f} times less. "
    if printed:
        text += (
            f"The printed algorithm differs from the bare reading by {printed['rms_correction_to_bare_reading']:.0e} "
            f"m/s2: it gains nothing (erratum S-8). "
        )
    totals = [block["sigma_total_rms"] for block in found["drag"].values()]
    within = "reach" if None not in totals and max(totals) < requirement else "do not reach"
    text += f"With the error of the places the methods {within} the printed {requirement:.0e} m/s2."
    return text
