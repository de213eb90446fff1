"""Parts of the result document of a ranging calibration."""

import numpy as np

from gravcal.report.plain import number, numbers

OBSERVABLES = ("range", "range_rate", "range_acceleration")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")
AXES = ("pitch", "yaw")
ROUTINE = (
    "Without wiggles x is not determined: its columns are constant but for the square of the pointing, a few "
    "micrometres of range, and their sum is taken by the range bias. "
)
ROUTINE_TRUSTED = (
    "y and z are as good as the pointing moves between 2 and 20 mHz and as the orbit is quiet there; their errors are "
    "formal. "
)
ROUTINE_NOT = (
    "y and z are not determined either: the same solution puts x {misfit:.1f} of its errors away from the catalogue, "
    "so these errors leave out what moves with pointing or orbit. "
)
CORRECTION = "The antenna correction of the file repeats the vectors it was computed with, not the true ones."
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


def satellites(combined):
    """Estimates of every satellite, observable and estimator from all manoeuvres."""
    return {
        letter: {
            observable: {estimator: block(combined, (k, 0, e), satellite) for e, estimator in enumerate(ESTIMATORS)}
            for k, observable in enumerate(OBSERVABLES)
        }
        for satellite, letter in enumerate(combined.attrs["satellites"])
    }


def block(combined, index, satellite):
    """Phase centre in mm; what is not determined is null in value, sigma, row and column.

    Parameters
    ----------
    combined : Dataset
    index : numbers of observable, sub-set and estimator
    satellite : 0 or 1
    """
    part = slice(3 * satellite, 3 * satellite + 3)
    known = combined["determined"].values[index[:2]][part] != 0
    value = np.where(known, 1e3 * combined["centre"].values[index][part], np.nan)
    matrix = 1e6 * combined["covariance"].values[index][part, part]
    matrix = np.where(known[:, None] & known, matrix, np.nan)
    return {
        "phase_centre_mm": numbers(value),
        "sigma_mm": numbers(np.sqrt(np.diag(matrix))),
        "covariance_mm2": numbers((matrix + matrix.T) / 2),
        "formal_sigma_mm": numbers(np.where(known, 1e3 * combined["formal_sigma"].values[index][part], np.nan)),
    }


def adopted(combined, every):
    """The result that goes into the vector files."""
    observable, estimator = combined.attrs["adopted_observable"], combined.attrs["adopted_estimator"]
    return {
        "observable": observable,
        "estimator": estimator,
        "rule": "chosen by setting; range, rate and acceleration come from one phase and are not independent",
        "satellites": {letter: found[observable][estimator] for letter, found in every.items()},
    }


def verdict(chosen, test, settings):
    """One sentence, and the answers behind it."""
    words, angles = [], []
    for letter, found in chosen["satellites"].items():
        pairs = zip("xyz", found["phase_centre_mm"], found["sigma_mm"], strict=True)
        told = [f"{axis} {value:.3f} +- {sigma:.3f}" for axis, value, sigma in pairs if value is not None]
        words.append(f"{letter}: {', '.join(told)} mm" if told else f"{letter}: not determined")
        angles += [sigma / 1.444 for sigma in found["sigma_mm"][1:] if sigma is not None]
    met = bool(angles) and max(angles) <= settings["requirement_mrad"]
    consistent = None if test["p"] is None else bool(test["p"] >= settings["consistency_level"])
    text = "; ".join(words) + f" ({chosen['observable']}, {chosen['estimator']})."
    if angles:
        text += f" Direction known to {1e3 * max(angles):.1f} urad, required {1e3 * settings['requirement_mrad']:.0f}."
    if consistent is not None:
        text += " Manoeuvres agree." if consistent else f" Manoeuvres disagree (p {test['p']:.1g})."
    return {"text": text, "accuracy_met": met, "consistent": consistent}


def manoeuvres(combined, pointed):
    """Every sub-manoeuvre with its own estimate of the component across the line of sight."""
    letters, rows = combined.attrs["satellites"], []
    for k in range(pointed.sizes["manoeuvre"]):
        satellite, axis, sign = (int(pointed[n].values[k]) for n in ("satellite_index", "axis_index", "sign"))
        rows.append(
            {
                "satellite": letters[satellite],
                "kind": ("", "+", "-")[sign] + AXES[axis],
                "start": float(pointed["start"].values[k]),
                "stop": float(pointed["stop"].values[k]),
                "offset_deg": number(np.degrees(pointed["offset"].values[k])),
                "amplitude_deg": number(np.degrees(pointed["amplitude"].values[k])),
                "component": "zy"[axis],
                "estimates_mm": {
                    name: {
                        "value": number(1e3 * combined["arc_value"].values[o, k]),
                        "sigma": number(1e3 * combined["arc_sigma"].values[o, k]),
                    }
                    for o, name in enumerate(OBSERVABLES)
                },
            }
        )
    return rows


def scatter(combined):
    """Error of the mean of y and z as the scatter between sub-manoeuvres shows it, mm; null with fewer than two."""
    satellite, axis = combined["satellite_index"].values, combined["axis_index"].values
    found = {}
    for o, name in enumerate(OBSERVABLES):
        found[name] = {}
        for k, letter in enumerate(combined.attrs["satellites"]):
            own = [1e3 * combined["arc_value"].values[o, (satellite == k) & (axis == a)] for a in (1, 0)]
            spread = [np.std(v, ddof=1) / np.sqrt(v.size) if v.size > 1 else np.nan for v in own]
            found[name][letter] = [None, *numbers(spread)]
    return found


def subsets(combined):
    """Positive only, mirror only and x fixed, with the shifts that the geometry predicts."""
    found = {}
    for s, name in enumerate(SUBSETS[1:], start=1):
        found[name] = {}
        for k, observable in enumerate(OBSERVABLES):
            shift = 1e3 * combined["shift"].values[k, s].reshape(2, 3)
            predicted = 1e3 * combined["predicted_shift"].values[k, s].reshape(2, 3)
            found[name][observable] = {
                letter: block(combined, (k, s, 0), i)
                | {"shift_mm": numbers(shift[i]), "predicted_shift_mm": numbers(predicted[i])}
                for i, letter in enumerate(combined.attrs["satellites"])
            }
    return found


def geometry(combined, pointed):
    """Condition numbers, and the ratio of the errors that the offset angle sets."""
    offset = np.abs(pointed["offset"].values)
    angle = float(np.median(offset)) if offset.size else np.nan
    return {
        "condition": {
            observable: {name: number(combined["condition"].values[k, s]) for s, name in enumerate(SUBSETS)}
            for k, observable in enumerate(OBSERVABLES)
        },
        "offset_deg": number(np.degrees(angle)),
        "tan_offset": number(np.tan(angle)),
        "one_sided_sigma_ratio": {
            name: [number(_ratio(combined["covariance"].values[1, s, 0], satellite)) for satellite in (0, 1)]
            for s, name in enumerate(SUBSETS[:3])
        },
    }


def _ratio(covariance, satellite):
    """Sigma of y and z over sigma of x."""
    sigma = np.sqrt(np.diag(covariance))[3 * satellite : 3 * satellite + 3]
    return np.sqrt(np.mean(sigma[1:] ** 2)) / sigma[0]


def noise(measured):
    """Noise of the ranging and of the star cameras, at the wiggle and its second harmonic; null where not measured."""
    frequency = measured["frequency"].values
    shape = 1 / (1 + (4e-3 / measured["corner"].values) ** 2)
    return {
        "source": measured.attrs["source_data"],
        "seconds": number(measured["seconds"]),
        "quiet_um_rthz": _amplitudes(frequency, measured["model"].values),
        "manoeuvres_um_rthz": _amplitudes(frequency, measured["in_manoeuvres"].values),
        "star_camera_urad_rthz_4_mhz": number(1e6 * np.sqrt(measured["pointing_power"].values @ shape)) or None,
    }


def _amplitudes(frequency, density):
    """Amplitude densities in micrometres at 4 and 8 mHz."""
    at = {"4_mhz": 4e-3, "8_mhz": 8e-3}
    return {name: number(1e6 * np.sqrt(np.interp(f, frequency, density))) or None for name, f in at.items()}


def routine(described, pointed):
    """What quiet ranging and the antenna correction of the file say without wiggles."""
    value, sigma, misfit = described["centre"].values, described["sigma"].values, float(described["x_misfit"])
    letters = pointed.attrs["satellites"]
    said = ROUTINE_TRUSTED if np.isfinite(value).any() else ROUTINE_NOT.format(misfit=misfit)
    result = {
        "text": ROUTINE + (said if np.isfinite(misfit) else "") + CORRECTION,
        "x_misfit_sigma": number(misfit),
        "singular_urad": numbers(1e6 * described["singular"].values),
    }
    for k, letter in enumerate(letters):
        part = slice(3 * k, 3 * k + 3)
        result[letter] = {
            "phase_centre_mm": numbers(1e3 * value[part]),
            "sigma_mm": numbers(1e3 * sigma[part]),
            "behind_antenna_correction_mm": numbers(1e3 * described["correction_centre"].values[k]),
        }
    return result


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


def trust(combined):
    """Which results to trust, and why."""
    first = [PUBLISHED] if combined.attrs["method"] == "published" else []
    told = GEOMETRY if np.isfinite(_ratio(combined["covariance"].values[1, 0, 0], 0)) else ()
    return [*first, *told, ROBUST]
