"""Report of a day of S-GRS: its product, its result document, and the page, section by section."""

import numpy as np

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.gradient_torque import checks
from gravcal.calibrations.gradient_torque.model import SCHEMAS, gravity_gradient_torque, printed_torque
from gravcal.calibrations.schemas import build
from gravcal.report import pages
from gravcal.report.figures import COLOURS
from gravcal.report.pages import Section
from gravcal.report.plain import AXES, gps_text, number, numbers
from gravcal.store import product

WORDS = pages.words(__file__, "page.toml")
GROUPS = ((1, 5), (6, 11), (12, 17), (18, 23))  # S-GRS paper, figures 4 to 7
CYCLE = ("blue", "vermilion", "green", "purple", "orange", "sky")
STYLES = WORDS.styles["methods"]  # what is drawn first below
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
#: mm, places over which the printed torque takes the difference of gravity: a choice that eq. 1 does not have.
PLACES_MM = {(1.0, 1.0, 1.0): "vermilion", (1.0, 2.0, -0.5): "blue"}
BALANCE = ("value", "sigma", "prior_sigma")


def report(*products, event, settings):
    """Report product and files {name: text} of an event; products combine, torque, gradient, checks, then the drags."""
    drags = dict(zip(map(str, products[0]["method"].values), products[4:], strict=True))
    named = dict(zip(("combine", "torque", "gradient", "checks"), products[:4], strict=True))
    tests = [*of_product(named["checks"]), *checks.result(named["gradient"], drags, settings)]
    named |= {f"drag.{name}": one for name, one in drags.items()}
    modelled = named["gradient"]
    time, sensors = modelled["time"].values, modelled.sizes["sensor"]
    ratios = modelled["attitude_chi2"].values / modelled["attitude_dof"].values
    subtitle = f"{gps_text(time[0])} to {gps_text(time[-1])} GPS, {time.size} epochs, {sensors} sensor"
    subtitle += f"{'s' * (sensors > 1)}. Attitude fit, chi-square over degrees of freedom: "
    subtitle += ", ".join(f"{ratio:.3f}" for ratio in ratios) + "."
    about = {"event": event, "settings": settings, "heading": "Drag and gravity-gradient torque", "subtitle": subtitle}
    _, files = pages.report("gradient_torque", _result(named, settings), named, tests, _sections, **about)
    return build(SCHEMAS["report"], {"delivered": 1}, event=event), files


def _result(products, settings):
    """Result document but for its head and tail; products {stage or "stage.variant": Dataset}, all settings."""
    combined, torque, drag = products["combine"], products["torque"], products["drag.one_sensor"]
    methods = {}
    for i, name in enumerate(map(str, combined["method"].values)):
        own = products[f"drag.{name}"]
        methods[name] = {key: number(combined[variable][i]) for key, variable in METHOD.items()}
        sources = own.attrs["sources"].split(", ")
        methods[name]["budget"] = dict(zip(sources, numbers(own["budget"].values), strict=True))
        methods[name]["series"] = product.digest(own)[:12]
    above = (torque["amplitude"].values > 3 * torque["sensitivity"].values[:, None]).any(axis=(1, 2))
    document = {
        "status": "delivered",
        "drag": methods,
        "identifiability": _identifiability(combined),
        "torque": {
            "degrees": torque["degree"].values.tolist(),
            "rms_rad_s2": numbers(torque["rms"].values),
            "test_mass_rms_rad_s2": numbers(torque["test_mass_rms"].values),
            "above_sensitivity": above.tolist(),
        },
        "verdict": {"text": WORDS.note("verdict", methods=methods, requirement=float(settings["requirement_m_s2"]))},
    }
    document["panel_pressure_m"] = {"area_weighted": numbers(torque["area_centre"].values)}
    document["panel_pressure_m"]["facing_the_flow"] = numbers(torque["facing_centre"].values)
    if "pressure" in drag:
        document["centre_of_pressure_m"] = {
            "value": numbers(drag["pressure"].values),
            "sigma": numbers(np.sqrt(np.diag(drag["pressure_covariance"].values))),
            "prior_sigma": numbers(drag["pressure_prior_sigma"].values),
        }
        document["torque_share_of_drag_information"] = number(drag["torque_gain"])
    return document


def _identifiability(combined):
    """Rank, null space, and the drag error after each piece of knowledge, as JSON, from the combine product."""
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


def _sections(document):
    """Sections of the page, in order."""
    torque = document["torque"]
    above = [str(n) for n, yes in zip(torque["degrees"], torque["above_sensitivity"], strict=True) if yes]
    notes = [WORDS.note("torque"), WORDS.note("above", degrees=", ".join(above) or "none")]
    budget = [
        {"method": WORDS.notes["methods"][name], "cause": source, "sigma": values}
        for name, block in document["drag"].items()
        for source, values in block["budget"].items()
    ]
    balance = document.get("centre_of_pressure_m") or dict.fromkeys(BALANCE, (None,) * 3)
    centre = [{"k": k, "axis": axis, **document["panel_pressure_m"], **balance} for k, axis in enumerate(AXES)]
    own, know = document["identifiability"], [WORDS.note("rank"), WORDS.note("knowledge")]
    null = [[f"{v:+.2f}" for v in vector] for vector in own["null_space"]["vectors"]]
    null = WORDS.table("null", null, heads=own["null_space"]["unknowns"], **own)
    return [
        Section("Drag", [WORDS.table("methods", document), WORDS.table("budget", budget)], [_errors, _series]),
        Section("Gravity-gradient torque", (), [_spectra, _degrees], notes),
        Section("Equation 3 against equation 1", (), [_printed_torque], [WORDS.note("printed")]),
        Section("Centre of pressure", [WORDS.table("pressure", centre)], (), [WORDS.note("pressure")]),
        Section("What one sensor can tell", [WORDS.table("knowledge", document), null], (), know),
    ]


@WORDS.figure("torque")
def _spectra(panels, torque):
    """Amplitude spectra of the torque by zonal degree, in four groups, with the noise of the sensor."""
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
        panel.set_title(f"zonal degrees {low} to {high}")
    panel.set_ylim(1e-18, 1e-5)


@WORDS.figure("gradient", "torque")
def _printed_torque(panels, modelled, torque):
    """Torque of the satellite by eq. 1 and by the printed eq. 3 over two places."""
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


@WORDS.figure("torque")
def _degrees(panel, torque):
    degree = torque["degree"].values
    for axis, colour in enumerate(("blue", "vermilion", "green")):
        for name, style, of in (("rms", "o-", "about"), ("test_mass_rms", "x:", "test mass about")):
            rms = torque[name].values[:, axis]
            if name == "rms" or rms.any():
                shown = np.where(rms > 0, rms, np.nan)
                panel.semilogy(degree, shown, style, markersize=3, color=COLOURS[colour], label=f"{of} {AXES[axis]}")
    panel.axhline(torque["sensitivity"].values.mean(), color=COLOURS["black"], linestyle="--", label="sensor, one line")
    panel.set_xticks(degree[::2])


@WORDS.figure("combine")
def _errors(panels, combined):
    """Amplitude densities of the drag errors of each method, with and without noise, and of the drag."""
    if not np.isfinite(combined["error_rms"].values).any():  # without the truth
        return
    frequency, names = combined["frequency"].values, [str(name) for name in combined["method"].values]
    index = np.digitize(frequency, np.geomspace(frequency[0], frequency[-1], 140))
    bins = [index == number for number in np.unique(index)]
    middle = [1e3 * frequency[inside].mean() for inside in bins]
    line_hz = 3 * frequency[0]  # a density over it is the squared amplitude of a line under a Hann window
    for panel, key in zip(panels, ("error", "clean_error"), strict=True):
        curves = [(WORDS.styles["drag"], combined["drag_amplitude"].values)]
        for name, style in STYLES.items():
            if name in names:
                own = style | {"label": f"error, {style['label']}"}
                curves.append((own, combined[f"{key}_amplitude"].values[names.index(name)]))
        for style, amplitude in curves:
            power = np.sum(amplitude**2, axis=0)
            density = [np.sqrt(power[inside].mean() / line_hz) for inside in bins]
            panel.loglog(middle, np.maximum(density, 1e-30), **style)
    panels[0].set_ylim(1e-17, 1e-4)


@WORDS.figure("drag.*")
def _series(panels, drags):
    one = drags["one_sensor"]
    every = slice(None, None, max(1, one.sizes["time"] // 3000))
    hours = (one["time"].values[every] - one["time"].values[0]) / 3600
    others = {name: style for name, style in STYLES.items() if name in drags and name != "one_sensor"}
    for axis, (above, below) in enumerate(panels.T):
        above.plot(hours, 1e9 * one["drag_b"].values[every, axis], color=COLOURS["vermilion"])
        for name, style in others.items():
            difference = 1e9 * (drags[name]["drag_b"].values - one["drag_b"].values)[every, axis]
            below.plot(hours, difference, **style | {"label": f"{style['label']} minus one"})
