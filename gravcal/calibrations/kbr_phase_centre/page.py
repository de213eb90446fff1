"""Report of a ranging calibration: its product, result document, files, and the page, section by section.

Tables and figures follow Tables 4 to 8 and Figures 2 to 10 of 10.3390/rs14143395.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre.checks import of_result
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, SCHEMAS, SUBSETS, middle
from gravcal.calibrations.schemas import build
from gravcal.io.vcm import commented, vector_line, write_vector_file
from gravcal.report import documents, plain
from gravcal.report.figures import COLOURS, HANN, bars, grid, opened, thinned
from gravcal.report.pages import Section, Table, figure, page
from gravcal.report.plain import NOT_DETERMINED, chi_square, gps_text, number, numbers, plus_minus, signed

TITLES = {name: name.replace("_", " ") for name in OBSERVABLES}
PRINTED_IN = {"ls": ("least squares", "Table 4"), "robust": ("robust, IGG-III", "Table 6")}
UNITS = {"range": ("µm", 1e6), "range_rate": ("nm/s", 1e9), "range_acceleration": ("nm/s²", 1e9)}
SHADE = {"color": COLOURS["yellow"], "alpha": 0.4, "linewidth": 0}
ANGLES = {"pitch": COLOURS["blue"], "yaw": COLOURS["vermilion"]}
SERIES = {
    "ranging minus orbit": {"color": COLOURS["sky"], "linewidth": 1.8},
    "phase centres": {"color": COLOURS["black"], "linewidth": 0.7},
    "difference, magnified": {"color": COLOURS["vermilion"], "linewidth": 0.6},
}
WIDE, DASHED = {"color": COLOURS["sky"], "linewidth": 1.4}, {"color": COLOURS["black"], "linestyle": "--"}
RESIDUAL = {"color": COLOURS["vermilion"]}
POINTS = {
    "least squares": {"color": COLOURS["black"], "marker": "o"},
    "robust": {"color": COLOURS["blue"], "marker": "s"},
    "one wiggle alone": {"color": COLOURS["vermilion"], "marker": "^"},
}
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


def report(*products, event, settings, published, nominal_m):
    """Report product of one event and its files {name: text}.

    Products are combine, pointing, noise, checks and three solve; published are plain records of the catalogue by
    section; nominal_m (2, 3) the phase centres of the catalogue.
    """
    named = dict(zip(("combine", "pointing", "noise", "checks"), products[:4], strict=True))
    named |= {f"solve.{one.attrs['observable']}": one for one in products[4:]}
    found = result(named, settings)
    checks = of_product(named["checks"])
    if found["status"] in documents.WITH_RESULT:
        tests = {name: one["p"] for name, one in found["consistency"]["manoeuvres"].items()}
        checks += of_result(named["combine"], tests, nominal_m, settings)
    document = documents.delivered("kbr_phase_centre", found, named, checks, event=event, settings=settings)
    files = {"result.json": documents.text(document)}
    files |= vector_files(document, gps_text(document["record"]["start"])[:10])
    span = " to ".join(gps_text(document["record"][name]) for name in ("start", "stop"))
    subtitle = f"Record {span} GPS, satellites {' and '.join(document['pair'])}, {document['ranging']}, "
    subtitle += f"{len(document['manoeuvres'])} wiggles. Vectors from centre of mass to phase centre, in SRF."
    files["report.html"] = page(
        document,
        sections(document, published),
        named,
        heading="Antenna phase centres",
        subtitle=subtitle,
        good=document["verdict"].get("accuracy_met"),
        lines=("Result for the sequence-of-events file", files["result.soe"]) if "result.soe" in files else None,
    )
    blocks = list(document.get("adopted", {}).get("satellites", {}).values()) or [{}, {}]
    known = {
        name: np.array([one.get(key, [None] * 3) for one in blocks], dtype=float)
        for name, key in (("centre", "phase_centre_mm"), ("sigma", "sigma_mm"))
    }
    values = {name: 1e-3 * value for name, value in known.items()}
    return build(SCHEMAS["report"], values, status=document["status"], event=event), files


def sections(document, published):
    """Sections of the page of a judged document, beside the printed records of the catalogue."""
    if "satellites" not in document:
        caption = "Pointing of the line of sight in both satellites: left the record, right a part of it."
        return [Section("Pointing", figures=[replace(_angles, caption=caption)])]
    notes = list(document["trust"])
    if document["settings"].get("model"):
        notes.append(f"A phase centre that moves is that at {gps_text(document['epoch'])}, the middle of the wiggles.")
    notes += [one["text"] for one in document["indistinguishable_from_calibration"]]
    results = [_result_table(document, published, estimator) for estimator in ESTIMATORS]
    return [
        Section("Result", results, [replace(_estimates, arguments=[document])], notes),
        Section("Sub-sets and geometry", [_subset_table(document, published), _geometry_table(document)]),
        Section("Wiggles", [_manoeuvre_table(document)], [_angles, _series]),
        Section("Noise", [_noise_table(document)], [_spectra, _noise]),
        Section("Against published vectors", [_vector_table(document, published)]),
    ]


# Document


def result(products, settings) -> dict:
    """What was found in one event, of the products by stage: the result document but for its head and tail."""
    combined, pointed = products["combine"], products["pointing"]
    about = {
        "direction": "com_to_phase_centre",
        "pair": pointed.attrs["satellites"],
        "ranging": pointed.attrs["ranging"],
        "record": {"start": float(pointed["time"].values[0]), "stop": float(pointed["time"].values[-1])},
        "noise": _noise_of(products["noise"]),
    }
    if pointed.sizes["manoeuvre"]:
        return about | _determined(combined, pointed, settings)
    reason = f"No wiggle in the pointing angles of either satellite: nothing to calibrate. {ROUTINE}"
    return about | {"status": "no_manoeuvre", "verdict": {"text": reason}, "manoeuvres": []}


def _determined(combined, pointed, settings):
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
        name: plain.chi_square_test(combined["arcs_chi2"].values[k], combined["arcs_dof"].values[k])
        for k, name in enumerate(OBSERVABLES)
    }
    published = [PUBLISHED] if combined.attrs["method"] == "published" else []
    one_sided = np.isfinite(_sigma_ratio(combined["covariance"].values[1, 0, 0], 0))
    # error of the mean of y and z as the scatter between sub-manoeuvres shows it
    satellite, axis = combined["satellite_index"].values, combined["axis_index"].values
    scatter = {name: {} for name in OBSERVABLES}
    for o, name in enumerate(OBSERVABLES):
        for k, letter in enumerate(combined.attrs["satellites"]):
            own = [1e3 * combined["arc_value"].values[o, (satellite == k) & (axis == a)] for a in (1, 0)]
            spread = [np.std(v, ddof=1) / np.sqrt(v.size) if v.size > 1 else np.nan for v in own]
            scatter[name][letter] = [None, *numbers(spread)]
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
        "consistency": {"manoeuvres": tests, "scatter_between_manoeuvres_mm": scatter},
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


def _noise_of(measured):
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


def vector_files(document, date) -> dict[str, str]:
    """Vector files and lines of the sequence-of-events file of the adopted result, {name: text}.

    "VKB1B_date_letter_04.txt" and "result.soe", of what is determined in x, y and z; unless all data were measured no
    vector file and comments for lines.
    """
    files, lines = {}, []
    if document["status"] not in documents.WITH_RESULT:
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


# Tables


def _result_table(document, published, estimator):
    name, source = PRINTED_IN[estimator]
    known = {_place(one["labels"]): one for one in published.get(estimator, [])}
    rows = []
    for letter, blocks in document["satellites"].items():
        for k, axis in enumerate("xyz"):
            row = [f"GRACE-{letter} {axis}"]
            for observable in OBSERVABLES:
                block, printed = blocks[observable][estimator], known.get((letter, axis, observable))
                row.append(plus_minus(block["phase_centre_mm"][k], block["sigma_mm"][k]))
                value = printed["value"][0] if printed else None
                digits = 1 if value is not None and abs(value) >= 100 else 2
                row.append(plus_minus(value, printed["sigma"][0], digits=digits) if printed else NOT_DETERMINED)
            rows.append(row)
    caption = (
        f"Phase centres by {name}, millimetres. Printed: 10.3390/rs14143395, {source}, September 2020; its range "
        "columns were not detrended."
    )
    heads = ["mm"] + [head for title in TITLES.values() for head in (title, "printed")]
    return Table(caption, heads, rows, reads=["combine"])


def _place(labels):
    """Letter, axis and observable of a printed record."""
    return labels["satellite"][-1].upper(), labels["component"], labels["observable"]


def _subset_table(document, published):
    joint = {_place(one["labels"]): one["value"][0] for one in published.get("ls", [])}
    known = {(one["labels"]["subset"], *_place(one["labels"])): one["value"][0] for one in published.get("subsets", [])}
    rows = []
    for name, axes in (("positive", "xyz"), ("mirror", "xyz"), ("positive_x_fixed", "yz"), ("mirror_x_fixed", "yz")):
        for letter, block in document["subsets"][name]["range_rate"].items():
            for axis in axes:
                k, place = "xyz".index(axis), (letter, axis, "range_rate")
                both = (name, *place) in known and place in joint
                shift = known[name, *place] - joint[place] if both else None
                value = plus_minus(block["phase_centre_mm"][k], block["sigma_mm"][k])
                moved = [signed(one, 3) for one in (block["shift_mm"][k], block["predicted_shift_mm"][k], shift)]
                rows.append([f"{name.replace('_x_fixed', ', x held')}, GRACE-{letter} {axis}", value, *moved])
    caption = (
        "One-sided sets, range rate, millimetres: shift against all wiggles, and tan(offset) times the shift of x; "
        "with x held, by what the catalogue's x misses. Printed: Table 5 minus Table 4, range rate."
    )
    return Table(caption, ["set", "value", "shift", "predicted", "printed shift"], rows, reads=["combine"])


def _geometry_table(document):
    own = document["geometry"]
    rows = [
        [name.replace("_", " "), *(signed(own["condition"][one][name], 1) for one in OBSERVABLES)]
        for name in own["condition"]["range"]
    ]
    ratio = ", ".join(signed(value, 4) for value in own["one_sided_sigma_ratio"]["positive"])
    caption = (
        "Condition number of the whitened, detrended columns. Error of y and z over that of x, positive only: "
        f"{ratio}; tan of the offset angle: {signed(own['tan_offset'], 4)}."
    )
    return Table(caption, ["set", *TITLES.values()], rows, reads=["combine"])


def _manoeuvre_table(document):
    rows = []
    for one in document["manoeuvres"]:
        span = one["start"] - document["record"]["start"], one["stop"] - one["start"]
        angles = signed(one["offset_deg"], 2), signed(one["amplitude_deg"], 2)
        found = [plus_minus(**own, digits=4) for own in one["estimates_mm"].values()]
        label = f"{one['satellite']} {one['kind']}"
        rows.append([label, *(f"{seconds:.0f}" for seconds in span), *angles, one["component"], *found])
    scatter = document["consistency"]["scatter_between_manoeuvres_mm"]["range_rate"]
    spread = [f"{k} {axis} {signed(v, 4)}" for k, own in scatter.items() for axis, v in zip("yz", own[1:], strict=True)]
    agree = [f"{TITLES[name]} {chi_square(test)}" for name, test in document["consistency"]["manoeuvres"].items()]
    caption = (
        "Sub-manoeuvres found in the pointing angles, and the component each tells alone, millimetres. "
        f"Disagreement, chi-square / degrees of freedom, probability: {'; '.join(agree)}. Error of the mean by the "
        f"scatter between wiggles, range rate: {', '.join(spread)}."
    )
    heads = ["wiggle", "start, s", "length, s", "offset, °", "amplitude, °", "", *TITLES.values()]
    return Table(caption, heads, rows, reads=["combine"])


def _noise_table(document):
    own = document["noise"]
    quiet, inside = own["quiet_um_rthz"], own["manoeuvres_um_rthz"]
    rows = [[f"{name[0]} mHz", signed(quiet[name], 2), signed(inside[name], 2)] for name in quiet]
    caption = (
        f"Noise of the range, µm/√Hz, from {own['source']} data of {own['seconds']:.0f} s. Star cameras as seen by the "
        f"ranging in the wiggles: {signed(own['star_camera_urad_rthz_4_mhz'], 2)} µrad/√Hz at 4 mHz."
    )
    return Table(caption, ["frequency", "quiet", "in wiggles"], rows, reads=["noise"])


def _vector_table(document, published):
    rows = []
    for letter, block in document["adopted"]["satellites"].items():
        values = [plus_minus(v, s) for v, s in zip(block["phase_centre_mm"], block["sigma_mm"], strict=True)]
        rows.append([f"GRACE-{letter}, this event", *values])
        for one in published.get("vkb1b", []):
            if one["labels"]["satellite"] == f"grace-{letter.lower()}" and None not in one["value"]:
                x, y, z = one["value"]
                name = one["labels"]["solution"].replace("_", " ")
                rows.append([f"GRACE-{letter}, {name}", signed(x, 1), signed(y / 1e3, 4), signed(z / 1e3, 4)])
    caption = "Vectors in millimetres; printed: 10.3390/rs14143395, Tables 7 and 8."
    return Table(caption, ["", "x", "y", "z"], rows, reads=["combine"])


# Figures


@figure(
    "pointing",
    caption="Pointing of the line of sight in both satellites: left the record, wiggles shaded; right the first wiggle "
    "of each.",
)
def _angles(pointed):
    time, angle = pointed["time"].values, np.degrees(pointed["angle"].values)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    figure, panels = grid(2, 2, 3.8, width_ratios=(2, 1), margins={"wspace": 0.12, "hspace": 0.34})
    for k, (left, right) in enumerate(panels):
        own = spans[pointed["satellite_index"].values == k]
        left.set_title(f"GRACE-{pointed.attrs['satellites'][k]}, line of sight in the satellite, °")
        right.set_title("first wiggle" if own.size else "detail")
        for start, stop in (own - time[0]) / 3600:
            left.axvspan(start, stop, label="wiggle", **SHADE)
        since = time - (own[0, 0] if own.size else time[0] + 1000)
        near = (since > -120) & (since < 1130)
        for axis, (name, colour) in enumerate(ANGLES.items()):
            left.plot(*thinned((time - time[0]) / 3600, angle[k, :, axis]), color=colour, linewidth=0.8, label=name)
            right.plot(since[near], angle[k, near, axis], color=colour, linewidth=0.8)
    left.set_xlabel("hours of the record")
    right.set_xlabel("s from the slew" if own.size else "s")
    return figure


@figure(
    "solve.*",
    caption="Ranging minus orbit and the fitted phase centres in one pitch and one yaw wiggle, slow part removed from "
    "both; below, shifted down, their difference, magnified as the title says.",
)
def _series(solved):
    first = solved["range"]
    chosen = [np.flatnonzero(first["axis_index"].values == axis) for axis in (0, 1)]
    chosen = [own[0] for own in chosen if own.size]
    if not chosen or not first["time_kbr"].size:
        return None
    figure, panels = grid(3, len(chosen), 5.0, xlabel="s", margins={"wspace": 0.14, "hspace": 0.36})
    for row, name in zip(panels, OBSERVABLES, strict=True):
        one, (unit, factor) = solved[name], UNITS[name]
        for panel, k in zip(row, chosen, strict=True):
            inside = one["arc"].values == k
            time = one["time_kbr"].values[inside]
            if not time.size:
                continue
            measured, model = (factor * one[key].values[inside] for key in ("detrended", "modelled"))
            left, span = measured - model, np.ptp(model)
            power = 10 ** max(int(np.floor(np.log10(0.6 * span / max(np.ptp(left), 1e-12)))), 0)  # of magnification
            curves = (measured, model, power * left - 1.1 * span)
            for values, (label, style) in zip(curves, SERIES.items(), strict=True):
                panel.plot(*thinned(*opened(time - time[0], values, 20)), label=label, **style)
            letter = one.attrs["satellites"][int(one["satellite_index"].values[k])]
            axis = tuple(ANGLES)[int(one["axis_index"].values[k])]
            panel.set_title(f"{TITLES[name]}, {unit}: {letter} {axis}, difference × {power}")
    return figure


@figure(
    "solve.*",
    caption="Density of ranging minus orbit in the wiggles, before and after the fit; dotted: 4 and 8 mHz, the wiggle "
    f"and its second harmonic. {HANN} over each wiggle, mean power.",
)
def _spectra(solved):
    if not solved["range"]["time_kbr"].size:
        return None
    titles = [f"{TITLES[name]}, {UNITS[name][0]}/√Hz" for name in OBSERVABLES]
    figure, (panels,) = grid(1, 3, 2.5, titles=titles, margins={"left": 0.065, "wspace": 0.24})
    for panel, name in zip(panels, OBSERVABLES, strict=True):
        one, factor = solved[name], UNITS[name][1] ** 2
        frequency = one["frequency"].values
        _density(panel, frequency, factor * one["spectrum_observed"].values, "ranging minus orbit", WIDE)
        _density(panel, frequency, factor * one["spectrum_residual"].values, "residual", RESIDUAL)
    return figure


@figure(
    "noise",
    caption="Noise of the range: quiet data, their model, and the residual in the wiggles, where the star camera adds "
    f"its error times the tilt of the antenna. {HANN} over each stretch or wiggle, mean power.",
)
def _noise(measured):
    figure, ((panel,),) = grid(1, 1, 2.4, titles=["noise, µm/√Hz"])
    styles = {
        "density": ("quiet data", WIDE),
        "model": ("model", DASHED),
        "in_manoeuvres": ("in the wiggles", RESIDUAL),
    }
    for name, (label, style) in styles.items():
        _density(panel, measured["frequency"].values, 1e12 * measured[name].values, label, style)
    return figure


def _density(panel, frequency, power, label, style):
    """Logarithmic amplitude density with the frequencies of the wiggle; nothing where there is none."""
    if not np.any(power > 0):
        return
    if not panel.lines:
        for harmonic in (4e-3, 8e-3):
            panel.axvline(harmonic, color=COLOURS["grey"], linewidth=0.7, linestyle=":")
    panel.loglog(frequency, np.sqrt(np.where(power > 0, power, np.nan)), label=label, **style)
    panel.set(xlabel="Hz", xlim=(frequency[0], frequency[-1]))


@figure(
    "combine",
    caption="y and z of both satellites: every observable by least squares and with robust weights, then each wiggle "
    "alone; error bars one standard deviation, band the adopted value.",
)
def _estimates(document):
    figure, panels = grid(2, 2, 4.2, margins={"wspace": 0.14, "hspace": 0.42, "bottom": 0.09})
    for row, (letter, blocks) in zip(panels, document["satellites"].items(), strict=True):
        for panel, k in zip(row, (1, 2), strict=True):
            points, labels = [], ["range", "rate", "acceler-\nation"]
            for place, name in enumerate(OBSERVABLES):
                for shift, estimator, kind in ((-0.14, "ls", "least squares"), (0.14, "robust", "robust")):
                    own = blocks[name][estimator]
                    points.append((place + shift, own["phase_centre_mm"][k], own["sigma_mm"][k], kind))
            for one in document["manoeuvres"]:
                if one["satellite"] == letter and one["component"] == "xyz"[k]:
                    own = one["estimates_mm"]["range_rate"]
                    points.append((len(labels), own["value"], own["sigma"], "one wiggle alone"))
                    labels.append(f"{one['kind'].replace('-', '−')}\nalone")
            adopted = document["adopted"]["satellites"][letter]
            value, sigma = adopted["phase_centre_mm"][k], adopted["sigma_mm"][k]
            if value is not None:
                panel.axhspan(value - sigma, value + sigma, label="adopted", **SHADE)
            for place, centre, error, kind in points:
                if centre is not None and error is not None:
                    bars(panel, [place], [centre], [error], label=kind, **POINTS[kind])
            panel.set_xticks(range(len(labels)), labels)
            panel.set(title=f"GRACE-{letter} {'xyz'[k]}, mm", xlim=(-0.6, len(labels) - 0.4))
    return figure
