"""Report of a centre-of-mass event: its product, its files, and the page, section by section.

The figures follow those of 10.3390/rs14164030: from field and torquers to the estimates.
"""

from types import SimpleNamespace

import numpy as np

from gravcal.calibrations import checks as checking
from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import document as documented
from gravcal.report import documents
from gravcal.report.figures import AXIS, COLOURS, grid, legend, number_windows, thinned
from gravcal.report.pages import Figure, Section, Table, page
from gravcal.report.plain import AXES, NOT_DETERMINED, chi_square, gps_text, plus_minus, printed, probability, signed

SCHEMAS = schemas.of("com_offset.toml")

#: The four angular accelerations, told apart by colour, by line and by point.
VARIANTS = {
    "mtq": {"color": COLOURS["black"], "marker": "o"},
    "acc_calibrated": {"color": COLOURS["vermilion"], "marker": "s"},
    "acc": {"color": COLOURS["sky"], "marker": "^", "linestyle": "--"},
    "sca": {"color": COLOURS["purple"], "marker": "D", "linestyle": "-."},
}
WIDTHS = {"mtq": 2.4, "acc_calibrated": 1.1, "acc": 0.9, "sca": 1.0}  # wide below, thin above: all four are seen
LINEAR = {
    "measured": {"color": COLOURS["sky"], "linewidth": 1.4},
    "model": {"color": COLOURS["black"], "linewidth": 0.6},
    "difference, shifted": {"color": COLOURS["vermilion"], "linewidth": 0.6},
}
FROM_EDGE = "time from the first edge (s)"
PERIOD_S = 12.0
SPREAD = 0.24  # of the angular accelerations about the place of their manoeuvre
STEP_S = 0.5  # of the grid of a solution
#: Products of the stage `report` in their order, around four "solve" and four "angular_acceleration".
SINGLE = ("combine", "attitude", "field", "survey", "detect", "align", "checks")


def report(*products, event, satellite, settings, published):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset, combine; solve and angular_acceleration, four each; attitude, field, survey, detect, align,
        checks
    event : str
    satellite : letter
    settings : mapping of all parameters
    published : {section: list of plain records} of the catalogue, {} where nothing was printed

    Returns
    -------
    dataset : Dataset, "com_offset.report"
    files : {name: text}
    """
    named = dict(zip(SINGLE, (products[0], *products[9:]), strict=True))
    named |= {f"solve.{one.attrs['variant']}": one for one in products[1:5]}
    named |= {f"angular_acceleration.{one.attrs['variant']}": one for one in products[5:9]}
    provenance = documents.traced("com_offset", named)
    document = documented.document(named, event=event, provenance=provenance, settings=settings)
    checks = checking.of_product(named["checks"])
    if "consistency" in document:
        checks += documented.result_checks(named["combine"], document["consistency"], settings)
    document, files = documents.delivered(document, products, checks)
    line = documented.vcm_line(document, satellite)
    files |= {"result.vcm": line + "\n"} if line else {}
    records = {section: [SimpleNamespace(**one) for one in own] for section, own in published.items()}
    files["report.html"] = html(document, named, records, line)
    name = document.get("adopted", {}).get("variant")
    block = document["variants"][name] if name else {}
    values = {
        key: [np.nan if value is None else 1e-6 * value for value in block.get(f"{key}_um", [None] * 3)]
        for key in ("offset", "sigma", "sigma_total")
    }
    return build(SCHEMAS["report"], values, status=document["status"], adopted=name or "none", event=event), files


def html(document, products, published, vcm=None):
    """Page of one event, one self-contained HTML text."""
    delivered = "variants" in document
    sections = event_sections(document, published) if delivered else survey_sections(document)
    verdict = document["verdict"]
    start, stop = (document["record"][name] for name in ("start", "stop"))
    subtitle = "" if None in (start, stop) else f"Record {gps_text(start)} to {gps_text(stop)} GPS. "
    if delivered:
        kinds = [one["kind"] for one in document["manoeuvres"]]
        counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("pitch", "roll", "yaw") if kind in kinds)
        subtitle += f"{len(kinds)} manoeuvres ({counted}). Vectors from proof mass to centre of mass, in SRF. "
        subtitle += f"Noise from {document['noise']['source']}."
    return page(
        document,
        sections,
        products,
        heading="Centre-of-mass offset",
        subtitle=subtitle,
        good=verdict["accuracy_met"] and verdict["consistent"] is not False if "requirement" in verdict else None,
        badges=badges(document) if delivered else (),
        lines=("Result as a VCM line", vcm) if vcm else None,
    )


def event_sections(document, published):
    """Sections of an event with manoeuvres."""
    adopted = document["adopted"]["variant"] or "mtq"
    known = printed_manoeuvres(document, published)
    return [
        Section(
            "Result",
            tables=[combined_table(document, published)],
            figures=[
                Figure(
                    draw_estimates,
                    reads=("combine",),
                    arguments=(document, known),
                    caption="Offset of every manoeuvre from four angular accelerations, error bars one standard "
                    f"deviation. Bands: adopted offset ({adopted}) with its error and its total error."
                    + " Hollow: printed values."
                    * bool(known),
                )
            ],
            notes=result_notes(document, published),
        ),
        Section("Agreement and field check", tables=[agreement_table(document), field_table(document)], beside=True),
        Section("Every manoeuvre", tables=[manoeuvre_table(document, known)]),
        Section(
            "Linear acceleration",
            figures=[
                Figure(
                    draw_spectra,
                    reads=(f"solve.{adopted}",),
                    caption="Residuals of all manoeuvres against the noise that weighted them; the modelled signal "
                    "for scale.",
                ),
                Figure(
                    draw_linear_accelerations,
                    reads=(f"solve.{adopted}", "detect"),
                    caption="Linear acceleration of every manoeuvre, low-passed and drift removed: measured, modelled "
                    f"with {adopted}, and their difference shifted down. Each row has its own scale; its largest "
                    "value stands at the right.",
                ),
            ],
        ),
        Section(
            "Angular acceleration and time",
            tables=[instrument_table(document)],
            figures=[
                Figure(
                    draw_angular_accelerations,
                    reads=("angular_acceleration.*", "detect"),
                    caption="Four angular accelerations about the axis turned: three periods, and their distance from "
                    "the torquers' in every half period.",
                )
            ],
        ),
        Section(
            "Torquers and attitude",
            figures=[
                Figure(
                    draw_torquers,
                    reads=("align", "attitude", "detect"),
                    caption="Torquer currents as sent down, and the angular acceleration they make in the modelled "
                    "field. Each row has its own scale; its largest value stands at the right.",
                ),
                ATTITUDE,
            ],
        ),
        Section("Magnetic field", figures=[FIELD]),
    ]


def survey_sections(document):
    """Sections of a record without manoeuvre: what could be measured all the same."""
    residual, response = document["attitude"], document["roll_response"]
    rms = ", ".join(NOT_DETERMINED if item is None else f"{item:.2f}" for item in residual["rms_urad"])
    attitude = f"Star camera minus fitted dynamics, rms x, y, z: {rms} µrad, {residual['samples']} samples."
    roll = "Too little torque or time to measure it."
    if response is not None:
        measured = plus_minus(response["value"], response["sigma"], digits=4)
        roll = f"Roll acceleration for current times field: {measured} rad s⁻² mA⁻¹ T⁻¹"
        if response["expected"]:
            roll += f", expected {plus_minus(**response['expected'], digits=4)}"
        roll += f", {response['samples']} samples."
    drawn = Figure(
        draw_roll,
        reads=("survey",),
        caption="Roll acceleration by the star camera, and torquer current times field times the slope of the fit.",
    )
    return [
        Section("Magnetic field", tables=[field_table(document)], figures=[FIELD]),
        Section("Attitude", figures=[ATTITUDE], notes=[attitude]),
        Section("Torque against roll acceleration", figures=[drawn], notes=[roll]),
    ]


def badges(document):
    """The four answers in words: what was delivered, requirement, accuracy, consistency."""
    verdict, adopted = document["verdict"], document["adopted"]["variant"] or "no variant"
    found = [{"title": document["status"], "good": document["status"] == "delivered", "text": f"adopted: {adopted}"}]
    if "requirement" not in verdict:
        return found
    within = verdict["requirement"]
    sigma = document["variants"][adopted]["sigma_total_um"]
    errors = ", ".join(NOT_DETERMINED if s is None else f"{s:.1f}" for s in sigma)
    tests = document["consistency"]
    return [
        *found,
        {
            "title": f"offset ≤ {verdict['requirement_um']:g} µm",
            "good": False if "exceeds" in within else True if set(within) == {"within"} else None,
            "text": ", ".join(f"{axis} {word}" for axis, word in zip(AXES, within, strict=True)),
        },
        {
            "title": f"accuracy ≤ {verdict['accuracy_um']:g} µm",
            "good": verdict["accuracy_met"],
            "text": f"total error x, y, z: {errors} µm",
        },
        {
            "title": "consistent",
            "good": verdict["consistent"],
            "text": f"manoeuvres {tests['manoeuvres']['verdict']}, angular acc. {tests['variants']['verdict']}",
        },
    ]


def result_notes(document, published):
    """What the numbers of the result mean."""
    notes = [
        "The error is that of the noise as measured, delays and scales estimated along; the total error in brackets "
        "also holds that of inertia and dipole per current. Adopted: " + document["adopted"]["rule"]
    ]
    if any(document["outliers"].values()):
        counted = " and ".join(f"{count} of {name}" for name, count in document["outliers"].items() if count)
        notes.append(f"Isolated outliers were left out: {counted}.")
    if document["settings"].get("model"):
        notes.append(
            "Effects of an extended model were taken out of the records; both errors hold those of the model. "
            f"An offset that moves is that at the {document['epoch']}."
        )
    if document.get("method", "gravcal") == "published":
        notes.append("Method published: row selection and formal errors of the paper, for comparison only.")
    sources = sorted({one.source for name in ("combined", "manoeuvres") for one in published.get(name, ())})
    if sources:
        notes.append(f"Printed: {'; '.join(sources)}. Printed errors are formal and several times too small.")
    return notes


# Tables


def printed_manoeuvres(document, published):
    """Printed values of each manoeuvre: the k-th of a kind and latitude in the paper is our k-th of them."""
    records = published.get("manoeuvres", ())
    orders = {}
    for one in records:
        places = orders.setdefault((one.labels["kind"], one.labels["latitude_class"]), [])
        if one.labels["order"] not in places:
            places.append(one.labels["order"])
    found = {}
    for index, ours in enumerate(document["manoeuvres"]):
        places = orders.get((ours["kind"], ours["latitude_class"]), [])
        order = places.pop(0) if places else None
        found |= {(index, one.labels["variant"]): one for one in records if one.labels["order"] == order}
    return found


def combined_table(document, published):
    """Combined offset of every angular acceleration, ours beside the printed one; like Table 6 of the paper."""
    known = {one.labels["variant"]: one for one in published.get("combined", ())}
    tests = document["consistency"]["manoeuvres"]["by_variant"]
    rows = [
        [name, *_offsets(block, block["sigma_total_um"], known, name), chi_square(tests[name])]
        for name, block in document["variants"].items()
    ]
    adopted = document["adopted"]["variant"]
    return Table(
        "Offset from proof mass to CoM, in SRF: value ± error (total error).",
        ["angular acceleration", *_axis_heads(known, "{} printed"), "χ²/dof, p of manoeuvres"],
        rows,
        reads=("combine",),
        strong=list(document["variants"]).index(adopted) if adopted else None,
        wide=bool(known),
    )


def manoeuvre_table(document, known):
    """Offset of every manoeuvre and angular acceleration, printed values by `printed_manoeuvres`; like Table 7."""
    rows = []
    for index, one in enumerate(document["manoeuvres"]):
        where = "" if one["latitude_deg"] is None else f", {signed(one['latitude_deg'], 0)}°"
        missing = f", not used: gap in {' and '.join(one['gaps'])}" if one["gaps"] else ""
        label = f"{index + 1} {one['kind']}{where}, {gps_text(one['start'])[11:]}{missing}"
        for name, block in one["variants"].items():
            rows.append([label, name, *_offsets(block, [None] * 3, known, (index, name)), chi_square(block["fit"])])
            label = None
    return Table(
        f"Offset from each manoeuvre; {NOT_DETERMINED} is not determined by it.",
        ["manoeuvre", "angular acc.", *_axis_heads(known, "printed"), "χ²/dof, p of fit"],
        rows,
        reads=("combine",),
        wide=True,
        words=(0, 1),
    )


def _axis_heads(known, printed_head):
    """Heads of the three components, each followed by that of the printed one if there is any."""
    return [head for axis in AXES for head in (f"{axis} (µm)", *([printed_head.format(axis)] if known else []))]


def _offsets(block, total, known, key):
    """Cells of the three components, each followed by the printed one if there is any."""
    cells = []
    for i in range(3):
        cells.append(plus_minus(block["offset_um"][i], block["sigma_um"][i], total[i]))
        cells += [printed(known.get(key), i)] if known else []
    return cells


def instrument_table(document):
    """Delays, scales and attitude residual of every manoeuvre, and of all."""

    def row(label, delays, torque, angular, rms):
        late = [plus_minus(one["value"], one["sigma"], digits=3) for one in delays]
        left = ", ".join(NOT_DETERMINED if item is None else f"{item:.1f}" for item in rms)
        return [label, *late, *_scales(torque, 3), *_scales(angular, 4), left]

    rows = [
        row(
            f"{index} {one['kind']}",
            (one["acc_shift_s"], one["sca_shift_s"]),
            one["torque_scale"],
            one["angular_scale"],
            one["attitude_rms_urad"],
        )
        for index, one in enumerate(document["manoeuvres"], start=1)
    ]
    delays, scales = (document["delays_s"][name] for name in ("acc", "sca")), document["scales"]
    rows.append(row("all; tags late", delays, scales["torque"], scales["angular"], document["attitude"]["rms_urad"]))
    heads = ["manoeuvre", "edges late, acc (s)", "edges late, sca (s)"]
    heads += ["torque scale x", "y", "z", "angular scale x", "y", "z", "attitude rms x, y, z (µrad)"]
    caption = (
        "Edges of the wave against the torquer telemetry's bracket; magnetic torque over the catalogue; angular "
        "accelerometer over torquers; star camera minus dynamics."
    )
    return Table(caption, heads, rows, reads=("attitude",), wide=True, strong=len(rows) - 1)


def _scales(block, digits):
    """Three scales with their errors."""
    return [plus_minus(v, s, digits=digits) for v, s in zip(block["value"], block["sigma"], strict=True)]


def agreement_table(document):
    """Tests of manoeuvres and of angular accelerations with their verdicts."""
    tests = document["consistency"]
    named = {f"manoeuvres, {name}": one for name, one in tests["manoeuvres"]["by_variant"].items()}
    named |= {"acc and sca": tests["variants"], "mtq and acc, within catalogue error": tests["catalogue"]}
    return Table(
        "Do the estimates agree within their errors?",
        ["what should agree", "χ² / dof", "p", f"verdict at {tests['level']:g}"],
        [[name, chi_square(one, False), probability(one["p"]), one["verdict"]] for name, one in named.items()],
        reads=("combine",),
        words=(0, 3),
    )


def field_table(document):
    """Magnetometer against the model."""
    check = document["field_check"]
    names = {"bias": "bias_nt", "rms": "rms_nt", "largest": "max_nt"}
    return Table(
        f"Magnetometer minus {check['model']} in SRF, {check['samples']} samples.",
        ["nT", *AXES],
        [[word, *(NOT_DETERMINED if v is None else signed(v, 0) for v in check[name])] for word, name in names.items()],
        reads=("field",),
    )


# Figures


def draw_field(checked, aligned):
    """Measured field and model in the body, and their difference, the windows joined end to end."""
    used = (checked["used"].values != 0)[:, None]
    time, ends = _joined(checked["time_mag"].values, aligned["window_start"].values, aligned["window_stop"].values)
    measured, model = (1e6 * np.where(used, checked[name].values, np.nan) for name in ("measured_b", "model_b"))
    difference = 1e9 * np.where(used, checked["difference_b"].values, np.nan)
    figure, panels = grid(3, 2, 3.4, sharex=True, margins={"wspace": 0.2, "hspace": 0.14})
    panels[0, 0].set_title("field in SRF")
    panels[0, 1].set_title("magnetometer minus IGRF")
    thin = slice(None, None, max(1, time.size // 500))
    for row, axis in enumerate(AXES):
        left, right = panels[row]
        left.plot(
            time[thin],
            measured[thin, row],
            ".",
            color=COLOURS["orange"],
            markersize=2.2,
            label="magnetometer",
            rasterized=True,
        )
        left.plot(*thinned(time, model[:, row]), color=COLOURS["black"], linewidth=0.7, label="IGRF")
        right.plot(*thinned(time, difference[:, row]), color=COLOURS["blue"], linewidth=0.7)
        bias = 1e9 * float(checked["bias"].values[row])
        right.axhline(bias, color=COLOURS["vermilion"], linestyle="--", label="bias")
        number_windows(left, ends)
        number_windows(right, ends)
        left.set_ylabel(f"B$_{axis}$ (µT)")
        right.set_ylabel(f"ΔB$_{axis}$ (nT)")
    for panel in panels[-1]:
        panel.set_xlabel("minutes of record, windows joined end to end")
    legend(figure, panels[0], 3)
    return figure


def draw_torquers(aligned, smoothed, detected):
    """Torquer currents and the angular acceleration they make, one row for each manoeuvre."""
    figure, (left, right) = _rows(detected, 2, 0.55)
    left.set_title("torquer current (mA)")
    right.set_title("angular acceleration by the torquers (µrad s$^{-2}$)")
    margin = 12.0
    for row, (start, length) in enumerate(_spans(detected)):
        since = aligned["time_mag"].values - start
        near = (since > -margin) & (since < length + margin)
        _stacked(left, row, since[near], aligned["current_b"].values[near].T, AXIS, steps=True)
        inside = smoothed["acc_manoeuvre"].values == row
        made = 1e6 * smoothed["magnetic_b"].values[inside].T
        _stacked(right, row, smoothed["time_acc"].values[inside] - start, made, AXIS)
    legend(figure, left, 3)
    return figure


def draw_linear_accelerations(solved, detected):
    """Measured and modelled linear acceleration with their difference, one row for each manoeuvre."""
    figure, panels = _rows(detected, 3, 0.72)
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    for axis, panel in enumerate(panels):
        panel.set_title(f"f$_{AXES[axis]}$ (nm s$^{{-2}}$)")
        for row, (start, _) in enumerate(_spans(detected)):
            own = index == row
            if not own.any():
                continue
            reading, model = (1e9 * solved[name].values[own, axis] for name in ("reading", "model"))
            size = max(np.abs(reading).max(), np.abs(model).max(), 1e-3)
            curves = (reading, model, reading - model - 1.3 * size)
            _stacked(panel, row, time[own] - start, curves, LINEAR, size=size)
    legend(figure, panels[0], 3)
    return figure


def _rows(detected, columns, height_in):
    """Figure with panels side by side, in each one row for every manoeuvre, named at the left."""
    count = detected.sizes["manoeuvre"]
    names = [f"{i + 1} {documented.KINDS[int(kind)]}" for i, kind in enumerate(detected["kind"].values)]
    figure, panels = grid(1, columns, 0.75 + height_in * count, sharey=True, margins={"wspace": 0.14, "right": 0.95})
    panels[0, 0].set_yticks(-np.arange(count), names)
    panels[0, 0].set_ylim(-count + 0.45, 0.55)
    for panel in panels[0]:
        panel.set_xlabel(FROM_EDGE)
        panel.tick_params(axis="y", length=0)
    return figure, panels[0]


def _spans(detected):
    """Start and length of every manoeuvre."""
    return list(zip(detected["start"].values, detected["stop"].values - detected["start"].values, strict=True))


def _stacked(panel, row, since, curves, styles, steps=False, size=None):
    """Curves of one manoeuvre in its row, scaled to fill it; their largest size stands at the right."""
    size = np.nanmax(np.abs(np.stack(curves)), initial=0.0) if size is None else size
    known = np.concatenate([one[np.isfinite(one)] for one in curves] or [[0.0]])
    if not known.size:
        return
    low, high = float(known.min()), float(known.max())
    scale = 0.9 / (high - low or 1.0)
    for (name, style), values in zip(styles.items(), curves, strict=True):
        x, y = (since, values) if steps else thinned(since, values, 500)
        shown = {"linewidth": 0.8} | style | ({"drawstyle": "steps-post"} if steps else {})
        panel.plot(x, -row + scale * (y - (low + high) / 2), label=name if row == 0 else None, **shown)
    place = {"xycoords": ("axes fraction", "data"), "ha": "left", "va": "center", "annotation_clip": False}
    panel.annotate(f"±{size:.3g}", (1.005, -row), fontsize=6, color="#767676", **place)


def draw_attitude(smoothed):
    """Star camera minus fitted dynamics, the manoeuvres joined end to end."""
    index, time = smoothed["sca_manoeuvre"].values, smoothed["time_sca"].values
    if time.size == 0:
        return None
    spans = [time[index == i][[0, -1]] for i in np.unique(index)]
    ends = np.concatenate([[0.0], np.cumsum([stop - start + 1 for start, stop in spans])])
    joined = np.concatenate([time[index == i] - spans[n][0] + ends[n] for n, i in enumerate(np.unique(index))])
    residual = 1e6 * smoothed["sca_residual_b"].values
    figure, panels = grid(3, 1, 2.6, sharex=True, sharey=True, margins={"hspace": 0.12})
    panels[0, 0].set_title("star camera minus dynamics")
    for row, (panel,) in enumerate(panels):
        panel.axhline(0, color=COLOURS["grey"], linewidth=0.5)
        panel.plot(joined, residual[:, row], ".", color=COLOURS["blue"], markersize=1.4, rasterized=True)
        number_windows(panel, ends)
        panel.set_ylabel(f"{AXES[row]} (µrad)")
    panels[-1, 0].set_xlabel("seconds of fitted record, joined end to end")
    return figure


def draw_angular_accelerations(angular, detected):
    """The four angular accelerations over three periods, and their distance from the torquers in every half period."""
    kinds = detected["kind"].values.astype(int)
    chosen = [int(np.flatnonzero(kinds == kind)[0]) for kind in range(3) if (kinds == kind).any()]
    if not chosen or "mtq" not in angular:
        return None
    figure, panels = grid(
        len(chosen), 2, 0.9 + 1.1 * len(chosen), sharex="col", margins={"wspace": 0.16, "hspace": 0.28}
    )
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
            style = VARIANTS[name] | {"marker": "", "linewidth": WIDTHS[name], "label": name}
            left.plot(since[shown], series[name][shown], **style)
            if name != "mtq":
                difference = series[name] - series["mtq"]
                means = [np.mean(difference[a:b]) if b > a else np.nan for a, b in bounds]
                style = VARIANTS[name] | {"linewidth": 0.6, "markersize": 2.4}
                right.plot((edges[1:] + edges[:-1]) / 2, means, **style)
        left.set_ylabel(f"ω̇$_{AXES[axis]}$ (µrad s$^{{-2}}$)")
        left.set_title(f"manoeuvre {manoeuvre + 1}, {documented.KINDS[axis]}")
    panels[0, 1].set_title("minus mtq, mean of each half period")
    for panel in panels[-1]:
        panel.set_xlabel(FROM_EDGE)
    legend(figure, panels[0, 0], 4)
    return figure


def _joined(time, start, stop):
    """Times of several windows laid end to end (min), and where they meet."""
    start, order = np.sort(start), np.argsort(start)
    stop = np.asarray(stop)[order]
    begin = np.concatenate([[0.0], np.cumsum(stop - start)])
    index = np.clip(np.searchsorted(start, time, side="right") - 1, 0, start.size - 1)
    return (time - start[index] + begin[index]) / 60, begin / 60


def draw_spectra(solved):
    """Density of the residuals beside the noise as measured, and of the modelled signal; manoeuvres without a gap."""
    reading, model = solved["reading"].values, solved["model"].values
    index, time = solved["grid_manoeuvre"].values, solved["time_grid"].values
    pieces = [np.flatnonzero(index == one) for one in np.unique(index)]
    pieces = [own for own in pieces if own.size > 64 and np.ptp(np.diff(time[own])) < 1e-6]
    if not pieces:
        return None
    length = min(own.size for own in pieces)
    taper = np.hanning(length)[:, None]

    def density(values):
        """One-sided amplitude density (m, 3), mean of the manoeuvres, tapered by a cosine bell."""
        power = [np.abs(np.fft.rfft(taper * values[own[:length]], axis=0)) ** 2 for own in pieces]
        return np.sqrt(2 * STEP_S * np.mean(power, axis=0) / np.sum(taper**2))[1:]

    frequency = np.fft.rfftfreq(length, STEP_S)[1:]
    residual, signal, stated = density(reading - model), density(model), np.sqrt(solved["noise_density"].values)
    low = np.nanmin([np.nanmin(stated), np.nanpercentile(residual, 5)])
    figure, panels = grid(1, 3, 2.6, sharex=True, sharey=True, margins={"wspace": 0.06, "right": 0.98})
    for axis, panel in enumerate(panels[0]):
        panel.loglog(frequency, signal[:, axis], color=COLOURS["sky"], label="modelled signal")
        panel.loglog(frequency, residual[:, axis], color=COLOURS["vermilion"], linewidth=0.8, label="residual")
        style = {"color": COLOURS["black"], "linewidth": 1.3, "label": "noise as measured"}
        panel.loglog(solved["frequency"].values, stated[axis], **style)
        panel.set(title=f"f$_{AXES[axis]}$", xlabel="frequency (Hz)", xlim=(frequency[1], 1.0))
    panels[0, 0].set_ylim(low / 5, 3 * np.nanmax(signal))
    panels[0, 0].set_ylabel("density (m s$^{-2}$ Hz$^{-1/2}$)")
    legend(figure, panels[0, 0], 3)
    return figure


def draw_estimates(document, printed):
    """Every manoeuvre's estimate with its error, the adopted offset as a band, printed values hollow."""
    manoeuvres = document["manoeuvres"]
    adopted = document["variants"].get(document["adopted"]["variant"])
    names = list(document["variants"])
    figure, panels = grid(3, 1, 4.6, sharex=True, margins={"hspace": 0.1})
    panels[0, 0].set_title("offset, proof mass to CoM")
    for row, (panel,) in enumerate(panels):
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
            panel.errorbar(place, value, sigma, label=name, elinewidth=0.9, capsize=1.5, **style)
            known = [printed.get((i, name)) for i in range(len(manoeuvres))]
            known = np.array([None if one is None else one.value[row] for one in known], dtype=float)
            if np.isfinite(known).any():
                panel.plot(place, known, **style | {"markersize": 5.2, "markerfacecolor": "none"})
        panel.set_ylabel(f"{AXES[row]} (µm)")
    labels = [f"{i} {one['kind']}\n{one['latitude_class'] or ''}" for i, one in enumerate(manoeuvres, start=1)]
    panel.set_xticks(np.arange(len(manoeuvres)), labels)
    panel.set_xlim(-0.6, len(manoeuvres) - 0.4)
    legend(figure, panels[0, 0], 2 + len(names))
    return figure


def draw_roll(survey):
    """Roll rate of a record without manoeuvre beside the torquers' share, both with a quadratic drift removed."""
    time = survey["time_sca"].values
    slope = float(survey["slope"].values)
    if time.size == 0 or not np.isfinite(slope):
        return None
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), 2)
    rate, impulse = (
        y - drift @ np.linalg.lstsq(drift, y, rcond=None)[0]
        for y in (survey["roll_rate"].values, survey["roll_impulse"].values)
    )
    figure, panels = grid(1, 1, 2.0)
    panel = panels[0, 0]
    style = {"color": COLOURS["orange"], "marker": "o", "markersize": 2.2, "linewidth": 0.6, "label": "star camera"}
    panel.plot(time - time[0], 1e6 * rate, **style)
    panel.plot(time - time[0], 1e6 * slope * impulse, color=COLOURS["black"], label="torquers")
    panel.set(xlabel="time (s)", ylabel="ω$_x$ (µrad s$^{-1}$)")
    legend(figure, panel, 2)
    return figure


ATTITUDE = Figure(
    draw_attitude, reads=("attitude",), caption="Star camera minus fitted dynamics, one fit between two dotted lines."
)
FIELD = Figure(
    draw_field,
    reads=("field", "align"),
    caption="Magnetic field as measured and modelled, and their difference; dashed: bias; numbers are windows.",
)
