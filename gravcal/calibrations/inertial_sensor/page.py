"""Report of an inertial-sensor event: its product, its result document, and the page, section by section."""

from functools import partial

import numpy as np

from gravcal.calibrations.checks import of_product
from gravcal.calibrations.inertial_sensor import checks
from gravcal.calibrations.inertial_sensor.align import SCHEMAS
from gravcal.calibrations.inertial_sensor.estimate import filtered_readouts
from gravcal.calibrations.schemas import build
from gravcal.report import pages
from gravcal.report.figures import AXIS, COLOURS, density, opened
from gravcal.report.pages import Section
from gravcal.report.plain import AXES, NOT_DETERMINED, estimate, number, numbers, plus_minus, signed

WORDS = pages.words(__file__, "page.toml")
CAUSES = WORDS.notes["causes"]
OFFSETS = ("com_to_test_mass_um", "com_to_test_mass_without_y_um")  # solutions in the order of the product
CLAIMED = {"k": 0.01, "offset in y and z": 0.03, "bias": 1e-3}  # relative, abstract of the paper
PRINTED = {"mass": 0.072, "x": 1.9440e-5, "y": 1.0328e-5, "arm_y": 10.45e-3}  # kg, kg m2, m; Sec. 2.2 and Table 1
SHOWN = 1 / 3  # largest relative error of a factor that a swing shows: beyond, its inverse is far from normal


def report(*products, event, names, settings, published):
    """Report product and files {name: text} of an event; products by names, records of the catalogue by section."""
    named = dict(zip(names, products, strict=True))
    tests = [*of_product(named["checks"]), *checks.result(named, settings)] if "checks" in named else []
    body, sections = _result(named, settings), partial(_sections, published=published)
    about = {"event": event, "settings": settings, "heading": "Inertial sensor"}
    about["subtitle"] = WORDS.note("subtitle", **body)
    document, files = pages.report("inertial_sensor", body, named, tests, sections, **about)
    swung, rolled = document.get("swing", {}), document.get("roll", {})
    unknown = {"value": [None] * 3}
    values = {name: [(swung.get(name, {}).get(axis) or {}).get("value") for axis in AXES] for name in ("k", "beta")}
    values["offset"] = 1e-6 * np.array(swung.get("adopted", unknown)["value"], dtype=float)
    values["bias"] = rolled.get("bias", unknown)["value"]
    return build(SCHEMAS["report"], values, status=document["status"], event=event), files


def _result(products, settings):
    """Result document but for its head and tail; products {name: Dataset}, settings all parameters."""
    detected = products["detect"]
    body = {
        "status": "delivered" if "scale" in products or "bias" in products else "no_manoeuvre",
        "method": settings["method"],
        "direction": "com_to_test_mass",
        "manoeuvres": [
            {"kind": kind, "start": float(a), "stop": float(b)}
            for kind in ("swing", "roll")
            for a, b in zip(detected[f"{kind}_start"].values, detected[f"{kind}_stop"].values, strict=True)
        ],
        "not_determined": {name: WORDS.note(name) for name in ("k_y", "beta_z", "bias_y")},
    }
    if "scale" in products:
        body["swing"] = _swing(products["scale"], products["offset"])
        if body["swing"]["k"]["y"]:
            del body["not_determined"]["k_y"]
    if "bias" in products:
        body["roll"] = _roll(products["bias"])
        if "not_determined" in products["bias"].attrs:
            body["not_determined"]["bias"] = products["bias"].attrs["not_determined"]
    return body | {"verdict": {"text": verdict(body)}}


def _swing(scaled, moved):
    """Factors, offset and delay as JSON; null: factors that the swing does not show, what they move beyond noise."""
    own, arms = _shown(moved.k_y, moved.k_y_sigma, moved.k_y_sigma_total), []
    for row in zip(scaled.k.values, scaled.k_sigma.values, scaled.k_sigma_total.values, strict=True):
        x, _, z = (_shown(*one) for one in zip(*row, strict=True))
        arms.append({"x": x, "y": own, "z": z})
    share = np.abs(scaled.beta_sigma.values / scaled.beta.values)[:2]  # of the first two of FACTORS
    arm, adopted = int(scaled.chosen_arm), OFFSETS[int(moved.adopted)]
    offsets = {}
    for choice, name in enumerate(OFFSETS):
        held, total = (1e6 * np.sqrt(np.diag(moved[n].values[choice])) for n in ("covariance", "covariance_total"))
        moves = 1e6 * np.abs(moved["shift"].values[choice, :2]) * np.where(share < SHOWN, 0, share)[:, None]
        known = np.where((moves > held).any(axis=0), np.nan, 1.0)
        offsets[name] = estimate(1e6 * moved.offset.values[choice] * known, held)
        offsets[name] |= {"sigma_total": numbers(total * known)}
    last = (scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1]
    beta = zip(AXES, scaled.beta.values, scaled.beta_sigma.values, strict=True)
    budget = zip(scaled.attrs["causes"].split(), scaled.k_budget.values, strict=True)
    shifts = zip(moved.attrs["causes"].split(), moved["shift"].values[0], strict=True)
    return {
        "k": arms[arm],
        "beta": {axis: estimate(value, sigma) if sigma < abs(value) * SHOWN else None for axis, value, sigma in beta},
        **offsets,
        "adopted": {"solution": adopted, "rule": WORDS.note("adopted"), **offsets[adopted]},
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


def _shown(value, sigma, total):  # factor as JSON, None where the swing does not show it
    return estimate(value, sigma) | {"sigma_total": number(total)} if total < abs(value) * SHOWN else None


def _roll(biased):
    """Bias and the parts of its error as JSON, from the bias product; null where not separable."""
    known = np.where(biased.separable.values, 1.0, np.nan)
    bias = estimate(biased.bias.values * known, biased.bias_sigma.values)
    constant = estimate(biased.bias[1], biased.bias_sigma[1]) | {"sigma_total": number(biased.bias_sigma_total[1])}
    return {
        "bias": bias | {"sigma_total": numbers(biased.bias_sigma_total.values * known)},
        "bias_volt": estimate(biased.bias_volt.values * known, biased.bias_volt_sigma.values),
        "segments": int(np.count_nonzero(biased.used)),
        "segments_found": int(biased.used.size),
        "constant_y": constant | {"volt": number(biased.bias_volt[1]), "meaning": WORDS.note("constant_y")},
        "budget": {
            name: numbers(biased[name].values)
            for name in ("statistical_sigma", "offset_sigma", "factor_sigma", "wander", "offset_effect")
        },
        "z_noise": z_noise(biased.frequency.values, biased.density.values) if biased.sizes["frequency"] else None,
        "source": biased.attrs["factors_from"],
    }


def z_noise(frequency, density):
    """Rms density of z at 10 to 50 mHz with old and new factor, and cleared, as JSON; frequency Hz, density (3, f)."""
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
    errors = {}
    if "swing" in document:
        offset, k = document["swing"]["adopted"], document["swing"]["k"]
        errors["k"] = [(k[axis]["value"], k[axis]["sigma_total"]) for axis in "xz" if k[axis]]
        errors["offset in y and z"] = list(zip(offset["value"], offset["sigma_total"], strict=True))[1:]
    if "roll" in document:
        errors["bias"] = list(zip(*(document["roll"]["bias"][name] for name in ("value", "sigma_total")), strict=True))
    shares = {name: [abs(s / v) for v, s in pairs if v and s is not None] for name, pairs in errors.items()}
    worst = {name: max(own) for name, own in shares.items() if own}
    return WORDS.note("verdict", worst=worst, claimed=CLAIMED, **document)


def _sections(document, published):
    """Sections of the page of a document, with the printed records of the catalogue, {section: [record]}."""
    sections, reasons = [Section("Motion", figures=[_motion])], document["not_determined"]
    if "swing" in document:
        notes = [WORDS.note("late", **document["swing"])]
        notes += [f"{name}: {why}." for name, why in reasons.items() if "bias" not in name]
        tables = [_factors(document, published), _arms(document), _factor_budget(document)]
        drawn = [_swing_readings, _convergence, _residuals, _filtering]
        offsets = [_offsets(document, published), _offset_budget(document)]
        sections.append(Section("Scale factors", tables, drawn, notes))
        sections.append(Section("Offset", offsets, [_offset_readings, _offset_convergence], [WORDS.note("offset")]))
    if "bias" in reasons:
        sections.append(Section("Bias", notes=[f"Not determined: {reasons['bias']}"]))
    elif "roll" in document:
        roll = document["roll"]
        notes = [WORDS.note("segments", **roll), f"b_y: {reasons['bias_y']}."]
        tables = [_bias(document, published), WORDS.table("bias_budget", document)]
        sections.append(Section("Bias", tables, [_segments], notes))
        sections.append(Section("Noise of z", figures=[_z_spectrum], notes=[WORDS.note("noise", **roll["z_noise"])]))
    return sections


def _factors(document, published):
    """Table 4: nominal, ground, orbit as printed, printed beta as k without the 1/2 (k_z by both arms), and ours."""
    known = {r["labels"]["factor"]: r["value"] for r in published.get("scale_factors", ())}
    again = {}
    if "beta_y" in known:
        again["k_x"] = [known["beta_y"][2] * PRINTED["y"] / (PRINTED["mass"] * PRINTED["arm_y"])]
    if "beta_x" in known:
        again["k_z"] = [known["beta_x"][2] * PRINTED["x"] / (PRINTED["mass"] * arm) for arm in (8.00e-3, 10.45e-3)]
    rows = []
    for name in ("k_x", "k_y", "k_z", "beta_x", "beta_y", "beta_z"):
        kind, axis = name.split("_")
        printed = [NOT_DETERMINED if v is None else f"{v:.3e}" for v in known.get(name, [None] * 3)]
        taken = " / ".join(f"{one:.3e}" for one in again.get(name, ())) or NOT_DETERMINED
        rows.append([name, *printed, taken, _measured(document["swing"][kind].get(axis))])
    return WORDS.table("factors", rows)


def _measured(block):
    """Text of a value with its sigma and total sigma, from a block of the document or None."""
    if not block or block["value"] is None:
        return "not determined"
    total = f" ({block['sigma_total']:.1e})" if block.get("sigma_total") is not None else ""
    return f"{block['value']:.4e} ± {block['sigma']:.1e}{total}"


def _arms(document):
    chosen = f"{document['swing']['arm_x_mm']:.2f} mm"
    arms = {name + " (used)" * (name == chosen): one for name, one in document["swing"]["arms"].items()}
    return WORDS.table("arms", [[name, _measured(one["x"]), _measured(one["z"])] for name, one in arms.items()])


def _factor_budget(document):
    swing = document["swing"]
    parts = swing["k_budget_relative"].items()
    rows = [[CAUSES[name], *(f"{100 * shares[axis]:.2f}" for axis in "xz")] for name, shares in parts]
    known = [swing["k"][axis] for axis in "xz"]
    rows.append(["total", *(signed(one and 100 * one["sigma_total"] / abs(one["value"]), 2) for one in known)])
    return WORDS.table("factor_budget", rows)


def _offsets(document, published):
    """Table of the offset: printed, and ours with and without a_y, with sigma and total sigma."""
    known, rows = _by_axis(published, "com_offset"), []
    for index, axis in enumerate(AXES):
        own = ([document["swing"][name][key][index] for key in ("value", "sigma", "sigma_total")] for name in OFFSETS)
        row = f"{known[axis][0]:.2f} ± {known[axis][1]:.2f}" if axis in known else NOT_DETERMINED
        rows.append([axis, row, *(plus_minus(*one, 1) for one in own)])
    return WORDS.table("offsets", rows)


def _by_axis(published, section):
    """Printed value and error of each axis, {axis: (value, sigma)}."""
    return {one["labels"]["component"]: (one["value"][0], one["sigma"][0]) for one in published.get(section, ())}


def _offset_budget(document):
    swing = document["swing"]
    rows = [["noise", *(signed(s, 1) for s in swing[OFFSETS[0]]["sigma"])]]
    rows += [[CAUSES[name], *(f"{abs(v):.1f}" for v in shift)] for name, shift in swing["budget_um"].items()]
    rows.append(["total", *(signed(s, 1) for s in swing[OFFSETS[0]]["sigma_total"])])
    return WORDS.table("offset_budget", rows)


def _bias(document, published):
    """Table of the bias: printed, and ours with sigma and total sigma."""
    roll, known, rows = document["roll"], _by_axis(published, "bias"), []
    for index, axis in enumerate(AXES):
        printed = f"{known[axis][0]:.4e} ± {known[axis][1]:.1e}" if axis in known else NOT_DETERMINED
        value, sigma, total = (roll["bias"][name][index] for name in ("value", "sigma", "sigma_total"))
        if value is None:
            y = roll["constant_y"]
            own = f"not separable; b − a = {y['value']:.6e} ± {y['sigma']:.1e} ({y['sigma_total']:.1e})"
        else:
            own = f"{value:.6e} ± {sigma:.1e} ({total:.1e}), {100 * sigma / abs(value):.4f} %"
        rows.append([axis, printed, own])
    return WORDS.table("bias", rows)


@WORDS.figure("detect")
def _motion(panel, detected):
    time = (detected.time.values - detected.time.values[0]) / 3600
    for axis, rate in zip(AXES, 1e3 * detected.rate_b.values.T, strict=True):
        panel.plot(*opened(time, rate, 0.1), label=axis, **AXIS[axis])


@WORDS.figure("scale")
def _swing_readings(panels, scaled):
    series = 1e3 * scaled.angular_volt.values, 1e6 * scaled.rate_dot_b.values, 1e6 * scaled.angle_b.values
    for panel, values in zip(panels, series, strict=True):
        for axis, centred in zip("zyx", (values - np.nanmean(values, axis=0)).T[::-1], strict=True):
            panel.plot(_since(scaled), centred, label=axis, **AXIS[axis])


def _since(product):
    """Time since the first bin (s)."""
    return product.time_bin.values - product.time_bin.values[0]


@WORDS.figure("scale")
def _residuals(panels, scaled):
    for axis, panel, residual in zip(AXES, panels, scaled.residual_b.values.T, strict=True):
        panel.plot(_since(scaled), 1e6 * residual, color=AXIS[axis]["color"], linewidth=0.7)


@WORDS.figure("scale")
def _convergence(panels, scaled):
    _converging(panels, scaled, scaled.batch_value.values, 1.0)


@WORDS.figure("offset")
def _offset_convergence(panels, moved):
    _converging(panels, moved, moved.offset.values[0], 1e6)


def _converging(panels, filtered, batch, factor):
    """Filter estimates of three constants over time, factor times, with the batch values (3,) at which they end."""
    time = _since(filtered)
    late = time > 0.2 * time[-1]
    values, sigmas = factor * filtered.filter_value.values.T, factor * filtered.filter_sigma.values.T
    band = {"color": COLOURS["sky"], "alpha": 0.4, "linewidth": 0, "label": "± σ"}
    for panel, value, sigma, batch_value in zip(panels, values, sigmas, factor * batch, strict=True):
        panel.fill_between(time, value - sigma, value + sigma, **band)
        panel.plot(time, value, color=COLOURS["blue"], label="filter")
        panel.axhline(batch_value, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="batch")
        reach = 1.3 * np.max(np.abs(value[late] - batch_value) + sigma[late])
        panel.set_ylim(batch_value - reach, batch_value + reach)


@WORDS.figure("align")
def _filtering(panels, aligned):
    """Amplitude densities of one linear and two angular readouts before and after the published CRN filter."""
    step, before, after = filtered_readouts(aligned)
    for values, colour, label in ((before, "grey", "before"), (after, "vermilion", "after CRN")):
        frequency, amplitude = density([values - values.mean(axis=0)], step)
        for panel, column in zip(panels, (0, 3, 4), strict=True):
            panel.loglog(frequency, amplitude[:, column], color=COLOURS[colour], linewidth=0.7, label=label)
    panels[0].set_ylim(1e-9, 1e-1)


@WORDS.figure("offset")
def _offset_readings(panels, moved):
    for panel, reading, model in zip(panels, 1e9 * moved.reading.values.T, 1e9 * moved.model.values.T, strict=True):
        panel.plot(_since(moved), reading, color=COLOURS["grey"], linewidth=0.6, label="reading")
        panel.plot(_since(moved), model, color=COLOURS["blue"], label="model")


@WORDS.figure("bias")
def _segments(panels, biased):
    """Bias of each segment minus the mean, for three axes, and the scatter of the roll rate."""
    time = (biased.time_segment.values - biased.time_segment.values[0]) / 86400
    used, separable = (biased[name].values.astype(bool) for name in ("used", "separable"))
    values = 1e9 * (biased.segment_bias.values - biased.bias.values).T
    for k, (panel, value, axis) in enumerate(zip(panels[:3], values, AXES, strict=True)):
        panel.plot(time[~used], value[~used], "o", mfc="none", color=COLOURS["grey"], markersize=2.5, label="left out")
        panel.plot(time[used], value[used], ".", color=AXIS[axis]["color"], markersize=3, label="used")
        panel.axhline(0, color=COLOURS["black"], linewidth=0.7)
        reach, name = 1.4 * np.max(np.abs(value[used])), f"{'b' if separable[k] else 'b - a'}$_{axis}$"
        title = f"minus {biased.bias.values[k]:.6e} m s$^{{-2}}$"
        panel.set(ylim=(-reach, reach), ylabel=f"{name} (nm s$^{{-2}}$)", title=title)
    panels[3].semilogy(time, 100 * biased.uniformity.values, ".", color=COLOURS["black"], markersize=3)
    panels[3].set_ylabel("rate scatter (%)")


@WORDS.figure("bias")
def _z_spectrum(panel, biased):
    """Amplitude spectra of the z axis with old and new factor, and with motion, drag and trend taken off."""
    names = ("factor of the ground", "factor of the swing", "and motion, drag, trend taken off")
    for row, colour, name in zip(biased.density.values, ("grey", "sky", "vermilion"), names, strict=True):
        panel.loglog(biased.frequency.values, row, color=COLOURS[colour], label=name)
    panel.axhline(3e-9, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="requirement")
