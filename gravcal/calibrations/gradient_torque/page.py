"""Report of a day of S-GRS: its product, its result document, and the page, section by section.

The figures follow those of the S-GRS paper: spectra by zonal degree (4 to 7), errors of the methods (8, 9).
"""

import numpy as np

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.gradient_torque import checks
from gravcal.calibrations.gradient_torque.model import SCHEMAS, gravity_gradient_torque, printed_torque
from gravcal.calibrations.schemas import build
from gravcal.report import documents
from gravcal.report.figures import COLOURS, HANN, grid
from gravcal.report.pages import Section, Table, figure, page
from gravcal.report.plain import AXES, NOT_DETERMINED, gps_text, number, numbers
from gravcal.store import product

GROUPS = ((1, 5), (6, 11), (12, 17), (18, 23))  # S-GRS paper, figures 4 to 7
CYCLE = ("blue", "vermilion", "green", "purple", "orange", "sky")
NAMES = {
    "two_sensor": "two sensors, mounting term kept",
    "one_sensor_published": "one sensor, eqs. 13-16 as printed",
    "one_sensor": "one sensor, tensor and rates modelled",
}
#: Colour and label of the methods, what is drawn first below.
STYLES = {
    "one_sensor_published": ("grey", "one sensor, printed"),
    "two_sensor": ("blue", "two sensors"),
    "one_sensor": ("vermilion", "one sensor"),
}
#: Numbers of a method in the document, and the variable of the combination that holds each.
METHOD = {
    "rms_error": "error_rms",
    "rms_error_without_noise": "clean_error_rms",
    "rms_error_bare_reading": "bare_error_rms",
    "rms_correction_to_bare_reading": "correction_rms",
    "sigma_rms": "sigma_rms",
    "sigma_total_rms": "sigma_total_rms",
    "error_over_sigma": "error_over_sigma",
}
TORQUE_NOTES = (
    "Angular acceleration of the test mass relative to the satellite from one zonal term at a time. Degree 1 is empty: "
    "the origin is the centre of mass, C10 = 0 (erratum S-9). The satellite alone makes the signal where the test mass "
    "is a cube: its torque vanishes (erratum S-5); elongation lets it appear.",
)
#: mm, places over which the printed torque takes the difference of gravity: a choice that eq. 1 does not have.
PLACES_MM = {(1.0, 1.0, 1.0): "vermilion", (1.0, 2.0, -0.5): "blue"}
PRINTED_NOTES = (
    "The torque of the tensor, t = vex(J G - G J), is one; the printed one takes the difference of gravity over a "
    "place of the choice of the reader, is another for each, and hundreds of times and more too large (erratum S-1).",
)
BALANCE = ("value", "sigma", "prior_sigma")
PRESSURE_NOTES = (
    "The paper has the mean of the panels by area (eq. 11) and prints no panel; here are those of GRACE-FO, with the "
    "centre of mass assumed in the middle of their volume. The flow meets the front alone: a mean over all panels "
    "adds a torque about y of z times the drag. The torque balance is what the record says.",
)
KNOWLEDGE_NOTES = (
    "One epoch gives six numbers for five elements of the gradient tensor and three of the drag: two combinations stay "
    "unseen, and both contain the diagonal of the tensor, which enters no torque. The printed pair of equations has "
    "rank 5 for 6 unknowns; quaternion inversion fills the gap with a relation without physical ground (erratum S-6).",
    "Below, several epochs together, one piece of knowledge after the other, and the standard deviation of the drag in "
    "the middle. The torque balance hardly moves it: it tells the centre of pressure, not the drag.",
)


def report(*products, event, settings):
    """Report product of one event and its files {name: text}.

    Products are combine, torque, gradient, checks and the drags in the order of the combination.
    """
    drags = dict(zip(map(str, products[0]["method"].values), products[4:], strict=True))
    named = dict(zip(("combine", "torque", "gradient", "checks"), products[:4], strict=True))
    tests = [*of_product(named["checks"]), *checks.result(named["gradient"], drags, settings)]
    named |= {f"drag.{name}": one for name, one in drags.items()}
    found = _result(named, settings)
    document = documents.delivered("gradient_torque", found, named, tests, event=event, settings=settings)
    modelled = named["gradient"]
    time, sensors = modelled["time"].values, modelled.sizes["sensor"]
    ratios = modelled["attitude_chi2"].values / modelled["attitude_dof"].values
    subtitle = f"{gps_text(time[0])} to {gps_text(time[-1])} GPS, {time.size} epochs, {sensors} sensor"
    subtitle += f"{'s' * (sensors > 1)}. Attitude fit, chi-square over degrees of freedom: "
    subtitle += ", ".join(f"{ratio:.3f}" for ratio in ratios) + "."
    about = {"heading": "Drag and gravity-gradient torque", "subtitle": subtitle}
    files = {"result.json": documents.text(document)}
    files["report.html"] = page(document, _sections(document), named, **about)
    return build(SCHEMAS["report"], {"delivered": 1}, event=event), files


def _result(products, settings):
    """Result document but for its head and tail; products {stage or "stage.variant": Dataset}, all settings."""
    combined, torque, drag = products["combine"], products["torque"], products["drag.one_sensor"]
    methods = {}
    for i, name in enumerate(map(str, combined["method"].values)):
        own = products[f"drag.{name}"]
        methods[name] = {key: number(combined[variable][i]) for key, variable in METHOD.items()}
        methods[name]["budget"] = dict(
            zip(own.attrs["sources"].split(", "), numbers(own["budget"].values), strict=True)
        )
        methods[name]["series"] = product.digest(own)[:12]
    above = (torque["amplitude"].values > 3 * torque["sensitivity"].values[:, None]).any(axis=(1, 2))
    found = {
        "status": "delivered",
        "drag": methods,
        "identifiability": _identifiability(combined),
        "torque": {
            "degrees": torque["degree"].values.tolist(),
            "rms_rad_s2": numbers(torque["rms"].values),
            "test_mass_rms_rad_s2": numbers(torque["test_mass_rms"].values),
            "above_sensitivity": above.tolist(),
        },
        "verdict": {"text": _verdict(methods, float(settings["requirement_m_s2"]))},
    }
    found["panel_pressure_m"] = {"area_weighted": numbers(torque["area_centre"].values)}
    found["panel_pressure_m"]["facing_the_flow"] = numbers(torque["facing_centre"].values)
    if "pressure" in drag:
        found["centre_of_pressure_m"] = {
            "value": numbers(drag["pressure"].values),
            "sigma": numbers(np.sqrt(np.diag(drag["pressure_covariance"].values))),
            "prior_sigma": numbers(drag["pressure_prior_sigma"].values),
        }
        found["torque_share_of_drag_information"] = number(drag["torque_gain"])
    return found


def _identifiability(combined):
    """Rank, null space, and what each piece of knowledge adds."""
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


def _verdict(methods, requirement):
    """What the one-sensor method gains over the bare reading, in one paragraph; requirement m s-2 as printed."""
    one, printed = methods["one_sensor"], methods.get("one_sensor_published")
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
    totals = [block["sigma_total_rms"] for block in methods.values()]
    within = "reach" if None not in totals and max(totals) < requirement else "do not reach"
    return text + f"With the error of the places the methods {within} the printed {requirement:.0e} m/s2."


def _sections(document):
    """Sections of the page, in order."""
    torque = document["torque"]
    above = [str(n) for n, yes in zip(torque["degrees"], torque["above_sensitivity"], strict=True) if yes]
    above = f"Degrees with a line above three times the sensor's noise: {', '.join(above) or 'none'} "
    return [
        Section("Drag", [_methods_table(document), _budget_table(document)], [_errors, _series]),
        Section("Gravity-gradient torque", (), [_spectra, _degrees], (*TORQUE_NOTES, f"{above}(sensitivity assumed).")),
        Section("Equation 3 against equation 1", (), [_printed_torque], PRINTED_NOTES),
        Section("Centre of pressure", [_pressure_table(document)], (), PRESSURE_NOTES),
        Section("What one sensor can tell", _knowledge_tables(document), (), KNOWLEDGE_NOTES),
    ]


def _short(value, form=".2e"):
    return NOT_DETERMINED if value is None else format(value, form)


def _methods_table(document):
    keys = ("rms_error", "rms_error_without_noise", "rms_error_bare_reading", "sigma_rms", "sigma_total_rms")
    heads = ["method", "error", "without noise", "bare reading", "σ", "σ with places", "error/σ", "printed, order"]
    printed = f"{float(document['settings']['requirement_m_s2']):.0e}"
    rows = []
    for name, block in document["drag"].items():
        row = [NAMES[name], *(_short(block[key]) for key in keys), _short(block["error_over_sigma"], ".3f")]
        rows.append([*row, NOT_DETERMINED if name == "one_sensor" else printed])
    caption = "Drag, rms over time and axes, m/s² (errors need the truth of a simulation; printed: eqs. 10, 16)"
    return Table(caption, heads, rows, reads=("combine",))


def _budget_table(document):
    rows = [
        [NAMES[name], source, *map(_short, values)]
        for name, block in document["drag"].items()
        for source, values in block["budget"].items()
    ]
    heads = ["method", "cause", "x", "y", "z"]
    return Table("Standard deviation by cause, m/s²", heads, rows, reads=("drag.*",), words=(0, 1))


def _knowledge_tables(document):
    own = document["identifiability"]
    heads = ["known", "rank", "unknowns", "σ drag x", "σ drag y", "σ drag z"]
    rows = [[k["known"], k["rank"], k["unknowns"], *map(_short, k["drag_sigma"])] for k in own["knowledge"]]
    null = [[f"{v:+.2f}" for v in vector] for vector in own["null_space"]["vectors"]]
    caption = f"Combinations that one epoch does not see (rank {own['rank']} of {own['unknowns']}); "
    return [
        Table("Joint system of several epochs, m/s²", heads, rows, reads=("combine",)),
        Table(caption + own["null_space"]["units"], own["null_space"]["unknowns"], null, reads=("combine",)),
    ]


def _pressure_table(document):
    """What panels say of the centre of pressure, and what the torque balance of the record does."""
    heads = ["axis", "all panels by area", "panels facing the flow", "torque balance", "σ", "σ before"]
    panels, balance = (document.get(name, {}) for name in ("panel_pressure_m", "centre_of_pressure_m"))
    rows = []
    for k, axis in enumerate(AXES):
        sums = [f"{values[k]:+.4f}" for values in panels.values()]
        rows.append([axis, *sums, *(_short(balance[key][k] if balance else None, ".4f") for key in BALANCE)])
    reads = ("torque", "drag.one_sensor")
    return Table("From the centre of mass to the centre of pressure, m", heads, rows, reads=reads)


@figure(
    "torque",
    caption="Amplitude by zonal degree, all axes together, against the sensor; grouped as figures 4 to 7 of the paper. "
    f"{HANN} over the whole record.",
)
def _spectra(torque):
    look = {"titles": [f"zonal degrees {low} to {high}" for low, high in GROUPS], "sharex": True, "sharey": True}
    look |= {
        "xlabel": "frequency, mHz",
        "ylabels": ["amplitude, rad/s²"] * 2,
        "margins": {"hspace": 0.28, "wspace": 0.06},
    }
    figure, panels = grid(2, 2, 4.6, **look)
    frequency = 1e3 * torque["frequency"].values
    total = np.sqrt(np.sum(torque["amplitude"].values ** 2, axis=1))
    noise = np.sqrt(np.sum(torque["sensitivity"].values ** 2))
    for panel, (low, high) in zip(panels.ravel(), GROUPS, strict=True):
        own = [i for i, n in enumerate(torque["degree"].values) if low <= n <= high]
        for colour, i in zip(CYCLE, own, strict=False):
            label = str(int(torque["degree"][i])) + ("" if total[i].any() else " (empty)")
            panel.loglog(frequency, np.where(total[i] > 0, total[i], np.nan), color=COLOURS[colour], label=label)
        panel.axhline(noise, color=COLOURS["black"], linestyle="--", label="sensor")
        panel.legend(ncols=2, loc="upper right")
    panel.set_ylim(1e-18, 1e-5)
    return figure


@figure(
    "gradient",
    "torque",
    caption="Gravity-gradient torque on the satellite by equation 1 of the paper, and by its equations 2 and 3 "
    "with the difference of gravity over two places.",
)
def _printed_torque(modelled, torque):
    titles, margins = [f"about {axis}" for axis in AXES], {"wspace": 0.06}
    look = {"ylabels": ["torque, N m"], "xlabel": "hours", "sharey": True}
    figure, (panels,) = grid(1, 3, 2.8, titles=titles, margins=margins, **look)
    time, inertia = modelled["time"].values, torque["inertia"].values
    every = slice(None, None, max(1, time.size // 3000))
    tensor, hours = modelled["gradient_b"].values[every], (time[every] - time[0]) / 3600
    curves = [("black", "eq. 1", gravity_gradient_torque(inertia, tensor))]
    for place, colour in PLACES_MM.items():
        label = "eq. 3, ({:g}, {:g}, {:g}) mm".format(*place)
        curves.append((colour, label, printed_torque(inertia, tensor, 1e-3 * np.array(place))))
    for axis, panel in enumerate(panels):
        for colour, label, series in curves:
            panel.semilogy(hours, np.abs(series[:, axis]), color=COLOURS[colour], label=label)
    return figure


@figure("torque", caption="Rms by zonal degree and axis.")
def _degrees(torque):
    figure, ((panel,),) = grid(1, 1, 2.4, xlabel="zonal degree", ylabels=["rms, rad/s²"])
    degree = torque["degree"].values
    for axis, colour in enumerate(("blue", "vermilion", "green")):
        for name, style, of in (("rms", "o-", "about"), ("test_mass_rms", "x:", "test mass about")):
            rms = torque[name].values[:, axis]
            if name == "rms" or rms.any():
                shown = np.where(rms > 0, rms, np.nan)
                panel.semilogy(degree, shown, style, markersize=3, color=COLOURS[colour], label=f"{of} {AXES[axis]}")
    panel.axhline(torque["sensitivity"].values.mean(), color=COLOURS["black"], linestyle="--", label="sensor, one line")
    panel.set_xticks(degree[::2])
    return figure


@figure(
    "combine",
    caption="Densities of drag and of the errors of the methods, with and without sensor noise; figures 8 and 9 of the "
    "paper draw amplitudes of lines, which for noise depend on the length of the record. "
    f"{HANN} over the whole record.",
)
def _errors(combined):
    if not np.isfinite(combined["error_rms"].values).any():  # without the truth
        return None
    look = {
        "titles": ("with sensor noise", "without"),
        "ylabels": ["density, m s⁻² Hz⁻¹ᐟ²"],
        "xlabel": "frequency, mHz",
    }
    figure, (panels,) = grid(1, 2, 3.2, sharex=True, sharey=True, margins={"wspace": 0.06}, **look)
    frequency, names = combined["frequency"].values, [str(name) for name in combined["method"].values]
    index = np.digitize(frequency, np.geomspace(frequency[0], frequency[-1], 140))
    bins = [index == number for number in np.unique(index)]
    middle = [1e3 * frequency[inside].mean() for inside in bins]
    line_hz = 3 * frequency[0]  # a density over it is the squared amplitude of a line under a Hann window
    for panel, key in zip(panels, ("error", "clean_error"), strict=True):
        curves = [("black", "drag as estimated", combined["drag_amplitude"].values)]
        for name, (colour, label) in STYLES.items():
            if name in names:
                curves.append((colour, f"error, {label}", combined[f"{key}_amplitude"].values[names.index(name)]))
        for colour, label, amplitude in curves:
            power = np.sum(amplitude**2, axis=0)
            density = [np.sqrt(power[inside].mean() / line_hz) for inside in bins]
            panel.loglog(middle, np.maximum(density, 1e-30), color=COLOURS[colour], label=label)
    panels[0].set_ylim(1e-17, 1e-4)
    return figure


@figure("drag.*", caption="Drag of the one-sensor method, and how far the others are from it.")
def _series(drags):
    titles = [f"{what} {axis}, nm/s²" for what in ("drag", "difference") for axis in AXES]
    margins = {"hspace": 0.3, "wspace": 0.28}
    figure, panels = grid(2, 3, 3.4, sharex=True, xlabel="hours", titles=titles, margins=margins)
    one = drags["one_sensor"]
    every = slice(None, None, max(1, one.sizes["time"] // 3000))
    hours = (one["time"].values[every] - one["time"].values[0]) / 3600
    others = {name: style for name, style in STYLES.items() if name in drags and name != "one_sensor"}
    for axis, (above, below) in enumerate(panels.T):
        above.plot(hours, 1e9 * one["drag_b"].values[every, axis], color=COLOURS["vermilion"])
        for name, (colour, label) in others.items():
            difference = 1e9 * (drags[name]["drag_b"].values - one["drag_b"].values)[every, axis]
            below.plot(hours, difference, color=COLOURS[colour], label=f"{label} minus one")
    return figure
