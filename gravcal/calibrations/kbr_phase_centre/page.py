"""Report of a ranging calibration: its product, result document, files, and the page, section by section."""

from dataclasses import replace

import numpy as np

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre.checks import of_result
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, SCHEMAS, SUBSETS, middle
from gravcal.calibrations.schemas import build
from gravcal.io.vcm import commented, vector_file, vector_line
from gravcal.report import documents, pages, plain
from gravcal.report.figures import COLOURS, bars, grid, opened, thinned
from gravcal.report.pages import Section
from gravcal.report.plain import NOT_DETERMINED, gps_text, number, numbers, plus_minus, signed

WORDS = pages.words(__file__, "page.toml")
TITLES = {name: name.replace("_", " ") for name in OBSERVABLES}
UNITS = {"range": ("µm", 1e6), "range_rate": ("nm/s", 1e9), "range_acceleration": ("nm/s²", 1e9)}
STYLES = WORDS.styles
ARM = 1.444  # m, from the centre of mass to the phase centre: turns an error of y or z into one of direction


def report(*products, event, settings, published, nominal_m):
    """Report product of one event and its files {name: text}.

    Products are combine, pointing, noise, checks and three solve; published are plain records of the catalogue by
    section; nominal_m (2, 3) the phase centres of the catalogue.
    """
    named = dict(zip(("combine", "pointing", "noise", "checks"), products[:4], strict=True))
    named |= {f"solve.{one.attrs['observable']}": one for one in products[4:]}
    body = result(named, settings)
    checks = of_product(named["checks"])
    if body["status"] in documents.WITH_RESULT:
        tests = {name: one["p"] for name, one in body["consistency"]["manoeuvres"].items()}
        checks += of_result(named["combine"], tests, nominal_m, settings)
    document = documents.delivered("kbr_phase_centre", body, named, checks, event=event, settings=settings)
    files = {"result.json": documents.text(document)}
    files |= vector_files(document, gps_text(document["record"]["start"])[:10])
    files["report.html"] = pages.page(
        document,
        sections(document, published),
        named,
        heading="Antenna phase centres",
        subtitle=WORDS.note("subtitle", **document),
        good=document["verdict"].get("accuracy_met"),
        lines=("Result for the sequence-of-events file", files["result.soe"]) if "result.soe" in files else None,
    )
    blocks = list(document.get("adopted", {}).get("satellites", {}).values()) or [{}, {}]
    values = {
        name: 1e-3 * np.array([one.get(key, [None] * 3) for one in blocks], dtype=float)
        for name, key in (("centre", "phase_centre_mm"), ("sigma", "sigma_mm"))
    }
    return build(SCHEMAS["report"], values, status=document["status"], event=event), files


def sections(document, published):
    """Sections of the page of a judged document, with the printed records of the catalogue, {section: [record]}."""
    if "satellites" not in document:
        return [Section("Pointing", figures=[replace(_angles, caption=WORDS.note("no_wiggle"))])]
    notes = [*document["trust"], *WORDS.said("result", **document)]
    results = [_result_table(document, published, estimator) for estimator in ESTIMATORS]
    return [
        Section("Result", results, [replace(_estimates, arguments=[document])], notes),
        Section("Sub-sets and geometry", [_subset_table(document, published), WORDS.table("geometry", document)]),
        Section("Wiggles", [WORDS.table("manoeuvres", document)], [_angles, _series]),
        Section("Noise", [WORDS.table("noise", document)], [_spectra, _noise]),
        Section("Against published vectors", [_vector_table(document, published)]),
    ]


def result(products, settings) -> dict:
    """Result document of one event but for its head and tail, from the products {stage: Dataset}."""
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
    reason = f"No wiggle in the pointing angles of either satellite: nothing to calibrate. {WORDS.note('routine')}"
    return about | {"status": "no_manoeuvre", "verdict": {"text": reason}, "manoeuvres": []}


def _determined(combined, pointed, settings):
    """Result document of an event with wiggles, from the combine and pointing products."""
    letters, observable = combined.attrs["satellites"], combined.attrs["adopted_observable"]
    estimator = combined.attrs["adopted_estimator"]
    satellites = {
        letter: {
            name: {kind: _block(combined, (o, 0, e), k) for e, kind in enumerate(ESTIMATORS)}
            for o, name in enumerate(OBSERVABLES)
        }
        for k, letter in enumerate(letters)
    }
    adopted = {letter: estimates[observable][estimator] for letter, estimates in satellites.items()}
    determined = any(value is not None for block in adopted.values() for value in block["phase_centre_mm"])
    tests = {
        name: plain.chi_square_test(combined["arcs_chi2"].values[k], combined["arcs_dof"].values[k])
        for k, name in enumerate(OBSERVABLES)
    }
    published = [WORDS.note("published")] if combined.attrs["method"] == "published" else []
    ratio_known = np.isfinite(_sigma_ratio(combined["covariance"].values[1, 0, 0], 0))
    # error of the mean of y and z as the scatter between sub-manoeuvres shows it
    satellite, axis, value = (combined[name].values for name in ("satellite_index", "axis_index", "arc_value"))
    scatter = {name: {} for name in OBSERVABLES}
    for o, name in enumerate(OBSERVABLES):
        for k, letter in enumerate(combined.attrs["satellites"]):
            estimates = [1e3 * value[o, np.isfinite(value[o]) & (satellite == k) & (axis == a)] for a in (1, 0)]
            spread = [np.std(v, ddof=1) / np.sqrt(v.size) if v.size > 1 else np.nan for v in estimates]
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
            "rule": WORDS.note("adopted"),
            "satellites": adopted,
        },
        "manoeuvres": [_manoeuvre(combined, pointed, k) for k in range(pointed.sizes["manoeuvre"])],
        "subsets": {name: _subset(combined, s) for s, name in enumerate(SUBSETS) if s},
        "geometry": _geometry(combined, pointed),
        "consistency": {"manoeuvres": tests, "scatter_between_manoeuvres_mm": scatter},
        "sigma0": {name: numbers(combined["sigma0"].values[k, 0]) for k, name in enumerate(OBSERVABLES)},
        "trust": [*published, *(WORDS.notes["geometry"] if ratio_known else ()), WORDS.note("robust")],
        "indistinguishable_from_calibration": WORDS.notes["indistinguishable"],
    }


def _block(combined, index, satellite):
    """Phase centre mm of an index (observable, sub-set, estimator) and satellite as JSON, null if not determined."""
    axes = slice(3 * satellite, 3 * satellite + 3)
    determined, centre, formal = (combined[name].values for name in ("determined", "centre", "formal_sigma"))
    determined, covariance = determined[index[:2]][axes] != 0, combined["covariance"].values[index][axes, axes]
    block = plain.offset_block(centre[index][axes], covariance, determined, "phase_centre", "mm")
    return block | {"formal_sigma_mm": numbers(np.where(determined, 1e3 * formal[index][axes], np.nan))}


def _verdict(adopted, source, test, settings):
    """Verdict as JSON: one sentence, and whether accuracy is met and manoeuvres agree; adopted {letter: block}."""
    words, angles = [], []
    for letter, block in adopted.items():
        pairs = zip("xyz", block["phase_centre_mm"], block["sigma_mm"], strict=True)
        parts = [f"{axis} {value:.3f} +- {sigma:.3f}" for axis, value, sigma in pairs if value is not None]
        words.append(f"{letter}: {', '.join(parts)} mm" if parts else f"{letter}: not determined")
        angles += [sigma / ARM for sigma in block["sigma_mm"][1:] if sigma is not None]
    consistent = None if test["p"] is None else bool(test["p"] >= settings["consistency_level"])
    text = f"{'; '.join(words)} ({source})."
    count, limit = 2 * len(adopted), settings["requirement_mrad"]
    known = f" in {len(angles)} of {count} components" if len(angles) < count else ""
    if angles:
        text += f" Direction known to {1e3 * max(angles):.1f} urad{known}, required {1e3 * limit:.0f}."
    if consistent is not None:
        text += " Manoeuvres agree." if consistent else f" Manoeuvres disagree (p {test['p']:.1g})."
    met = bool(angles) and len(angles) == count and max(angles) <= limit
    return {"text": text, "accuracy_met": met, "consistent": consistent}


def _manoeuvre(combined, pointed, k):
    """Sub-manoeuvre number k as JSON, with its own estimate of the component across the line of sight."""
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
        "estimates_mm": {n: {"value": number(value[o]), "sigma": number(sigma[o])} for o, n in enumerate(OBSERVABLES)},
    }


def _subset(combined, s):
    """Sub-set number s as JSON, {observable: {letter: block}}, with the shifts that the geometry predicts."""
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
    """Condition numbers, median offset angle, and the ratio of the errors that it sets, as JSON."""
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
    """Ratio of the rms sigma of y and z to that of x, of one satellite (0 or 1), covariance (6, 6) m2."""
    sigma = np.sqrt(np.diag(covariance))[3 * satellite : 3 * satellite + 3]
    return np.sqrt(np.mean(sigma[1:] ** 2)) / sigma[0]


def _noise_of(measured):
    """Noise of ranging and star cameras at the wiggle and its second harmonic, as JSON; null where not measured."""

    def amplitudes(density):
        """Amplitude densities {frequency: um Hz-1/2} of a variable, at 4 and 8 mHz."""
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
        files[name] = vector_file(name, [time], letter, [vector], source=source)
    return files | ({"result.soe": "\n".join(lines) + "\n"} if lines else {})


def _result_table(document, published, estimator):
    """Table of phase centres by one estimator, ours beside the printed ones, a row for each satellite and axis."""
    records = {_place(one["labels"]): one for one in published.get(estimator, [])}
    rows = []
    for letter, blocks in document["satellites"].items():
        for k, axis in enumerate("xyz"):
            row = [f"GRACE-{letter} {axis}"]
            for observable in OBSERVABLES:
                block, printed = blocks[observable][estimator], records.get((letter, axis, observable))
                row.append(plus_minus(block["phase_centre_mm"][k], block["sigma_mm"][k]))
                value = printed["value"][0] if printed else None
                digits = 1 if value is not None and abs(value) >= 100 else 2
                row.append(plus_minus(value, printed["sigma"][0], digits=digits) if printed else NOT_DETERMINED)
            rows.append(row)
    return WORDS.table(estimator, rows)


def _place(labels):
    """Letter, axis and observable of a printed record, from its labels."""
    return labels["satellite"][-1].upper(), labels["component"], labels["observable"]


def _subset_table(document, published):
    """Table of one-sided and x-fixed solutions of the range rate, with observed, predicted and printed shifts."""
    joint = {_place(one["labels"]): one["value"][0] for one in published.get("ls", [])}
    known = {(one["labels"]["subset"], *_place(one["labels"])): one["value"][0] for one in published.get("subsets", [])}
    rows = []
    for name, axes in (("positive", "xyz"), ("mirror", "xyz"), ("positive_x_fixed", "yz"), ("mirror_x_fixed", "yz")):
        for letter, block in document["subsets"][name]["range_rate"].items():
            for axis in axes:
                k, place = "xyz".index(axis), (letter, axis, "range_rate")
                available = (name, *place) in known and place in joint
                shift = known[name, *place] - joint[place] if available else None
                value = plus_minus(block["phase_centre_mm"][k], block["sigma_mm"][k])
                shifts = [signed(one, 3) for one in (block["shift_mm"][k], block["predicted_shift_mm"][k], shift)]
                rows.append([f"{name.replace('_x_fixed', ', x held')}, GRACE-{letter} {axis}", value, *shifts])
    return WORDS.table("subsets", rows)


def _vector_table(document, published):
    """Table of the adopted phase centres beside the printed VKB1B vectors."""
    rows = []
    for letter, block in document["adopted"]["satellites"].items():
        values = [plus_minus(v, s) for v, s in zip(block["phase_centre_mm"], block["sigma_mm"], strict=True)]
        rows.append([f"GRACE-{letter}, this event", *values])
        for one in published.get("vkb1b", []):
            if one["labels"]["satellite"] == f"grace-{letter.lower()}" and None not in one["value"]:
                x, y, z = one["value"]
                name = one["labels"]["solution"].replace("_", " ")
                rows.append([f"GRACE-{letter}, {name}", signed(x, 1), signed(y / 1e3, 4), signed(z / 1e3, 4)])
    return WORDS.table("vectors", rows)


@WORDS.figure("pointing")
def _angles(panels, pointed):
    """Pitch and yaw of the line of sight of both satellites: whole record, and the first wiggle."""
    time, angle = pointed["time"].values, np.degrees(pointed["angle"].values)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    for k, (left, right) in enumerate(panels):
        wiggles = spans[pointed["satellite_index"].values == k]
        left.set_title(f"GRACE-{pointed.attrs['satellites'][k]}, line of sight in the satellite, °")
        right.set_title("first wiggle" if wiggles.size else "detail")
        for start, stop in (wiggles - time[0]) / 3600:
            left.axvspan(start, stop, label="wiggle", **STYLES["shade"])
        since = time - (wiggles[0, 0] if wiggles.size else time[0] + 1000)
        near = (since > -120) & (since < 1130)
        for axis, (name, colour) in enumerate(STYLES["angles"].items()):
            left.plot(*thinned((time - time[0]) / 3600, angle[k, :, axis]), color=colour, linewidth=0.8, label=name)
            right.plot(since[near], angle[k, near, axis], color=colour, linewidth=0.8)
    left.set_xlabel("hours of the record")
    right.set_xlabel("s from the slew" if wiggles.size else "s")


@WORDS.figure("solve.*")
def _series(solved):
    """Detrended observations, model and magnified residual of one wiggle about each axis, for each observable."""
    range_solution = solved["range"]
    chosen = [np.flatnonzero(range_solution["axis_index"].values == axis) for axis in (0, 1)]
    chosen = [own[0] for own in chosen if own.size]
    if not chosen or not range_solution["time_kbr"].size:
        return None
    figure, panels = grid(3, len(chosen), 5.0, xlabel="s", margins={"wspace": 0.2, "hspace": 0.36})
    for row, name in zip(panels, OBSERVABLES, strict=True):
        solution, (unit, factor) = solved[name], UNITS[name]
        for panel, k in zip(row, chosen, strict=True):
            inside = solution["arc"].values == k
            time = solution["time_kbr"].values[inside]
            if not time.size:
                continue
            measured, model = (factor * solution[key].values[inside] for key in ("detrended", "modelled"))
            residual, span = measured - model, np.ptp(model)
            power = 10 ** max(int(np.floor(np.log10(0.6 * span / max(np.ptp(residual), 1e-12)))), 0)  # of magnification
            curves = (measured, model, power * residual - 1.1 * span)
            for values, (label, style) in zip(curves, STYLES["series"].items(), strict=True):
                panel.plot(*thinned(*opened(time - time[0], values, 20)), label=label, **style)
            letter = solution.attrs["satellites"][int(solution["satellite_index"].values[k])]
            axis = tuple(STYLES["angles"])[int(solution["axis_index"].values[k])]
            magnified = f", difference × {power}" if power > 1 else ""
            panel.set_title(f"{TITLES[name]}, {unit}: {letter} {axis}{magnified}")
    return figure


@WORDS.figure("solve.*")
def _spectra(panels, solved):
    """Amplitude spectral density of ranging minus orbit and of its residual, for each observable."""
    if not solved["range"]["time_kbr"].size:
        return
    for panel, name in zip(panels, OBSERVABLES, strict=True):
        solution, factor = solved[name], UNITS[name][1] ** 2
        frequency = solution["frequency"].values
        _density(panel, frequency, factor * solution["spectrum_observed"].values, "ranging minus orbit", STYLES["wide"])
        _density(panel, frequency, factor * solution["spectrum_residual"].values, "residual", STYLES["residual"])


@WORDS.figure("noise")
def _noise(panel, measured):
    """Amplitude spectral density of the range residual: quiet data, model, wiggles."""
    frequency = measured["frequency"].values
    _density(panel, frequency, 1e12 * measured["density"].values, "quiet data", STYLES["wide"])
    _density(panel, frequency, 1e12 * measured["model"].values, "model", STYLES["dashed"])
    _density(panel, frequency, 1e12 * measured["in_manoeuvres"].values, "in the wiggles", STYLES["residual"])


def _density(panel, frequency, power, label, style):
    """Logarithmic amplitude density with the frequencies of the wiggle; nothing where there is none."""
    if not np.any(power > 0):
        return
    if not panel.lines:
        for harmonic in (4e-3, 8e-3):
            panel.axvline(harmonic, color=COLOURS["grey"], linewidth=0.7, linestyle=":")
    panel.loglog(frequency, np.sqrt(np.where(power > 0, power, np.nan)), label=label, **style)
    panel.set(xlabel="Hz", xlim=(frequency[0], frequency[-1]))


@WORDS.figure("combine")
def _estimates(panels, document):
    """Estimates of y and z by observable, estimator and single wiggle, with the adopted value."""
    for row, (letter, blocks) in zip(panels, document["satellites"].items(), strict=True):
        for panel, k in zip(row, (1, 2), strict=True):
            points, labels = [], ["range", "rate", "acceler-\nation"]
            for place, name in enumerate(OBSERVABLES):
                for shift, estimator, kind in ((-0.14, "ls", "least squares"), (0.14, "robust", "robust")):
                    estimate = blocks[name][estimator]
                    points.append((place + shift, estimate["phase_centre_mm"][k], estimate["sigma_mm"][k], kind))
            for manoeuvre in document["manoeuvres"]:
                if manoeuvre["satellite"] == letter and manoeuvre["component"] == "xyz"[k]:
                    estimate = manoeuvre["estimates_mm"]["range_rate"]
                    points.append((len(labels), estimate["value"], estimate["sigma"], "one wiggle alone"))
                    labels.append(f"{manoeuvre['kind'].replace('-', '−')}\nalone")
            adopted = document["adopted"]["satellites"][letter]
            value, sigma = adopted["phase_centre_mm"][k], adopted["sigma_mm"][k]
            if value is not None:
                panel.axhspan(value - sigma, value + sigma, label="adopted", **STYLES["shade"])
            for place, centre, error, kind in points:
                if centre is not None and error is not None:
                    bars(panel, [place], [centre], [error], label=kind, **STYLES["points"][kind])
            panel.set_xticks(range(len(labels)), labels)
            panel.set(title=f"GRACE-{letter} {'xyz'[k]}, mm", xlim=(-0.6, len(labels) - 0.4))
