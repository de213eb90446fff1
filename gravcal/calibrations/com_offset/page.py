"""Report of a centre-of-mass event: its product, result document, files, and the page, section by section."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from gravcal.calibrations.checks import at_least, at_most, largest, of_product
from gravcal.calibrations.com_offset.align import OUTLIER, REACH, SCHEMAS
from gravcal.calibrations.com_offset.estimate import HIGH_LATITUDE
from gravcal.calibrations.com_offset.estimate import adopted as adopted_variant
from gravcal.calibrations.schemas import build
from gravcal.estimation.least_squares import project_out
from gravcal.io.vcm import commented, vector_line
from gravcal.report import documents, pages, plain
from gravcal.report.figures import AXIS, COLOURS, bars, density, grid, joined, number_windows, thinned
from gravcal.report.pages import Section
from gravcal.report.plain import AXES, chi_square, gps_text, number, numbers, plus_minus, signed

WORDS = pages.words(__file__, "page.toml")
STYLES = WORDS.styles
VARIANTS = STYLES["variants"]  # colour, line and marker of each of the four angular accelerations
FROM_EDGE = "time from the first edge (s)"
PERIOD_S = 12.0  # of the square wave of the torquers
SPREAD = 0.24  # of the points of the variants about the place of their manoeuvre, which are 1 apart
STEP_S = 0.5  # of the grid of a solution
#: Products of the stage `report` in their order, around four "solve" and four "angular_acceleration".
SHOWN = ("offset", "sigma", "sigma_total")
SINGLE = ("combine", "attitude", "field", "survey", "detect", "align", "checks")
KINDS = ("roll", "pitch", "yaw")
WAVE_HZ = 1 / 12  # at which the document states the noise
SCALE_SHARE = 0.5  # of its prior sigma: a torque scale with a larger error only repeats the prior
ANGULAR_LIMIT = 0.2  # standard deviation of an angular scale from which on it is not determined
PRODUCTS = {"acc": "ACC1A", "sca": "SCA1B"}
GAPS = {"orbit": 1, "star camera": 2}  # bits of a gap too long to use a manoeuvre
CONFIDENCE = 2.0  # standard deviations between a value and a limit for a clear answer


def report(*products, event, satellite, settings, published):
    """Report product of one event and its files {name: text}.

    Products are combine, four each of solve and angular_acceleration, then the rest of `SINGLE`; published are plain
    records of the catalogue by section, {} where nothing was printed.
    """
    named = dict(zip(SINGLE, (products[0], *products[9:]), strict=True))
    named |= {f"solve.{one.attrs['variant']}": one for one in products[1:5]}
    named |= {f"angular_acceleration.{one.attrs['variant']}": one for one in products[5:9]}
    content = result(named, settings)
    checks = of_product(named["checks"])
    if "consistency" in content:
        checks += result_checks(named["combine"], content["consistency"], settings)
    document = documents.delivered("com_offset", content, named, checks, event=event, settings=settings)
    line = vcm_line(document, satellite)
    records = {section: [SimpleNamespace(**one) for one in rows] for section, rows in published.items()}
    files = {"result.json": documents.text(document)} | ({"result.vcm": line + "\n"} if line else {})
    files["report.html"] = html(document, named, records, line)
    name = document.get("adopted", {}).get("variant")
    block = document["variants"][name] if name else {}
    values = {key: 1e-6 * np.array(block.get(f"{key}_um", [None] * 3), dtype=float) for key in SHOWN}
    return build(SCHEMAS["report"], values, status=document["status"], adopted=name or "none", event=event), files


def html(document, products, published, vcm=None):
    """Page of one event, one self-contained HTML text."""
    verdict = document["verdict"]
    return pages.page(
        document,
        sections(document, published),
        products,
        heading="Centre-of-mass offset",
        subtitle=WORDS.note("subtitle", **document),
        good=verdict["accuracy_met"] and verdict["consistent"] is not False if "requirement" in verdict else None,
        badges=badges(document) if "variants" in document else (),
        lines=("Result as a VCM line", vcm) if vcm else None,
    )


def sections(document, published):
    """Sections of the page of an event; without manoeuvre only field, attitude and roll response."""
    if "variants" not in document:
        return [
            Section("Magnetic field", [WORDS.table("field", document)], [_field]),
            Section("Attitude", figures=[_attitude], notes=WORDS.said("attitude", **document)),
            Section("Torque against roll acceleration", figures=[_roll], notes=WORDS.said("roll", **document)),
        ]
    adopted = document["adopted"]["variant"] or "mtq"
    printed = printed_manoeuvres(document, published)
    caption = f"{_estimates.caption} {WORDS.note('bands', adopted=adopted)}{' Hollow: printed values.' * bool(printed)}"
    shown = replace(_estimates, arguments=(document, printed), caption=caption)
    solved = f"solve.{adopted}"
    fits = [replace(_spectra, reads=(solved,)), replace(_linear_accelerations, reads=(solved, "detect"))]
    sources = sorted({one.source for name in ("combined", "manoeuvres") for one in published.get(name, ())})
    tests = document["consistency"]
    named = {f"manoeuvres, {name}": one for name, one in tests["manoeuvres"]["by_variant"].items()}
    named |= {"acc and sca": tests["variants"], "mtq and acc, within catalogue error": tests["catalogue"]}
    agreement = WORDS.table("agreement", named, level=tests["level"])
    every = {
        "acc_shift_s": document["delays_s"]["acc"],
        "sca_shift_s": document["delays_s"]["sca"],
        "torque_scale": document["scales"]["torque"],
        "angular_scale": document["scales"]["angular"],
        "attitude_rms_urad": document["attitude"]["rms_urad"],
    }
    rows = [one | {"label": f"{index} {one['kind']}"} for index, one in enumerate(document["manoeuvres"], start=1)]
    instruments = WORDS.table("instruments", [*rows, every | {"label": "all; tags late"}])
    notes = WORDS.said("result", sources=sources, **{"method": "gravcal"} | document)
    return [
        Section("Result", [_combined_table(document, published)], [shown], notes),
        Section("Agreement and field check", [agreement, WORDS.table("field", document)], beside=True),
        Section("Every manoeuvre", [_manoeuvre_table(document, printed)]),
        Section("Linear acceleration", figures=fits),
        Section("Angular acceleration and time", [instruments], [_angular_accelerations]),
        Section("Torquers and attitude", figures=[_torquers, _attitude]),
        Section("Magnetic field", figures=[_field]),
    ]


def badges(document):
    """Badges (title, good: True, False or None, text) for status, requirement, accuracy and consistency."""
    verdict, adopted, status = document["verdict"], document["adopted"]["variant"], document["status"]
    answers = [(status, status == "delivered", f"adopted: {adopted or 'no variant'}")]
    if "requirement" in verdict:
        within, tests = verdict["requirement"], document["consistency"]
        met = False if "exceeds" in within else True if set(within) == {"within"} else None
        axes_text = ", ".join(f"{axis} {word}" for axis, word in zip(AXES, within, strict=True))
        errors = ", ".join(signed(sigma, 1) for sigma in document["variants"][adopted]["sigma_total_um"])
        agree = f"manoeuvres {tests['manoeuvres']['verdict']}, angular acc. {tests['variants']['verdict']}"
        answers += [
            (f"offset ≤ {verdict['requirement_um']:g} µm", met, axes_text),
            (f"accuracy ≤ {verdict['accuracy_um']:g} µm", verdict["accuracy_met"], f"total error x, y, z: {errors} µm"),
            ("consistent", verdict["consistent"], agree),
        ]
    return answers


def result(products, settings):
    """Body of the result document of an event from {stage: product}; "combine" is None without manoeuvre."""
    detected, combined = products["detect"], products["combine"]
    smoothed, field = products["attitude"], products["field"]
    residual = smoothed["sca_residual_b"].values
    rms = np.sqrt(np.mean(residual**2, axis=0)) if len(residual) else np.full(3, np.nan)
    record = {name: number(detected[f"record_{name}"].values) for name in ("start", "stop")}
    content = {
        "status": "no_manoeuvre",
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
        "outliers": {PRODUCTS[n]: int(np.sum(products["align"][f"{n}_flag"].values == OUTLIER)) for n in REACH},
        "roll_response": None if detected.sizes["manoeuvre"] else roll_response(products["survey"], settings),
    }
    if not detected.sizes["manoeuvre"] or combined is None:
        dated = None not in record.values()
        span = f" of {' to '.join(gps_text(time) for time in record.values())} GPS" if dated else ""
        return content | {"verdict": {"text": f"No manoeuvre in the torquer currents{span}: nothing to calibrate."}}
    solved = next(one for name, one in products.items() if name.startswith("solve."))
    blocks = variants(combined)
    chosen = {"variant": adopted_variant(combined), "rule": WORDS.note("rule")}
    agreement = consistency(combined, chosen["variant"], float(settings["consistency_level"]))
    determined = any(item is not None for block in blocks.values() for item in block["offset_um"])
    density = [np.interp(WAVE_HZ, solved["frequency"].values, row) for row in solved["noise_density"].values]
    return content | {
        "status": "delivered" if determined else "failed",
        "verdict": verdict(blocks, chosen, agreement, settings),
        "epoch": "middle of each manoeuvre",  # of an offset that moves
        "method": combined.attrs.get("method", "gravcal"),
        "adopted": chosen,
        "variants": blocks,
        "manoeuvres": manoeuvres(combined, detected, smoothed, field, settings),
        "delays_s": {
            name: plain.estimate(smoothed[f"{name}_delay"].values, smoothed[f"{name}_delay_sigma"].values)
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
    """{variant: block of the document} with combined offset, errors and covariances of every angular acceleration."""
    blocks = {}
    for index, name in enumerate(combined.attrs["variants"].split()):
        offset, determined = combined["offset"].values[index], combined["determined"].values[index]
        block = plain.offset_block(offset, combined["covariance"].values[index], determined)
        total = plain.offset_block(offset, combined["covariance_total"].values[index], determined)
        blocks[name] = block | {"sigma_total_um": total["sigma_um"], "covariance_total_um2": total["covariance_um2"]}
    return blocks


def manoeuvres(combined, detected, smoothed, field, settings):
    """Entries of the document for the manoeuvres, in order of time: place, edge shifts, scales, offset per variant."""
    joint, wave, attitude = ({n: v.values for n, v in one.variables.items()} for one in (combined, detected, smoothed))
    orbit = field["time_orbit"].values
    names = combined.attrs["variants"].split()
    torque_limit = SCALE_SHARE * float(settings["torque_scale_sigma"])

    def picked(name, index, limit=np.inf):
        sigma = attitude[f"{name}_sigma"][index]  # above the limit it only repeats its prior
        return plain.estimate(attitude[name][index], np.where(sigma < limit, sigma, np.nan))

    def single(variant, index):
        """Offset block of one manoeuvre in one variant, by index, with the chi-square test of its fit."""
        keys = ("offset", "covariance", "determined", "chi2", "dof")
        offset, covariance, determined, chi2, dof = (joint[f"manoeuvre_{key}"][variant, index] for key in keys)
        return plain.offset_block(offset, covariance, determined) | {"fit": plain.chi_square_test(chi2, dof)}

    entries = []
    for i in range(detected.sizes["manoeuvre"]):
        middle = (wave["start"][i] + wave["stop"][i]) / 2
        edges = {"left": np.nan, "right": np.nan}  # geocentric, where the orbit is known
        latitude = np.interp(middle, orbit, field["latitude"].values, **edges) if orbit.size else np.nan
        entries.append(
            {
                "kind": KINDS[int(joint["kind"][i])],
                "start": float(joint["start"][i]),
                "stop": float(joint["stop"][i]),
                "rod": "xyz"[int(wave["rod"][i])],
                "regular": bool(wave["regular"][i]),
                "latitude_deg": number(np.degrees(latitude)),
                "latitude_class": None if np.isnan(latitude) else "high" if abs(latitude) > HIGH_LATITUDE else "low",
                "gaps": [name for name, bit in GAPS.items() if int(attitude["gap"][i]) & bit],
                "acc_shift_s": picked("acc_shift", i),
                "sca_shift_s": picked("sca_shift", i),
                "torque_scale": picked("torque_scale", i, torque_limit),
                "angular_scale": picked("angular_scale", i, ANGULAR_LIMIT),
                "attitude_rms_urad": numbers(1e6 * attitude["residual_rms"][i]),
                "variants": {name: single(variant, i) for variant, name in enumerate(names)},
            }
        )
    return entries


def scales(smoothed, settings):
    """{"torque", "angular": {"value", "sigma"}} of the scales, weighted mean per axis; null where undetermined."""
    limits = {"angular": ANGULAR_LIMIT, "torque": SCALE_SHARE * float(settings["torque_scale_sigma"])}
    means = {}
    for name, limit in limits.items():
        values, sigmas = smoothed[f"{name}_scale"].values, smoothed[f"{name}_scale_sigma"].values
        usable = np.isfinite(values) & (sigmas > 0) & (sigmas < limit)
        weight = np.where(usable, 1 / np.where(usable, sigmas, 1.0) ** 2, 0.0)
        total = np.where(usable.any(axis=0), weight.sum(axis=0), np.nan)
        means[name] = plain.estimate(np.sum(weight * np.where(usable, values, 0.0), axis=0) / total, 1 / np.sqrt(total))
    return means


def roll_response(survey, settings):
    """Regression slope of the roll rate on the impulse of current x field, with the expected one; None if unknown."""
    slope = None if survey is None else plain.estimate(survey["slope"].values, survey["slope_sigma"].values)
    if slope is None or slope["value"] is None:
        return None
    used = np.isfinite(survey["roll_impulse"].values) & np.isfinite(survey["roll_rate"].values)
    expected_pair = [settings.get(name) for name in ("roll_response", "roll_response_sigma")]
    expected = None if None in expected_pair else plain.estimate(*expected_pair)
    return slope | {"unit": survey["slope"].attrs["units"], "samples": int(used.sum()), "expected": expected}


def consistency(combined, name, level):
    """Chi-square tests with verdicts: of manoeuvres (adopted and each variant), of variants, of the catalogue."""

    def judged(chi2, dof):
        """Chi-square test with a verdict at the level: consistent, not consistent or not tested."""
        test = plain.chi_square_test(chi2, dof)
        agree = None if test["p"] is None else test["p"] >= level
        words = {True: "consistent", False: "not consistent", None: "not tested"}
        return test | {"consistent": agree, "verdict": words[agree]}

    names = combined.attrs["variants"].split()
    tests = {one: judged(combined["chi2"].values[i], combined["dof"].values[i]) for i, one in enumerate(names)}
    adopted_test = tests.get(name, judged(np.nan, 0))
    others = {n: judged(combined[f"{n}_chi2"].values, combined[f"{n}_dof"].values) for n in ("variants", "catalogue")}
    return {"level": level, "manoeuvres": adopted_test | {"variant": name, "by_variant": tests}} | others


def result_checks(combined, consistency, settings):
    """Checks of fit of every manoeuvre, agreement and plausible size; without variants that determine no component."""
    fit = [combined[f"manoeuvre_{name}"].values.astype(float) for name in ("chi2", "dof")]
    ratio = np.divide(*fit, out=np.full_like(fit[0], np.nan), where=fit[1] > 0)
    delivered = np.isfinite(combined["offset"].values).any(axis=1)
    checks = [
        at_most(f"chi2 per degree of freedom, {name}", largest(ratio[i]), settings["fit_limit"], "1")
        for i, name in enumerate(combined.attrs["variants"].split())
        if delivered[i]
    ]
    words = {"manoeuvres": "manoeuvres", "variants": "angular accelerations", "catalogue": "torquers and catalogue"}
    for name, compared in words.items():
        p = consistency[name]["p"]
        checks.append(at_least(f"agreement of {compared}, p", np.nan if p is None else p, consistency["level"], "1"))
    size = 1e6 * largest(np.abs(combined["offset"].values))
    checks.append(at_most("size of the offset", size, settings["plausible_um"], "um"))
    return [one for one in checks if not np.isnan(one.value)]


def verdict(variants, chosen, consistency, settings):
    """Verdict of the document: offset within requirement, accuracy met, consistent (None: not tested), a sentence."""
    limit, accuracy = float(settings["requirement_um"]), float(settings["accuracy_um"])
    if chosen["variant"] is None:
        text = "Manoeuvres were found, but they determine no component of the offset."
        return {"requirement_um": limit, "accuracy_um": accuracy, "text": text}
    values, totals = (variants[chosen["variant"]][name] for name in ("offset_um", "sigma_total_um"))
    within = [_within(value, sigma, limit) for value, sigma in zip(values, totals, strict=True)]
    accurate = [sigma is not None and sigma <= accuracy for sigma in totals]
    agree = {name: consistency[name]["consistent"] for name in ("manoeuvres", "variants", "catalogue")}
    compared = [agree["manoeuvres"], agree["variants"], agree["catalogue"] is not False]
    answers = {
        "requirement_um": limit,
        "requirement": within,
        "accuracy_um": accuracy,
        "accuracy_met": all(accurate),
        "consistent": None if None in compared and False not in compared else False not in compared,
    }
    rows, names = zip(AXES, values, totals, within, accurate, strict=True), ("axis", "value", "total", "within", "met")
    axes = [dict(zip(names, row, strict=True)) for row in rows]
    return answers | {"text": WORDS.note("verdict", axes=axes, agree=agree, adopted=chosen["variant"], **answers)}


def _within(value, sigma, limit):
    """Whether abs(value) is "within" a limit, "exceeds" it, or is "undecided" by its error; "undetermined" if None."""
    if value is None:
        return "undetermined"
    if abs(value) + CONFIDENCE * sigma <= limit:
        return "within"
    return "exceeds" if abs(value) - CONFIDENCE * sigma > limit else "undecided"


def vcm_line(document, satellite):
    """Sequence-of-events line: offset adopted from the last manoeuvre on, comment unless measured; None if partial."""
    if document["status"] not in documents.WITH_RESULT or document["adopted"]["variant"] is None:
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


def printed_manoeuvres(document, published):
    """{(manoeuvre index, variant): printed record}: the k-th of a kind and latitude class in the paper is our k-th."""
    records = published.get("manoeuvres", ())
    orders = {}
    for one in records:
        places = orders.setdefault((one.labels["kind"], one.labels["latitude_class"]), [])
        if one.labels["order"] not in places:
            places.append(one.labels["order"])
    printed = {}
    for index, ours in enumerate(document["manoeuvres"]):
        places = orders.get((ours["kind"], ours["latitude_class"]), [])
        order = places.pop(0) if places else None
        printed |= {(index, one.labels["variant"]): one for one in records if one.labels["order"] == order}
    return printed


def _combined_table(document, published):
    """Table of the combined offset of every variant, beside printed values, with the chi-square of the manoeuvres."""
    printed = {one.labels["variant"]: one for one in published.get("combined", ())}
    tests = document["consistency"]["manoeuvres"]["by_variant"]
    rows = [
        [name, *_offsets(block, block["sigma_total_um"], printed, name), chi_square(tests[name])]
        for name, block in document["variants"].items()
    ]
    adopted = document["adopted"]["variant"]
    heads = ["angular acceleration", *_axis_heads(printed, "{} printed"), "χ²/dof, p of manoeuvres"]
    adopted_row = list(document["variants"]).index(adopted) if adopted else None
    return WORDS.table("combined", rows, heads=heads, strong=adopted_row, wide=bool(printed))


def _manoeuvre_table(document, printed):
    """Table of the offset of every manoeuvre and variant, beside printed values, with the chi-square of the fit."""
    rows = []
    for index, one in enumerate(document["manoeuvres"]):
        latitude = "" if one["latitude_deg"] is None else f", {signed(one['latitude_deg'], 0)}°"
        missing = f", not used: gap in {' and '.join(one['gaps'])}" if one["gaps"] else ""
        label = f"{index + 1} {one['kind']}{latitude}, {gps_text(one['start'])[11:]}{missing}"
        for name, block in one["variants"].items():
            rows.append([label, name, *_offsets(block, [None] * 3, printed, (index, name)), chi_square(block["fit"])])
            label = None
    heads = ["manoeuvre", "angular acc.", *_axis_heads(printed, "printed"), "χ²/dof, p of fit"]
    return WORDS.table("manoeuvres", rows, heads=heads)


def _axis_heads(printed, printed_head):
    """Column heads of the three components, each followed by that of its printed value if there are any."""
    return [head for axis in AXES for head in (f"{axis} (µm)", *([printed_head.format(axis)] if printed else []))]


def _offsets(block, total, printed, key):
    """Table cells of the three components in um, each followed by its printed value if there are any."""
    cells = []
    for i in range(3):
        cells.append(plus_minus(block["offset_um"][i], block["sigma_um"][i], total[i]))
        cells += [plain.printed(printed.get(key), i)] if printed else []
    return cells


@WORDS.figure("field", "align")
def _field(panels, checked, aligned):
    """Plot measured field and IGRF of each axis at the left, their difference at the right."""
    usable = (checked["used"].values != 0)[:, None]
    time, ends = joined(checked["time_mag"].values, aligned["window_start"].values, aligned["window_stop"].values)
    time, ends = time / 60, ends / 60
    measured, model = (1e6 * np.where(usable, checked[name].values, np.nan) for name in ("measured_b", "model_b"))
    difference = 1e9 * np.where(usable, checked["difference_b"].values, np.nan)
    every = slice(None, None, max(1, time.size // 500))
    points = {"color": COLOURS["orange"], "markersize": 2.2, "label": "magnetometer", "rasterized": True}
    for row, (axis, (left, right)) in enumerate(zip(AXES, panels, strict=True)):
        left.plot(time[every], measured[every, row], ".", **points)
        left.plot(*thinned(time, model[:, row]), color=COLOURS["black"], linewidth=0.7, label="IGRF")
        right.plot(*thinned(time, difference[:, row]), color=COLOURS["blue"], linewidth=0.7)
        right.axhline(1e9 * checked["bias"].values[row], color=COLOURS["vermilion"], linestyle="--", label="bias")
        left.set_ylabel(f"B$_{axis}$ (µT)")
        right.set_ylabel(f"ΔB$_{axis}$ (nT)")
        number_windows(left, ends)
        number_windows(right, ends)


@WORDS.figure("align", "attitude", "detect")
def _torquers(aligned, smoothed, detected):
    """Figure of torquer currents and of the angular acceleration that they make, a row for each manoeuvre."""
    titles = "torquer current (mA)", "angular acceleration by the torquers (µrad s$^{-2}$)"
    figure, (left, right) = _rows(detected, titles, 0.55)
    margin = 12.0
    for row, (start, length) in enumerate(_spans(detected)):
        since = aligned["time_mag"].values - start
        near = (since > -margin) & (since < length + margin)
        _stacked(left, row, since[near], aligned["current_b"].values[near].T, AXIS, steps=True)
        inside = smoothed["acc_manoeuvre"].values == row
        magnetic = 1e6 * smoothed["magnetic_b"].values[inside].T
        _stacked(right, row, smoothed["time_acc"].values[inside] - start, magnetic, AXIS)
    return figure


@WORDS.figure("solve.mtq", "detect")
def _linear_accelerations(solved, detected):
    """Figure of reading, model and, shifted down, residual of the linear acceleration, a row for each manoeuvre."""
    figure, panels = _rows(detected, [f"f$_{axis}$ (nm s$^{{-2}}$)" for axis in AXES], 0.72)
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    for axis, panel in enumerate(panels):
        for row, (start, _) in enumerate(_spans(detected)):
            inside = index == row
            if not inside.any():
                continue
            reading, model = (1e9 * solved[name].values[inside, axis] for name in ("reading", "model"))
            size = max(np.abs(reading).max(), np.abs(model).max(), 1e-3)
            curves = (reading, model, reading - model - 1.3 * size)
            _stacked(panel, row, time[inside] - start, curves, STYLES["linear"], size=size)
    return figure


def _rows(detected, titles, height_in):
    """Figure and its panels side by side, one row in each for every manoeuvre, labelled at the left."""
    count = detected.sizes["manoeuvre"]
    names = [f"{i + 1} {KINDS[int(kind)]}" for i, kind in enumerate(detected["kind"].values)]
    look = {"xlabel": FROM_EDGE, "titles": titles, "margins": {"wspace": 0.22, "right": 0.95}}
    figure, (panels,) = grid(1, len(titles), 0.75 + height_in * count, sharey=True, **look)
    panels[0].set_yticks(-np.arange(count), names)
    panels[0].set_ylim(-count + 0.45, 0.55)
    for panel in panels:
        panel.tick_params(axis="y", length=0)
    return figure, panels


def _spans(detected):
    """Pairs (start, length) s of the manoeuvres."""
    return list(zip(detected["start"].values, detected["stop"].values - detected["start"].values, strict=True))


def _stacked(panel, row, since, curves, styles, steps=False, size=None):
    """Plot curves (c, n) of one manoeuvre over `since` (n,) s, scaled to its row; their amplitude is at the right."""
    curves = np.asarray(curves)
    if not np.isfinite(curves).any():
        return
    low, high = np.nanmin(curves), np.nanmax(curves)
    drawn = 0.9 * (curves - (low + high) / 2) / (high - low or 1.0)
    for (name, style), values in zip(styles.items(), drawn, strict=True):
        x, y = (since, values) if steps else thinned(since, values, 500)
        style_of = {"linewidth": 0.8} | style | ({"drawstyle": "steps-post"} if steps else {})
        panel.plot(x, y - row, label=name if row == 0 else None, **style_of)
    size = max(-low, high) if size is None else size
    place = {"xycoords": ("axes fraction", "data"), "ha": "left", "va": "center", "annotation_clip": False}
    panel.annotate(f"±{size:.3g}", (1.005, -row), fontsize=6, color="#767676", **place)


@WORDS.figure("attitude")
def _attitude(panels, smoothed):
    """Plot the star-camera residuals (urad) of all manoeuvres, one after the other, a panel for each axis."""
    index, time = smoothed["sca_manoeuvre"].values, smoothed["time_sca"].values
    if time.size == 0:
        return
    first, last = np.array([time[index == i][[0, -1]] for i in np.unique(index)]).T
    along, ends = joined(time, first, last + 1)
    for panel, residual in zip(panels, 1e6 * smoothed["sca_residual_b"].values.T, strict=True):
        panel.axhline(0, color=COLOURS["grey"], linewidth=0.5)
        panel.plot(along, residual, ".", color=COLOURS["blue"], markersize=1.4, rasterized=True)
        number_windows(panel, ends)


@WORDS.figure("angular_acceleration.*", "detect")
def _angular_accelerations(angular, detected):
    """Figure of all variants in the first manoeuvre of each kind, and of half-period means of variant minus mtq."""
    kinds = detected["kind"].values.astype(int)
    chosen = [int(np.flatnonzero(kinds == kind)[0]) for kind in range(3) if (kinds == kind).any()]
    if not chosen or "mtq" not in angular:
        return None
    look = {"xlabel": FROM_EDGE, "sharex": "col", "margins": {"wspace": 0.16, "hspace": 0.28}}
    figure, panels = grid(len(chosen), 2, 0.9 + 1.1 * len(chosen), **look)
    for (left, right), manoeuvre in zip(panels, chosen, strict=True):
        axis = kinds[manoeuvre]
        edges = (detected["edge_lower"].values[manoeuvre] + detected["edge_upper"].values[manoeuvre]) / 2
        edges, start = edges[np.isfinite(edges)] - edges[0], edges[0]
        inside = angular["mtq"]["acc_manoeuvre"].values == manoeuvre
        since = angular["mtq"]["time_acc"].values[inside] - start
        bounds = np.searchsorted(since, np.stack([edges[:-1] + 0.8, edges[1:] - 0.8])).T  # without the edges
        shown = (since >= 2) & (since <= 2 + 3 * PERIOD_S)
        series = {}
        for name in [name for name in VARIANTS if name in angular]:
            values = 1e6 * angular[name]["rate_dot_b"].values[inside, axis]
            series[name] = values - (np.nanmean(values) if np.isfinite(values).any() else 0.0)
            style = VARIANTS[name] | {"marker": "", "linewidth": STYLES["widths"][name], "label": name}
            left.plot(since[shown], series[name][shown], **style)
            if name != "mtq":
                difference = series[name] - series["mtq"]
                means = [np.mean(difference[a:b]) if b > a else np.nan for a, b in bounds]
                style = VARIANTS[name] | {"linewidth": 0.6, "markersize": 2.4}
                right.plot((edges[1:] + edges[:-1]) / 2, means, **style)
        left.set_ylabel(f"ω̇$_{AXES[axis]}$ (µrad s$^{{-2}}$)")
        left.set_title(f"manoeuvre {manoeuvre + 1}, {KINDS[axis]}")
    panels[0, 1].set_title("minus mtq, mean of each half period")
    return figure


@WORDS.figure("solve.mtq")
def _spectra(panels, solved):
    """Plot amplitude densities of modelled signal, residual and noise of the linear acceleration along each axis."""
    reading, model = solved["reading"].values, solved["model"].values
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    pieces = [np.flatnonzero(index == one) for one in np.unique(index)]
    pieces = [piece for piece in pieces if piece.size > 64 and np.ptp(np.diff(time[piece])) < 1e-6]
    if not pieces:
        return
    length = min(piece.size for piece in pieces)
    frequency, residual = density([(reading - model)[piece[:length]] for piece in pieces], STEP_S)
    _, signal = density([model[piece[:length]] for piece in pieces], STEP_S)
    noise = np.sqrt(solved["noise_density"].values)
    low = np.nanmin([np.nanmin(noise), np.nanpercentile(residual, 5)])
    for axis, panel in enumerate(panels):
        panel.loglog(frequency, signal[:, axis], color=COLOURS["sky"], label="modelled signal")
        panel.loglog(frequency, residual[:, axis], color=COLOURS["vermilion"], linewidth=0.8, label="residual")
        style = {"color": COLOURS["black"], "linewidth": 1.3, "label": "noise as measured"}
        panel.loglog(solved["frequency"].values, noise[axis], **style)
    panels[0].set(xlim=(frequency[1], 1.0), ylim=(low / 5, 3 * np.nanmax(signal)))


@WORDS.figure("combine")
def _estimates(panels, document, printed):
    """Plot the offset of every manoeuvre and variant with errors (hollow: printed), the adopted one as a band."""
    manoeuvres, names = document["manoeuvres"], list(document["variants"])
    adopted = document["variants"].get(document["adopted"]["variant"])
    for row, panel in enumerate(panels):
        if adopted is not None and adopted["offset_um"][row] is not None:
            value, sigma, total = (adopted[name][row] for name in ("offset_um", "sigma_um", "sigma_total_um"))
            panel.axhspan(value - total, value + total, color=COLOURS["yellow"], alpha=0.3, lw=0, label="total error")
            panel.axhspan(value - sigma, value + sigma, color=COLOURS["orange"], alpha=0.45, lw=0, label="adopted")
            panel.axhline(value, color=COLOURS["orange"], linewidth=0.6)
        for name, shift in zip(names, np.linspace(-SPREAD, SPREAD, len(names)), strict=True):
            blocks = [one["variants"][name] for one in manoeuvres]
            value, sigma = (np.array([b[key][row] for b in blocks], dtype=float) for key in ("offset_um", "sigma_um"))
            style = VARIANTS[name] | {"linestyle": "none", "markersize": 3.2}
            place = np.arange(len(manoeuvres)) + shift
            bars(panel, place, value, sigma, label=name, **style)
            printed_values = [printed.get((i, name)) for i in range(len(manoeuvres))]
            printed_values = np.array([None if one is None else one.value[row] for one in printed_values], dtype=float)
            if np.isfinite(printed_values).any():
                panel.plot(place, printed_values, **style | {"markersize": 5.2, "markerfacecolor": "none"})
    labels = [f"{i} {one['kind']}\n{one['latitude_class'] or ''}" for i, one in enumerate(manoeuvres, start=1)]
    panel.set_xticks(np.arange(len(manoeuvres)), labels)
    panel.set_xlim(-0.6, len(manoeuvres) - 0.4)


@WORDS.figure("survey")
def _roll(panel, survey):
    """Plot the roll rate of the star camera and slope times impulse of the torquers, quadratic drift removed."""
    time, slope = survey["time_sca"].values, float(survey["slope"].values)
    if time.size == 0 or not np.isfinite(slope):
        return
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), 2)
    rate, impulse = (project_out(drift, survey[name].values) for name in ("roll_rate", "roll_impulse"))
    style = {"color": COLOURS["orange"], "marker": "o", "markersize": 2.2, "linewidth": 0.6, "label": "star camera"}
    panel.plot(time - time[0], 1e6 * rate, **style)
    panel.plot(time - time[0], 1e6 * slope * impulse, color=COLOURS["black"], label="torquers")
