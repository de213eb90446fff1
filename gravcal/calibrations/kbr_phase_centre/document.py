"""Result document of a ranging calibration: what was determined, how well, and whether it may be used."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, SUBSETS, middle
from gravcal.report.documents import WITH_RESULT
from gravcal.report.plain import as_plain, chi_square_test, number, numbers
from gravcal.store.schemas import VERSION

ARM = 1.444  # m, from the centre of mass to the phase centre: turns an error of y or z into one of direction
ROUTINE = (
    "Without wiggles x is not determined: its columns are constant but for the square of the pointing, a few "
    "micrometres of range, and their sum is taken by the range bias; y and z are as good as the pointing moves and the "
    "orbit is quiet at a few millihertz: gravcal run ranging. The antenna correction of a file repeats the vectors it "
    "was computed with, not the true ones."
)
INDISTINGUISHABLE = [
    {
        "cause": "attitude.star_camera_misalignment",
        "text": "A constant turn of the star camera frame against the SRF moves y and z by 1.444 m times the angle: "
        "1.4 um per urad. y and z are relative to the frame of SCA1B.",
    },
    {
        "cause": "ranging.multipath",
        "text": "A part of the multipath that is proportional to the sine of an angle counts as y or z.",
    },
]
PUBLISHED = (
    "Method published, for comparison only: columns keep the level that detrending takes from the range, so x is short "
    "by about 100 mm and y, z are shrunk; formal errors count samples as independent."
)
GEOMETRY = (
    "y and z come from the wiggle itself and need both signs of the offset: then the errors of x cancel in them.",
    "One-sided sets move y and z by tan(offset) times the error of their x; use both signs, or hold x at its "
    "catalogue value.",
    "x comes from the cosine, tan(offset) times the wiggle and its second harmonic, some twenty times weaker than y "
    "and z; it is determined, but the direction is what ranging needs.",
)
ROBUST = (
    "Robust weights do not sharpen Gaussian noise: the error given here is that of the scatter, the formal one is "
    "too small."
)


def document(products: Mapping, *, event: str, provenance: Mapping, settings: Mapping) -> dict:
    """Document of one event, ready for JSON; products "combine", "pointing" and "noise" by stage."""
    combined, pointed = products["combine"], products["pointing"]
    result = {
        "schema_version": VERSION,
        "status": "no_manoeuvre",
        "calibration": "kbr_phase_centre",
        "event": event,
        "direction": "com_to_phase_centre",
    }
    if pointed.sizes["manoeuvre"]:
        result |= _estimates(combined, pointed, settings)
    else:
        reason = f"No wiggle in the pointing angles of either satellite: nothing to calibrate. {ROUTINE}"
        result |= {"verdict": {"text": reason}, "manoeuvres": []}
    return result | {
        "pair": pointed.attrs["satellites"],
        "ranging": pointed.attrs["ranging"],
        "record": {"start": float(pointed["time"].values[0]), "stop": float(pointed["time"].values[-1])},
        "noise": _noise(products["noise"]),
        "settings": as_plain(settings),
        "provenance": as_plain(provenance),
    }


def _estimates(combined, pointed, settings):
    """Everything that needs a wiggle."""
    letters, observable = combined.attrs["satellites"], combined.attrs["adopted_observable"]
    estimator = combined.attrs["adopted_estimator"]
    satellites = {
        letter: {
            name: {kind: _block(combined, (o, 0, e), k) for e, kind in enumerate(ESTIMATORS)}
            for o, name in enumerate(OBSERVABLES)
        }
        for k, letter in enumerate(letters)
    }
    adopted = {letter: own[observable][estimator] for letter, own in satellites.items()}
    determined = any(value is not None for block in adopted.values() for value in block["phase_centre_mm"])
    tests = {
        name: chi_square_test(combined["arcs_chi2"].values[k], combined["arcs_dof"].values[k])
        for k, name in enumerate(OBSERVABLES)
    }
    published = [PUBLISHED] if combined.attrs["method"] == "published" else []
    one_sided = np.isfinite(_sigma_ratio(combined["covariance"].values[1, 0, 0], 0))
    return {
        "status": "delivered" if determined else "failed",
        "verdict": _verdict(adopted, f"{observable}, {estimator}", tests[observable], settings),
        "method": combined.attrs["method"],
        "epoch": middle(pointed),
        "satellites": satellites,
        "adopted": {
            "observable": observable,
            "estimator": estimator,
            "rule": "chosen by setting; range, rate and acceleration come from one phase and are not independent",
            "satellites": adopted,
        },
        "manoeuvres": [_manoeuvre(combined, pointed, k) for k in range(pointed.sizes["manoeuvre"])],
        "subsets": {name: _subset(combined, s) for s, name in enumerate(SUBSETS) if s},
        "geometry": _geometry(combined, pointed),
        "consistency": {"manoeuvres": tests, "scatter_between_manoeuvres_mm": _scatter(combined)},
        "sigma0": {name: numbers(combined["sigma0"].values[k, 0]) for k, name in enumerate(OBSERVABLES)},
        "trust": [*published, *(GEOMETRY if one_sided else ()), ROBUST],
        "indistinguishable_from_calibration": INDISTINGUISHABLE,
    }


def _block(combined, index, satellite):
    """Phase centre in mm of an observable, sub-set and estimator; what is not determined is null everywhere."""
    part = slice(3 * satellite, 3 * satellite + 3)
    known = combined["determined"].values[index[:2]][part] != 0
    matrix = 1e6 * combined["covariance"].values[index][part, part]
    matrix = np.where(known[:, None] & known, matrix, np.nan)
    return {
        "phase_centre_mm": numbers(np.where(known, 1e3 * combined["centre"].values[index][part], np.nan)),
        "sigma_mm": numbers(np.sqrt(np.diag(matrix))),
        "covariance_mm2": numbers((matrix + matrix.T) / 2),
        "formal_sigma_mm": numbers(np.where(known, 1e3 * combined["formal_sigma"].values[index][part], np.nan)),
    }


def _verdict(adopted, source, test, settings):
    """One sentence, and the answers behind it."""
    words, angles = [], []
    for letter, block in adopted.items():
        pairs = zip("xyz", block["phase_centre_mm"], block["sigma_mm"], strict=True)
        parts = [f"{axis} {value:.3f} +- {sigma:.3f}" for axis, value, sigma in pairs if value is not None]
        words.append(f"{letter}: {', '.join(parts)} mm" if parts else f"{letter}: not determined")
        angles += [sigma / ARM for sigma in block["sigma_mm"][1:] if sigma is not None]
    consistent = None if test["p"] is None else bool(test["p"] >= settings["consistency_level"])
    text = f"{'; '.join(words)} ({source})."
    if angles:
        text += f" Direction known to {1e3 * max(angles):.1f} urad, required {1e3 * settings['requirement_mrad']:.0f}."
    if consistent is not None:
        text += " Manoeuvres agree." if consistent else f" Manoeuvres disagree (p {test['p']:.1g})."
    met = bool(angles) and max(angles) <= settings["requirement_mrad"]
    return {"text": text, "accuracy_met": met, "consistent": consistent}


def _manoeuvre(combined, pointed, k):
    """A sub-manoeuvre with its own estimate of the component across the line of sight."""
    satellite, axis, sign = (int(pointed[n].values[k]) for n in ("satellite_index", "axis_index", "sign"))
    value, sigma = (1e3 * combined[name].values[:, k] for name in ("arc_value", "arc_sigma"))
    return {
        "satellite": combined.attrs["satellites"][satellite],
        "kind": ("", "+", "-")[sign] + ("pitch", "yaw")[axis],
        "start": float(pointed["start"].values[k]),
        "stop": float(pointed["stop"].values[k]),
        "offset_deg": number(np.degrees(pointed["offset"].values[k])),
        "amplitude_deg": number(np.degrees(pointed["amplitude"].values[k])),
        "component": "zy"[axis],
        "estimates_mm": {
            name: {"value": number(value[o]), "sigma": number(sigma[o])} for o, name in enumerate(OBSERVABLES)
        },
    }


def _scatter(combined):
    """Error of the mean of y and z as the scatter between sub-manoeuvres shows it, mm; null with fewer than two."""
    satellite, axis = combined["satellite_index"].values, combined["axis_index"].values
    scatter = {name: {} for name in OBSERVABLES}
    for o, name in enumerate(OBSERVABLES):
        for k, letter in enumerate(combined.attrs["satellites"]):
            own = [1e3 * combined["arc_value"].values[o, (satellite == k) & (axis == a)] for a in (1, 0)]
            spread = [np.std(v, ddof=1) / np.sqrt(v.size) if v.size > 1 else np.nan for v in own]
            scatter[name][letter] = [None, *numbers(spread)]
    return scatter


def _subset(combined, s):
    """One-sided set or set with x fixed, with the shifts that the geometry predicts."""
    shift = 1e3 * combined["shift"].values[:, s].reshape(-1, 2, 3)
    predicted = 1e3 * combined["predicted_shift"].values[:, s].reshape(-1, 2, 3)
    return {
        name: {
            letter: _block(combined, (o, s, 0), k)
            | {"shift_mm": numbers(shift[o, k]), "predicted_shift_mm": numbers(predicted[o, k])}
            for k, letter in enumerate(combined.attrs["satellites"])
        }
        for o, name in enumerate(OBSERVABLES)
    }


def _geometry(combined, pointed):
    """Condition numbers, and the ratio of the errors that the offset angle sets."""
    offset = np.abs(pointed["offset"].values)
    angle = float(np.median(offset)) if offset.size else np.nan
    condition, covariance = combined["condition"].values, combined["covariance"].values[1, :, 0]
    return {
        "condition": {
            name: {subset: number(condition[o, s]) for s, subset in enumerate(SUBSETS)}
            for o, name in enumerate(OBSERVABLES)
        },
        "offset_deg": number(np.degrees(angle)),
        "tan_offset": number(np.tan(angle)),
        "one_sided_sigma_ratio": {
            subset: [number(_sigma_ratio(covariance[s], k)) for k in (0, 1)] for s, subset in enumerate(SUBSETS[:3])
        },
    }


def _sigma_ratio(covariance, satellite):
    """Sigma of y and z over sigma of x."""
    sigma = np.sqrt(np.diag(covariance))[3 * satellite : 3 * satellite + 3]
    return np.sqrt(np.mean(sigma[1:] ** 2)) / sigma[0]


def _noise(measured):
    """Noise of the ranging and of the star cameras, at the wiggle and its second harmonic; null where not measured."""

    def amplitudes(density):
        values = 1e6 * np.sqrt(np.interp([4e-3, 8e-3], measured["frequency"].values, measured[density].values))
        return {name: number(value) or None for name, value in zip(("4_mhz", "8_mhz"), values, strict=True)}

    shape = 1 / (1 + (4e-3 / measured["corner"].values) ** 2)
    return {
        "source": measured.attrs["source_data"],
        "seconds": number(measured["seconds"]),
        "quiet_um_rthz": amplitudes("model"),
        "manoeuvres_um_rthz": amplitudes("in_manoeuvres"),
        "star_camera_urad_rthz_4_mhz": number(1e6 * np.sqrt(measured["pointing_power"].values @ shape)) or None,
    }


def vector_files(document: Mapping, date: str) -> dict[str, str]:
    """Vector files and lines of the sequence-of-events file of the adopted result, {name: text}.

    "VKB1B_date_letter_04.txt" and "result.soe", of what is determined in x, y and z; unless all data were measured no
    vector file and comments for lines.
    """
    from gravcal.io.vcm import commented, vector_line, write_vector_file

    files, lines = {}, []
    if document["status"] not in WITH_RESULT:
        return files
    source = f"{'QUESTIONABLE ' * (document['status'] == 'questionable')}{document['event']}"
    time = float(np.ceil(max(one["stop"] for one in document["manoeuvres"])))
    for letter, block in document["adopted"]["satellites"].items():
        if None in block["phase_centre_mm"]:
            continue
        vector = [1e-3 * item for item in block["phase_centre_mm"]]
        errors = " ".join(f"{1e3 * item:.2f}" for item in block["sigma_mm"])
        comment = f"{source} {document['adopted']['observable']} sigma_um {errors}"
        lines.append(vector_line(time, letter, vector, name="VKB", comment=comment))
        if document["origin"] != "measured":
            lines[-1] = commented(lines[-1], document["origin"])
            continue
        name = f"VKB1B_{date}_{letter}_{'02' if letter in 'AB' else '04'}.txt"
        with tempfile.TemporaryDirectory() as folder:
            path = write_vector_file(Path(folder) / name, [time], letter, [vector], source=source)
            files[name] = path.read_text()
    return files | ({"result.soe": "\n".join(lines) + "\n"} if lines else {})
