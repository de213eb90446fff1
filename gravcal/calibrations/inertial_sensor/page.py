"""Report of an inertial-sensor event: its product, its result document, and the page, section by section.

Tables and figures stand beside Tables 3 to 6 of the paper (Remote Sens. 2023, 15, 3817).
"""

import numpy as np

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.inertial_sensor import checks
from gravcal.calibrations.inertial_sensor.estimate import filtered_readouts
from gravcal.effects.inertial_sensor import READOUT, VOLTAGES
from gravcal.report import documents
from gravcal.report.figures import AXIS, COLOURS, grid, legend
from gravcal.report.pages import Figure, Section, Table, page
from gravcal.report.plain import AXES, NOT_DETERMINED, as_plain, estimate, gps_text, number, numbers
from gravcal.store.schemas import VERSION

SCHEMAS = schemas.of("inertial_sensor.toml")

#: The two solutions of the offset, in the order of the product.
OFFSETS = ("com_to_test_mass_um", "com_to_test_mass_without_y_um")
ADOPTED = "smallest total error: least sum of the squares of sigma_total of the three axes"
CLAIMED = {"k": 0.01, "offset in y and z": 0.03, "bias": 1e-3}  # relative, abstract of the paper
REASONS = {
    "k_y": "no angular factor is tied to it, and this swing does not show it: a_x gives p_z, then a_y = -w_x' p_z",
    "beta_z": "tied to beta_y: same electrodes, arm and inertia",
    "bias_y": "rolling about y leaves its direction cosines constant: b_y and the constant acceleration of the "
    "satellite along y, solar pressure above all, are one sum (constant_y)",
}
OFFSET_NOTE = (
    "The scale calibration of the swing cancels in the offset: its systematic error is that of J/(M l), 3 to 4 % "
    "(errata T-6, T-11), and for z that of k_y of the ground. Printed errors hold neither."
)
WANDERS = (
    "Measured minus predicted attitude, means of bins. The prediction integrates the readouts twice, their noise too: "
    "it wanders by 0.1 to 1 mrad in minutes, and has that weight in the estimate."
)
CAUSES = {
    "beta": "β of the swing",
    "mass": "mass M",
    "inertia": "inertia J",
    "arm": "arm l",
    "beta_x": "β_x",
    "beta_y": "β_y",
    "ratio_x": "J_x/(M l)",
    "ratio_y": "J_y/(M l)",
    "k_y": "k_y of the ground",
    "statistical_sigma": "scatter of the segments",
    "offset_sigma": "error of the offset (Ω² p)",
    "factor_sigma": "error of the scale factor (swing, M, l, J), times b",
    "wander": "slow wander, not an error of the mean",
    "offset_effect": "bias if the offset term were dropped, minus the bias",
}
PRINTED = {"mass": 0.072, "x": 1.9440e-5, "y": 1.0328e-5, "arm_y": 10.45e-3}  # kg, kg m2, m; Sec. 2.2 and Table 1
SHOWN = 1 / 3  # largest relative error of a k_y that a swing shows: beyond, its inverse is far from normal
WIDE = {"left": 0.1, "right": 0.985, "hspace": 0.42, "wspace": 0.3}


def report(*products, event, names, settings, published):
    """Report product of one event and its files.

    Parameters
    ----------
    products : Dataset of "detect" and, as far as there was a swing or a roll, "align", "scale", "offset", "bias",
        "checks"
    event : str
    names : names of the products, in order
    settings : mapping of all parameters
    published : {section: [{"labels", "value", "sigma"}]} of the catalogue

    Returns
    -------
    dataset : Dataset, "inertial_sensor.report"; files : {name: text}
    """
    named = dict(zip(names, products, strict=True))
    tests = [*of_product(named["checks"]), *checks.result(named, settings)] if "checks" in named else []
    document, files = documents.delivered(_document(named, event=event, settings=settings), products, tests)
    spans = [f"{m['kind']} {gps_text(m['start'])} to {gps_text(m['stop'])}" for m in document["manoeuvres"]]
    subtitle = f"{'; '.join(spans) or 'No manoeuvre'} GPS. Vectors from the centre of mass to the test mass, "
    files["report.html"] = page(
        document, _sections(document, published), named, heading="Inertial sensor", subtitle=f"{subtitle}sensor frame."
    )
    swung, rolled = document.get("swing", {}), document.get("roll", {})
    unknown = {"value": [None] * 3}
    values = {name: [(swung.get(name, {}).get(axis) or {}).get("value") for axis in AXES] for name in ("k", "beta")}
    values["offset"] = [v if v is None else 1e-6 * v for v in swung.get("adopted", unknown)["value"]]
    values["bias"] = rolled.get("bias", unknown)["value"]
    values = {name: [np.nan if v is None else v for v in own] for name, own in values.items()}
    return build(SCHEMAS["report"], values, status=document["status"], event=event), files


def _document(products, *, event, settings):
    """Result document, ready for JSON; products {name: Dataset}, settings all parameters."""
    detected = products["detect"]
    manoeuvres = [
        {"kind": kind, "start": float(a), "stop": float(b)}
        for kind in ("swing", "roll")
        for a, b in zip(detected[f"{kind}_start"].values, detected[f"{kind}_stop"].values, strict=True)
    ]
    document = {
        "schema_version": VERSION,
        "status": "delivered" if "scale" in products or "bias" in products else "no_manoeuvre",
        "calibration": "inertial_sensor",
        "event": event,
        "method": settings["method"],
        "direction": "com_to_test_mass",
        "manoeuvres": manoeuvres,
    }
    reasons = dict(REASONS)
    if "scale" in products:
        document["swing"] = _swing(products["scale"], products["offset"])
        if document["swing"]["k"]["y"]:
            del reasons["k_y"]
    if "bias" in products:
        document["roll"] = _roll(products["bias"])
        if "not_determined" in products["bias"].attrs:
            reasons["bias"] = products["bias"].attrs["not_determined"]
    document |= {"not_determined": reasons, "verdict": {"text": verdict(document)}}
    return document | {"settings": as_plain(settings), "provenance": documents.traced("inertial_sensor", products)}


def _swing(scaled, moved):
    """Scale factors, offset and delay; k_y where the swing itself shows it."""
    own = estimate(moved.k_y, moved.k_y_sigma) | {"sigma_total": number(moved.k_y_sigma_total)}
    own = own if 0 < float(moved.k_y_sigma_total) < float(moved.k_y) * SHOWN else None
    arms = []
    for value, sigma, total in zip(scaled.k.values, scaled.k_sigma.values, scaled.k_sigma_total.values, strict=True):
        x, _, z = (estimate(v, s) | {"sigma_total": number(t)} for v, s, t in zip(value, sigma, total, strict=True))
        arms.append({"x": x, "y": own, "z": z})
    arm, adopted = int(scaled.chosen_arm), OFFSETS[int(moved.adopted)]
    offsets = {}
    for choice, name in enumerate(OFFSETS):
        held, total = (1e6 * np.sqrt(np.diag(moved[n].values[choice])) for n in ("covariance", "covariance_total"))
        offsets[name] = estimate(1e6 * moved.offset.values[choice], held) | {"sigma_total": numbers(total)}
    last = (scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1]
    beta = zip(AXES, scaled.beta.values, scaled.beta_sigma.values, strict=True)
    budget = zip(scaled.attrs["causes"].split(), scaled.k_budget.values, strict=True)
    shifts = zip(moved.attrs["causes"].split(), moved["shift"].values[0], strict=True)
    return {
        "k": arms[arm],
        "beta": {axis: estimate(value, sigma) for axis, value, sigma in beta},
        **offsets,
        "adopted": {"solution": adopted, "rule": ADOPTED, **offsets[adopted]},
        "delay_s": estimate(scaled.delay, scaled.delay_sigma),
        "arm_x_mm": 1e3 * float(scaled.arm_x[arm]),
        "arms": {f"{1e3 * float(a):.2f} mm": k for a, k in zip(scaled.arm_x.values, arms, strict=True)},
        "k_budget_relative": {cause: dict(zip(AXES, numbers(row), strict=True)) for cause, row in budget},
        "filter_minus_batch": {"sigmas": float(np.max(np.abs(last)))},
        "budget_um": {name: numbers(1e6 * one) for name, one in shifts},
        "noise": {
            "tracker_urad": numbers(1e6 * scaled.tracker_sigma.values),
            "angular_v_rthz": numbers(scaled.voltage_density.values),
            "linear_v_rthz": numbers(moved.noise_density.values),
        },
        "fit": {
            "scale": {"chi2": float(scaled.chi2), "dof": int(scaled.dof)},
            "offset": {"chi2": float(moved.chi2), "dof": int(moved.dof)},
        },
    }


def _roll(biased):
    """Bias and its parts; null where not separable."""
    separable = biased.separable.values.astype(bool)
    own = {
        name: numbers(np.where(separable, biased[name].values, np.nan))
        for name in ("bias", "bias_sigma", "bias_sigma_total", "bias_volt", "bias_volt_sigma")
    }
    return {
        "bias": {"value": own["bias"], "sigma": own["bias_sigma"], "sigma_total": own["bias_sigma_total"]},
        "bias_volt": {"value": own["bias_volt"], "sigma": own["bias_volt_sigma"]},
        "segments": int(np.count_nonzero(biased.used)),
        "segments_found": int(biased.used.size),
        "constant_y": {
            "value": number(biased.bias[1]),
            "sigma": number(biased.bias_sigma[1]),
            "sigma_total": number(biased.bias_sigma_total[1]),
            "volt": number(biased.bias_volt[1]),
            "meaning": "b_y minus the constant acceleration of the satellite along y",
        },
        "budget": {
            name: numbers(biased[name].values)
            for name in ("statistical_sigma", "offset_sigma", "factor_sigma", "wander", "offset_effect")
        },
        "z_noise": z_noise(biased.frequency.values, biased.density.values) if biased.sizes["frequency"] else None,
        "source": biased.attrs["factors_from"],
    }


def z_noise(frequency, density):
    """Noise of z, root of the mean power between 10 and 50 mHz, with old and new factor; what of it is the factor."""
    band, slow = (frequency >= 0.01) & (frequency <= 0.05), (frequency >= 1e-3) & (frequency < 3e-3)
    before, after, cleared = np.sqrt(np.mean(density[:, band] ** 2, axis=1))
    before_slow, _, cleared_slow = np.sqrt(np.mean(density[:, slow] ** 2, axis=1))
    return {
        "before_m_s2_rthz": float(before),
        "after_m_s2_rthz": float(cleared),
        "ratio": float(cleared / before),
        "ratio_of_factors": float(after / before),
        "millihertz": {"before_m_s2_rthz": float(before_slow), "after_m_s2_rthz": float(cleared_slow)},
    }


def verdict(document) -> str:
    """One line for the terminal: the result, and whether the total errors reach those that the paper claims."""
    if document["status"] != "delivered":
        return "No swing and no roll in the attitude: nothing to calibrate."
    parts, errors = [], {}
    if "swing" in document:
        offset, k = document["swing"]["adopted"], document["swing"]["k"]
        text = ", ".join(f"{v:.0f} +- {s:.0f}" for v, s in zip(offset["value"], offset["sigma_total"], strict=True))
        factors = (f"k_{axis} {k[axis]['value']:.3e} +- {k[axis]['sigma_total']:.0e}" for axis in "xz")
        solution = "all axes, k_y of the ground" if offset["solution"] == OFFSETS[0] else "without a_y"
        parts.append(f"{', '.join(factors)} m s-2 V-1; centre of mass to test mass {text} um ({solution})")
        errors["k"] = [(k[axis]["value"], k[axis]["sigma_total"]) for axis in "xz"]
        errors["offset in y and z"] = list(zip(offset["value"], offset["sigma_total"], strict=True))[1:]
    if "roll" in document:
        roll = document["roll"]
        known = zip(AXES, roll["bias"]["value"], roll["bias"]["sigma_total"], strict=True)
        known = [one for one in known if one[1] is not None]
        if known:
            text = ", ".join(f"b_{axis} {v:.5e} +- {s:.0e}" for axis, v, s in known)
            parts.append(f"{text} m s-2 from {roll['segments']} segments, b_y not separable")
        else:
            usable = f"{roll['segments']} of {roll['segments_found']} segments of the roll usable"
            parts.append(f"Bias not determined: {usable}")
        errors["bias"] = [(v, s) for _, v, s in known]
    worst = {
        name: max(abs(s / v) for v, s in pairs if v and s is not None)
        for name, pairs in errors.items()
        if any(v and s is not None for v, s in pairs)
    }
    claims = [
        f"{name} {100 * one:.2g} % ({'met' if one < CLAIMED[name] else 'not met'}, {100 * CLAIMED[name]:g} %)"
        for name, one in worst.items()
    ]
    parts += [f"Total error against the claim of the paper: {', '.join(claims)}"] if claims else []
    return ". ".join(parts) + "."


def _sections(document, published):
    """Sections of the page."""
    sections = [Section("Motion", figures=[Figure(draw_motion, ["detect"], "Body rates, means over a minute.")])]
    reasons = document["not_determined"]
    if "swing" in document:
        delay, agree = document["swing"]["delay_s"], document["swing"]["filter_minus_batch"]["sigmas"]
        late = (
            f"Star-tracker tags later than those of the sensor by {delay['value']:.4f} ± {delay['sigma']:.4f} s. "
            f"Kalman filter and batch differ by {agree:.1e} standard deviations at the end."
        )
        crn = "Readouts before and after the CRN filter of the published method."
        sections += [
            Section(
                "Scale factors",
                tables=[factors(document, published), arms(document), factor_budget(document), actuation(published)],
                figures=[
                    Figure(draw_swing, ["scale"], "Swing: angular readouts, angular acceleration, attitude."),
                    Figure(draw_convergence, ["scale"], "Kalman filter against batch least squares."),
                    Figure(draw_residuals, ["scale"], WANDERS),
                    Figure(draw_filtering, ["align"], crn),
                ],
                notes=[late, *(f"{name}: {why}." for name, why in reasons.items() if "bias" not in name)],
            ),
            Section(
                "Offset",
                tables=[offset(document, published), offset_budget(document)],
                figures=[
                    Figure(draw_offset, ["offset"], "Linear readings, slow part removed, and the term of the offset."),
                    Figure(
                        draw_offset_convergence, ["offset"], "Offset by the Kalman filter against batch least squares."
                    ),
                ],
                notes=[OFFSET_NOTE],
            ),
        ]
    if "bias" in reasons:
        sections.append(Section("Bias", notes=[f"Not determined: {reasons['bias']}"]))
    elif "roll" in document:
        roll = document["roll"]
        noise = roll["z_noise"]
        spectrum = (
            f"Between 10 and 50 mHz {noise['before_m_s2_rthz']:.1e} m s⁻² Hz⁻¹ᐟ² with the factor of the ground, "
            f"{noise['after_m_s2_rthz']:.1e} now: {noise['ratio']:.3f} of before. The change of k_z alone gives "
            f"{noise['ratio_of_factors']:.3f}; only the rest is less noise."
        )
        used = f"{roll['segments']} of {roll['segments_found']} segments used. "
        sections += [
            Section(
                "Bias",
                tables=[bias(document, published), bias_budget(document)],
                figures=[Figure(draw_segments, ["bias"], "Bias of every segment and uniformity of the roll rate.")],
                notes=[f"{used}Scale factors and offset: {roll['source']}.", f"b_y: {reasons['bias_y']}."],
            ),
            Section(
                "Noise of z",
                figures=[Figure(draw_z_noise, ["bias"], "Amplitude spectrum of z, median of the segments.")],
                notes=[spectrum],
            ),
        ]
    return sections


def actuation(published):
    """Table 3: coefficients in use beside the printed ones."""
    rows = []
    for record, used in zip(published.get("actuation", ()), READOUT, strict=False):
        same = np.array_equal(np.array(record["value"], dtype=float), used)
        rows.append([record["labels"]["scale_factor"], *(f"{c:g}" for c in used), "as printed" if same else "differs"])
    heads = ["factor", *(f"{name[0]}{name[2:]}" for name in VOLTAGES), ""]
    return Table("Combinations of the electrode voltages (Table 3).", heads, rows, ["scale"], words=(0, 7))


def factors(document, published):
    """Table 4: nominal, ground and orbit as printed, the printed beta taken to k without the 1/2, and ours."""
    known = {r["labels"]["factor"]: r["value"] for r in published.get("scale_factors", ())}
    rows = []
    for name in ("k_x", "k_y", "k_z", "beta_x", "beta_y", "beta_z"):
        kind, axis = name.split("_")
        again = []
        if name == "k_x" and "beta_y" in known:
            again = [known["beta_y"][2] * PRINTED["y"] / (PRINTED["mass"] * PRINTED["arm_y"])]
        if name == "k_z" and "beta_x" in known:
            again = [known["beta_x"][2] * PRINTED["x"] / (PRINTED["mass"] * arm) for arm in (8.00e-3, 10.45e-3)]
        printed = [NOT_DETERMINED if v is None else f"{v:.3e}" for v in known.get(name, [None] * 3)]
        own = _measured(document["swing"].get(kind, {}).get(axis))
        rows.append([name, *printed, " / ".join(f"{one:.3e}" for one in again) or NOT_DETERMINED, own])
    heads = ["factor", "nominal printed", "ground printed", "orbit printed", "printed β, no 1/2", "this event"]
    caption = (
        "Scale factors (Table 4), k in m s⁻² V⁻¹, β in rad s⁻² V⁻¹: value ± error (total error). Fifth column: the "
        "printed β of orbit taken to k by J/(M l), arm about x of 8.00 and 10.45 mm. k_y of this event is that of the "
        "swing alone (a_x gives p_z, then a_y = -w_x' p_z), beside the ground value that the offset is solved with."
    )
    return Table(caption, heads, rows, ["scale"], wide=True)


def _measured(own):
    """Value with its errors."""
    if not own or own["value"] is None:
        return "not determined"
    total = f" ({own['sigma_total']:.1e})" if own.get("sigma_total") is not None else ""
    return f"{own['value']:.4e} ± {own['sigma']:.1e}{total}"


def arms(document):
    """Linear factors for both arms about x."""
    swing = document["swing"]
    rows = []
    for name, one in swing["arms"].items():
        used = " (used)" if abs(float(name[:-3]) - swing["arm_x_mm"]) < 1e-6 else ""
        rows.append([f"{name}{used}", _measured(one["x"]), _measured(one["z"])])
    caption = "Linear factors by the arm of β_x (erratum T-5): value ± error (total error)."
    return Table(caption, ["arm", "k_x", "k_z"], rows, ["scale"])


def factor_budget(document):
    """Where the total error of the linear factors comes from."""
    swing = document["swing"]
    parts = swing["k_budget_relative"].items()
    rows = [[CAUSES[name], *(f"{100 * shares[axis]:.2f}" for axis in "xz")] for name, shares in parts]
    rows.append(["total", *(f"{100 * swing['k'][a]['sigma_total'] / swing['k'][a]['value']:.2f}" for a in "xz")])
    caption = "Error budget of the linear factors, % (k = β J/(M l), erratum T-6)."
    return Table(caption, ["cause", "k_x", "k_z"], rows, ["scale"], strong=len(rows) - 1)


def offset(document, published):
    """Table 5: offset beside the printed one."""
    known = {r["labels"]["component"]: r for r in published.get("com_offset", ())}
    rows = []
    for index, axis in enumerate(AXES):
        record, row = known.get(axis), [axis]
        row.append(f"{record['value'][0]:.2f} ± {record['sigma'][0]:.2f}" if record else NOT_DETERMINED)
        for name in OFFSETS:
            value, sigma, total = (document["swing"][name][key][index] for key in ("value", "sigma", "sigma_total"))
            row.append(f"{value:.1f} ± {sigma:.1f} ({total:.1f})")
        rows.append(row)
    caption = "Centre of mass to test mass (Table 5), µm: value ± error with scale factors held (total error)."
    return Table(caption, ["axis", "printed", "all axes, k_y of the ground", "without a_y"], rows, ["offset"])


def offset_budget(document):
    """Where the total error of the offset comes from."""
    swing = document["swing"]
    rows = [["noise", *(f"{s:.1f}" for s in swing[OFFSETS[0]]["sigma"])]]
    rows += [[CAUSES[name], *(f"{abs(v):.1f}" for v in shift)] for name, shift in swing["budget_um"].items()]
    rows.append(["total", *(f"{s:.1f}" for s in swing[OFFSETS[0]]["sigma_total"])])
    caption = "Error budget of the offset, µm for one standard deviation of each cause."
    return Table(caption, ["cause", *AXES], rows, ["offset"], strong=len(rows) - 1)


def bias(document, published):
    """Table 6: bias beside the printed one."""
    known = {r["labels"]["component"]: r for r in published.get("bias", ())}
    roll, rows = document["roll"], []
    for index, axis in enumerate(AXES):
        record = known.get(axis)
        printed = f"{record['value'][0]:.4e} ± {record['sigma'][0]:.1e}" if record else NOT_DETERMINED
        value, sigma, total = (roll["bias"][name][index] for name in ("value", "sigma", "sigma_total"))
        if value is None:
            y = roll["constant_y"]
            own = f"not separable; b − a = {y['value']:.6e} ± {y['sigma']:.1e} ({y['sigma_total']:.1e})"
        else:
            own = f"{value:.6e} ± {sigma:.1e} ({total:.1e}), {100 * sigma / abs(value):.4f} %"
        rows.append([axis, printed, own])
    caption = "Bias b of f = b + k V (Table 6), m s⁻²: value ± error with scale factors held (total error)."
    return Table(caption, ["axis", "printed", "this event"], rows, ["bias"], words=(0, 2))


def bias_budget(document):
    """Parts of the error of the bias."""
    parts = document["roll"]["budget"].items()
    rows = [[CAUSES[name], *(f"{v:.1e}" for v in values)] for name, values in parts]
    return Table("Error budget of the bias, m s⁻².", ["part", *AXES], rows, ["bias"])


def draw_motion(detected):
    """Body rates over the whole record."""
    figure, panels = grid(1, 1, 1.9, margins=WIDE | {"bottom": 0.2})
    time = (detected.time.values - detected.time.values[0]) / 3600
    gap = np.append(np.diff(time) > 0.1, False)
    for axis, rate in zip(AXES, detected.rate_b.values.T, strict=True):
        panels[0, 0].plot(time, np.where(gap, np.nan, 1e3 * rate), label=axis, **AXIS[axis])
    panels[0, 0].set(xlabel="time (h)", ylabel="rate (mrad s$^{-1}$)")
    legend(figure, panels[0, 0], 3)
    return figure


def draw_swing(scaled):
    """Angular readouts, angular acceleration and attitude of the swing."""
    figure, panels = grid(3, 1, 4.6, sharex=True, margins=WIDE)
    rows = (
        (1e3, scaled.angular_volt.values, "readout (mV)"),
        (1e6, scaled.rate_dot_b.values, "angular acc. (µrad s$^{-2}$)"),
        (1e6, scaled.angle_b.values, "attitude (µrad)"),
    )
    for panel, (unit, values, name) in zip(panels[:, 0], rows, strict=True):
        centred = unit * (values - np.nanmean(values, axis=0))
        for axis in (2, 1, 0):
            panel.plot(_since(scaled), centred[:, axis], label=AXES[axis], **AXIS[AXES[axis]])
        panel.set_ylabel(name)
    panels[-1, 0].set_xlabel("time (s)")
    legend(figure, panels[0, 0], 3)
    return figure


def _since(product):
    """Time since the first bin (s)."""
    return product.time_bin.values - product.time_bin.values[0]


def draw_residuals(scaled):
    """Measured minus predicted attitude with the noise of a bin."""
    figure, panels = grid(1, 3, 2.0, sharey=True, margins=WIDE | {"wspace": 0.1})
    for axis, panel, residual in zip(AXES, panels[0], scaled.residual_b.values.T, strict=True):
        panel.plot(_since(scaled), 1e6 * residual, color=AXIS[axis]["color"], linewidth=0.7)
        panel.set(title=axis, xlabel="time (s)")
    panels[0, 0].set_ylabel("residual (µrad)")
    return figure


def draw_convergence(scaled):
    """Kalman estimates of factors and delay, and their errors, over time, with the batch values."""
    names = ("β$_x$ (rad s$^{-2}$ V$^{-1}$)", "β$_y$ (rad s$^{-2}$ V$^{-1}$)", "delay (s)")
    value, sigma = scaled.filter_value.values, scaled.filter_sigma.values
    return _converging(_since(scaled), value, sigma, scaled.batch_value.values, names)


def draw_offset_convergence(moved):
    """Kalman estimate of the offset over time."""
    value, sigma = 1e6 * moved.filter_value.values, 1e6 * moved.filter_sigma.values
    return _converging(_since(moved), value, sigma, 1e6 * moved.offset.values[0], [f"{a} (µm)" for a in AXES])


def _converging(time, values, sigmas, ends, names):
    """Three estimates over time beside the values they end at; the scales are those of the later part."""
    figure, panels = grid(1, 3, 2.1, margins=WIDE | {"wspace": 0.38})
    late = time > 0.2 * time[-1]
    for panel, value, sigma, end, name in zip(panels[0], values.T, sigmas.T, ends, names, strict=True):
        band = {"color": COLOURS["sky"], "alpha": 0.4, "linewidth": 0, "label": "± σ"}
        panel.fill_between(time, value - sigma, value + sigma, **band)
        panel.plot(time, value, color=COLOURS["blue"], label="filter")
        panel.axhline(end, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="batch")
        reach = 1.3 * np.max(np.abs(value[late] - end) + sigma[late])
        panel.set(ylim=(end - reach, end + reach), title=name, xlabel="time (s)")
    legend(figure, panels[0, 0], 3)
    return figure


def draw_filtering(aligned):
    """Amplitude spectra of the common-mode readouts before and after the CRN filter."""
    step, before, after = filtered_readouts(aligned)
    figure, panels = grid(1, 3, 2.2, sharey=True, margins=WIDE | {"wspace": 0.1})
    taper = np.hanning(len(before))
    for panel, column, name in zip(panels[0], (0, 3, 4), ("a$_x$", "angular x", "angular y"), strict=True):
        for values, colour, label in ((before, "grey", "before"), (after, "vermilion", "after CRN")):
            own = values[:, column] - values[:, column].mean()
            density = np.sqrt(2 * step / np.sum(taper**2)) * np.abs(np.fft.rfft(taper * own))
            frequency = np.fft.rfftfreq(taper.size, step)
            panel.loglog(frequency[1:], density[1:], color=COLOURS[colour], linewidth=0.7, label=label)
        panel.set(title=name, xlabel="frequency (Hz)")
    panels[0, 0].set(ylabel="density (V Hz$^{-1/2}$)", ylim=(1e-9, 1e-1))
    legend(figure, panels[0, 0], 2)
    return figure


def draw_offset(moved):
    """Linear readings of the swing with the fitted term of the offset."""
    figure, panels = grid(3, 1, 4.4, sharex=True, margins=WIDE)
    for axis, panel in enumerate(panels[:, 0]):
        reading, model = 1e9 * moved.reading.values[:, axis], 1e9 * moved.model.values[:, axis]
        panel.plot(_since(moved), reading, color=COLOURS["grey"], linewidth=0.6, label="reading")
        panel.plot(_since(moved), model, color=AXIS[AXES[axis]]["color"], label="model")
        panel.set_ylabel(f"f$_{AXES[axis]}$ (nm s$^{{-2}}$)")
    panels[-1, 0].set_xlabel("time (s)")
    legend(figure, panels[2, 0], 2)
    return figure


def draw_segments(biased):
    """Bias of every segment, those left out hollow, with the robust mean."""
    figure, panels = grid(4, 1, 5.6, sharex=True, margins=WIDE)
    time = (biased.time_segment.values - biased.time_segment.values[0]) / 86400
    used = biased.used.values.astype(bool)
    for axis, panel in enumerate(panels[:3, 0]):
        mean, colour = float(biased.bias[axis]), AXIS[AXES[axis]]["color"]
        value = 1e9 * (biased.segment_bias.values[:, axis] - mean)
        panel.plot(time[~used], value[~used], "o", mfc="none", color=COLOURS["grey"], markersize=2.5, label="left out")
        panel.plot(time[used], value[used], ".", color=colour, markersize=3, label="used")
        panel.axhline(0, color=COLOURS["black"], linewidth=0.7)
        reach = 1.4 * np.max(np.abs(value[used]))
        name = "b" if biased.separable[axis] else "b - a"
        panel.set(ylim=(-reach, reach), ylabel=f"{name}$_{AXES[axis]}$ (nm s$^{{-2}}$)")
        panel.set_title(f"minus {mean:.6e} m s$^{{-2}}$")
    panels[3, 0].semilogy(time, 100 * biased.uniformity.values, ".", color=COLOURS["black"], markersize=3)
    panels[3, 0].set(ylabel="rate scatter (%)", xlabel="time (days)")
    legend(figure, panels[0, 0], 2)
    return figure


def draw_z_noise(biased):
    """Amplitude spectrum of z with the old factor, the new one, and with everything modelled taken off."""
    figure, panels = grid(1, 1, 2.6, margins=WIDE)
    names = ("factor of the ground", "factor of the swing", "and motion, drag, trend taken off")
    for row, colour, name in zip(biased.density.values, ("grey", "sky", "vermilion"), names, strict=True):
        panels[0, 0].loglog(biased.frequency.values, row, color=COLOURS[colour], label=name)
    panels[0, 0].axhline(3e-9, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="requirement")
    panels[0, 0].set(xlabel="frequency (Hz)", ylabel="density (m s$^{-2}$ Hz$^{-1/2}$)")
    legend(figure, panels[0, 0], 4)
    return figure
