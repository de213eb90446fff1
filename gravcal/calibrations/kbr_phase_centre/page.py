"""Report of a ranging calibration: its product, its files, and the page, section by section.

Tables and figures follow Tables 4 to 8 and Figures 2 to 10 of 10.3390/rs14143395.
"""

import numpy as np

from gravcal.calibrations.building import build
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre import document as documented
from gravcal.calibrations.kbr_phase_centre.checks import of_result
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, SCHEMAS
from gravcal.report import documents
from gravcal.report.figures import COLOURS, grid, legend, thinned
from gravcal.report.pages import Figure, Section, Table, page
from gravcal.report.plain import NOT_DETERMINED, chi_square, gps_text, plus_minus, signed

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


def report(*products, event, settings, published, nominal_m):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, combine, pointing, noise, checks and three solve
    event : str
    settings : mapping of all parameters
    published : {section: list of plain records} of the catalogue
    nominal_m : (2, 3) m, phase centres of the catalogue

    Returns
    -------
    dataset : Dataset, "kbr_phase_centre.report"
    files : {name: text}
    """
    named = dict(zip(("combine", "pointing", "noise", "checks"), products[:4], strict=True))
    named |= {f"solve.{one.attrs['observable']}": one for one in products[4:]}
    provenance = documents.traced("kbr_phase_centre", named)
    document = documented.document(named, event=event, provenance=provenance, settings=settings)
    checks = of_product(named["checks"])
    if document["status"] in documents.WITH_RESULT:
        tests = {name: one["p"] for name, one in document["consistency"]["manoeuvres"].items()}
        checks += of_result(named["combine"], tests, nominal_m, settings)
    document, files = documents.delivered(document, products, checks)
    files |= documented.vector_files(document, gps_text(document["record"]["start"])[:10])
    span = " to ".join(gps_text(document["record"][name]) for name in ("start", "stop"))
    lines = files.get("result.soe")
    files["report.html"] = page(
        document,
        sections(document, published),
        named,
        heading="Antenna phase centres",
        subtitle=f"Record {span} GPS, satellites {' and '.join(document['pair'])}, {document['ranging']}, "
        f"{len(document['manoeuvres'])} wiggles. Vectors from centre of mass to phase centre, in SRF.",
        good=document["verdict"].get("accuracy_met"),
        lines=("Result for the sequence-of-events file", lines) if lines else None,
    )
    blocks = list(document.get("adopted", {}).get("satellites", {}).values()) or [{}, {}]
    values = {
        name: [[np.nan if v is None else 1e-3 * v for v in one.get(key, [None] * 3)] for one in blocks]
        for name, key in (("centre", "phase_centre_mm"), ("sigma", "sigma_mm"))
    }
    return build(SCHEMAS["report"], values, status=document["status"], event=event), files


def _notes(document):
    """What the numbers of the result mean."""
    moving = f"A phase centre that moves is that at {gps_text(document['epoch'])}, the middle of the wiggles."
    return [*document["trust"], *([moving] if document["settings"].get("model") else [])]


def sections(document, published):
    """Sections of the page of a judged document, beside the printed records of the catalogue."""
    if "satellites" not in document:
        caption = "Pointing of the line of sight in both satellites: left the record, right a part of it."
        return [Section("Pointing", figures=[Figure(draw_angles, ["pointing"], caption)])]
    return [
        Section(
            "Result",
            tables=[result_table(document, published, estimator) for estimator in ESTIMATORS],
            figures=[
                Figure(
                    draw_estimates,
                    reads=["combine"],
                    arguments=[document],
                    caption="y and z of both satellites: every observable by least squares and with robust weights, "
                    "then each wiggle alone; error bars one standard deviation, band the adopted value.",
                )
            ],
            notes=[*_notes(document), *(one["text"] for one in document["indistinguishable_from_calibration"])],
        ),
        Section("Sub-sets and geometry", [subset_table(document, published), geometry_table(document)]),
        Section(
            "Wiggles",
            tables=[manoeuvre_table(document)],
            figures=[
                Figure(
                    draw_angles,
                    reads=["pointing"],
                    caption="Pointing of the line of sight in both satellites: left the record, wiggles shaded; right "
                    "the first wiggle of each.",
                ),
                Figure(
                    draw_series,
                    reads=["solve.*"],
                    caption="Ranging minus orbit and the fitted phase centres in one pitch and one yaw wiggle, slow "
                    "part removed from both; below, shifted down, their difference, magnified as the title says.",
                ),
            ],
        ),
        Section(
            "Noise",
            tables=[noise_table(document)],
            figures=[
                Figure(
                    draw_spectra,
                    reads=["solve.*"],
                    caption="Density of ranging minus orbit in the wiggles, before and after the fit; dotted: 4 and "
                    "8 mHz, the wiggle and its second harmonic.",
                ),
                Figure(
                    draw_noise,
                    reads=["noise"],
                    caption="Noise of the range: quiet data, their model, and the residual in the wiggles, where the "
                    "star camera adds its error times the tilt of the antenna.",
                ),
            ],
        ),
        Section("Against published vectors", [vector_table(document, published)]),
    ]


# Tables


def _digits(value, digits=3):
    return NOT_DETERMINED if value is None else signed(value, digits)


def result_table(document, published, estimator):
    """All observables of one estimator beside the printed values."""
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
    return Table(
        f"Phase centres by {name}, millimetres. Printed: 10.3390/rs14143395, {source}, September 2020; its range "
        "columns were not detrended.",
        ["mm"] + [head for title in TITLES.values() for head in (title, "printed")],
        rows,
        reads=["combine"],
    )


def _place(labels):
    """Letter, axis and observable of a printed record."""
    return labels["satellite"][-1].upper(), labels["component"], labels["observable"]


def subset_table(document, published):
    """One-sided sets and sets with x held: shifts of y and z, predicted from the shift of x, and those printed."""
    joint = {_place(one["labels"]): one["value"][0] for one in published.get("ls", [])}
    known = {(one["labels"]["subset"], *_place(one["labels"])): one["value"][0] for one in published.get("subsets", [])}
    rows = []
    for name, axes in (("positive", "xyz"), ("mirror", "xyz"), ("positive_x_fixed", "yz"), ("mirror_x_fixed", "yz")):
        for letter, block in document["subsets"][name]["range_rate"].items():
            for axis in axes:
                k, place = "xyz".index(axis), (letter, axis, "range_rate")
                both = (name, *place) in known and place in joint
                rows.append(
                    [
                        f"{name.replace('_x_fixed', ', x held')}, GRACE-{letter} {axis}",
                        plus_minus(block["phase_centre_mm"][k], block["sigma_mm"][k]),
                        _digits(block["shift_mm"][k]),
                        _digits(block["predicted_shift_mm"][k]),
                        _digits(known[name, *place] - joint[place] if both else None),
                    ]
                )
    return Table(
        "One-sided sets, range rate, millimetres: shift against all wiggles, and tan(offset) times the shift of x; "
        "with x held, by what the catalogue's x misses. Printed: Table 5 minus Table 4, range rate.",
        ["set", "value", "shift", "predicted", "printed shift"],
        rows,
        reads=["combine"],
    )


def geometry_table(document):
    """Condition numbers and the ratio of errors."""
    own = document["geometry"]
    condition = own["condition"]
    rows = [
        [name.replace("_", " "), *(_digits(condition[o][name], 1) for o in OBSERVABLES)] for name in condition["range"]
    ]
    ratio, tangent = [_digits(value, 4) for value in own["one_sided_sigma_ratio"]["positive"]], own["tan_offset"]
    return Table(
        f"Condition number of the whitened, detrended columns. Error of y and z over that of x, positive only: "
        f"{', '.join(ratio)}; tan of the offset angle: {_digits(tangent, 4)}.",
        ["set", *TITLES.values()],
        rows,
        reads=["combine"],
    )


def manoeuvre_table(document):
    """Every wiggle with its own estimate."""
    rows = [
        [
            f"{one['satellite']} {one['kind']}",
            f"{one['start'] - document['record']['start']:.0f}",
            f"{one['stop'] - one['start']:.0f}",
            _digits(one["offset_deg"], 2),
            _digits(one["amplitude_deg"], 2),
            one["component"],
            *(plus_minus(own["value"], own["sigma"], digits=4) for own in one["estimates_mm"].values()),
        ]
        for one in document["manoeuvres"]
    ]
    scatter = document["consistency"]["scatter_between_manoeuvres_mm"]["range_rate"]
    spread = [f"{k} {axis} {_digits(v, 4)}" for k, own in scatter.items() for axis, v in zip("xyz", own, strict=True)]
    agree = [f"{TITLES[name]} {chi_square(test)}" for name, test in document["consistency"]["manoeuvres"].items()]
    return Table(
        "Sub-manoeuvres found in the pointing angles, and the component each tells alone, millimetres. "
        f"Disagreement, chi-square / degrees of freedom, probability: {'; '.join(agree)}. Error of the mean by the "
        f"scatter between wiggles, range rate: {', '.join(one for one in spread if ' x ' not in one)}.",
        ["wiggle", "start, s", "length, s", "offset, °", "amplitude, °", "", *TITLES.values()],
        rows,
        reads=["combine"],
    )


def noise_table(document):
    """Noise at the frequencies that matter."""
    own = document["noise"]
    quiet, inside = own["quiet_um_rthz"], own["manoeuvres_um_rthz"]
    rows = [[f"{name[0]} mHz", _digits(quiet[name], 2), _digits(inside[name], 2)] for name in quiet]
    return Table(
        f"Noise of the range, µm/√Hz, from {own['source']} data of {own['seconds']:.0f} s. Star cameras as seen by the "
        f"ranging in the wiggles: {_digits(own['star_camera_urad_rthz_4_mhz'], 2)} µrad/√Hz at 4 mHz.",
        ["frequency", "quiet", "in wiggles"],
        rows,
        reads=["noise"],
    )


def vector_table(document, published):
    """Adopted vectors beside those of the paper and of the sequence-of-events file."""
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


def draw_angles(pointed):
    """Pitch and yaw of both satellites over the record, and the first wiggle of each."""
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
    legend(figure, panels, 3)
    return figure


def draw_series(solved):
    """Ranging minus orbit and model in one pitch and one yaw wiggle, of {observable: solution}; lines open at gaps."""
    first = solved["range"]
    chosen = [np.flatnonzero(first["axis_index"].values == axis) for axis in (0, 1)]
    chosen = [own[0] for own in chosen if own.size]
    if not chosen or not first["time_kbr"].size:
        return None
    figure, panels = grid(3, len(chosen), 5.0, margins={"wspace": 0.14, "hspace": 0.36})
    for row, name in zip(panels, OBSERVABLES, strict=True):
        one, (unit, factor) = solved[name], UNITS[name]
        for panel, k in zip(row, chosen, strict=True):
            inside = one["arc"].values == k
            time = one["time_kbr"].values[inside]
            if not time.size:
                continue
            measured, model = (factor * one[key].values[inside] for key in ("detrended", "modelled"))
            gaps = np.flatnonzero(np.diff(time) > 20) + 1
            time, measured, model = (np.insert(v, gaps, np.nan) for v in (time - time[0], measured, model))
            left, span = measured - model, np.nanmax(model) - np.nanmin(model)
            scatter = max(np.nanmax(left) - np.nanmin(left), 1e-12)
            power = 10 ** max(int(np.floor(np.log10(0.6 * span / scatter))), 0)  # by which the difference is magnified
            for values, (label, style) in zip(
                (measured, model, power * left - 1.1 * span), SERIES.items(), strict=True
            ):
                panel.plot(*thinned(time, values), label=label, **style)
            letter = one.attrs["satellites"][int(one["satellite_index"].values[k])]
            axis = tuple(ANGLES)[int(one["axis_index"].values[k])]
            panel.set_title(f"{TITLES[name]}, {unit}: {letter} {axis}, difference × {power}")
    for panel in panels[-1]:
        panel.set_xlabel("s")
    legend(figure, panels, 3)
    return figure


def draw_spectra(solved):
    """Density before and after the fit, of {observable: Dataset, "kbr_phase_centre.solve"}."""
    if not solved["range"]["time_kbr"].size:
        return None
    figure, panels = grid(1, 3, 2.5, margins={"left": 0.065, "wspace": 0.24})
    for panel, name in zip(panels[0], OBSERVABLES, strict=True):
        one, (unit, factor) = solved[name], UNITS[name]
        panel.set_title(f"{TITLES[name]}, {unit}/√Hz")
        frequency = one["frequency"].values
        _density(panel, frequency, factor**2 * one["spectrum_observed"].values, "ranging minus orbit", WIDE)
        _density(panel, frequency, factor**2 * one["spectrum_residual"].values, "residual", RESIDUAL)
    legend(figure, panels, 2)
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


def draw_estimates(document):
    """Both transverse components, y and z, of both satellites from every observable, estimator and wiggle."""
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
                    style = POINTS[kind] | {"markersize": 4, "linestyle": "none", "elinewidth": 0.9, "capsize": 1.5}
                    panel.errorbar([place], [centre], [error], label=kind, **style)
            panel.set_xticks(range(len(labels)), labels)
            panel.set(title=f"GRACE-{letter} {'xyz'[k]}, mm", xlim=(-0.6, len(labels) - 0.4))
    legend(figure, panels, 4)
    return figure


def draw_noise(measured):
    """Density of the range noise."""
    figure, panels = grid(1, 1, 2.4)
    panels[0, 0].set_title("noise, µm/√Hz")
    curves = {
        "density": ("quiet data", WIDE),
        "model": ("model", DASHED),
        "in_manoeuvres": ("in the wiggles", RESIDUAL),
    }
    for name, (label, style) in curves.items():
        _density(panels[0, 0], measured["frequency"].values, 1e12 * measured[name].values, label, style)
    legend(figure, panels, 3)
    return figure
