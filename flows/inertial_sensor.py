"""Inertial-sensor calibration: from voltages and attitude to scale factors, offset and bias."""

from __future__ import annotations

import functools
from datetime import timedelta

from flows import models
from flows.calibration import EPOCH, Calibration, Discovery
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import discovery_swing, inertial_sensor
from tasks.stage import lazy, read

simulator = lazy("gravcal.simulation.inertial_sensor")
inertial_files = lazy("gravcal.io.inertial_files")

GEOMETRY = {"mass": "test_mass", "inertia": "test_mass_inertia", "arm": "electrode_arm"}
KNOWN = ("scale", "offset")  # products of a swing that a roll is solved with


@flow(name="inertial_sensor")
def calibrate(source, chosen):
    """Scale factors and offset from a swing, bias from a roll."""
    days = _days(source)
    found = _detected(days, source, chosen)
    seen = read(found)
    parts, looked_at = {"detect": found}, []
    if seen["swing_start"].size:
        files = _files(days, float(seen["swing_start"][0]), float(seen["swing_stop"][0]), chosen.margin_s)
        looked_at += files
        parts |= _swing(found, files, source, chosen)
        if chosen.model:
            parts |= _with_model(parts, chosen)
    if seen["roll_start"].size:
        rolled = _rolled(found, days, source, chosen, parts)
        parts["bias"] = _roll_with_model(rolled, parts, chosen) if chosen.model else rolled["bias"]
        looked_at += [one for one in _files(days, *_roll_span(seen), 0.0) if one not in looked_at]
    if looked_at:
        height = catalog.satellite("T").settings()["orbit_height"]
        known = {"orbit_height": height, "inertia": _geometry()["inertia"]} | chosen.for_stage("checks")
        parts["checks"] = inertial_sensor.checks(found, *looked_at, event=source.event, variant="", **known)
    return inertial_sensor.report(*parts.values(), names=list(parts), **_report_settings(source, chosen))


def _swing(found, files, source, chosen):
    """Products of a swing by name."""
    aligned = inertial_sensor.align(found, *files, event=source.event, **chosen.for_stage("align"))
    return _solved(aligned, chosen)


def _solved(aligned, chosen):
    """Products of the record of a swing by name."""
    scaled = inertial_sensor.scale(aligned, geometry=_geometry(), **chosen.for_stage("scale"))
    moved = inertial_sensor.offset(aligned, scaled, **chosen.for_stage("offset"))
    return {"align": aligned, "scale": scaled, "offset": moved}


def _with_model(parts, chosen):
    """Products of a swing without the effects of the model that was given, its errors in theirs."""
    extended = functools.partial(_extended, parts, chosen)
    aligned, moved = models.taken_out(chosen.model, extended, functools.partial(_solved, chosen=chosen))
    found = _solved(aligned, chosen)
    if moved:
        found["scale"] = inertial_sensor.scale_model_error(found["scale"], *(one["scale"] for one in moved))
        found["offset"] = inertial_sensor.offset_model_error(found["offset"], *(one["offset"] for one in moved))
    return found


def _rolled(found, days, source, chosen, swing):
    """Products of a roll by name; `swing` holds those of a swing, if there is one."""
    seen = read(found)
    segmented = inertial_sensor.segment(
        found, *_files(days, *_roll_span(seen), 0.0), event=source.event, **chosen.for_stage("segment")
    )
    return _turned(segmented, chosen, swing)


def _roll_span(seen):
    """Begin of the first and end of the last roll."""
    return float(seen["roll_start"][0]), float(seen["roll_stop"][-1])


def _turned(segmented, chosen, swing):
    """Products of the bins of a roll by name."""
    known = [swing[name] for name in KNOWN if name in swing]
    settings = {"assumed": _assumed(chosen)} | chosen.for_stage("bias")
    return {"segment": segmented, "bias": inertial_sensor.bias(segmented, *known, **settings)}


def _roll_with_model(rolled, swing, chosen):
    """Bias of a roll without the effects of the model that was given, its errors in that of the bias."""
    extended = functools.partial(_extended_roll, swing | rolled, chosen)
    again = functools.partial(_turned, chosen=chosen, swing=swing)
    segmented, moved = models.taken_out(chosen.model, extended, again)
    found = again(segmented)["bias"]
    return inertial_sensor.bias_model_error(found, *(one["bias"] for one in moved)) if moved else found


def _extended_roll(parts, chosen, model, variant):
    """Bins of a roll without the effects of a model."""
    given = [parts[name] for name in ("segment", "bias", *KNOWN) if name in parts]
    return discovery_swing.extend_roll(*given, model=model, rolling=roll_settings(chosen), variant=variant)


def _extended(parts, chosen, model, variant):
    """Record of a swing without the effects of a model."""
    swing = [parts[name] for name in ("align", "scale", "offset")]
    return discovery_swing.extend(*swing, model=model, scene=scene_settings(chosen), variant=variant)


def baseline(source, chosen):
    """Products that discovery looks at, by name: of the swing, of the roll; what was detected if there is neither."""
    days = _days(source)
    found = _detected(days, source, chosen)
    seen, parts = read(found), {}
    if seen["swing_start"].size:
        files = _files(days, float(seen["swing_start"][0]), float(seen["swing_stop"][0]), chosen.margin_s)
        parts |= _swing(found, files, source, chosen)
        if chosen.model:
            parts |= _solved(_extended(parts, chosen, chosen.model, "extended"), chosen)
    if seen["roll_start"].size:
        parts |= _rolled(found, days, source, chosen, parts)
        if chosen.model:
            parts |= _turned(_extended_roll(parts, chosen, chosen.model, "extended"), chosen, parts)
    return parts or {"detect": found}


def scene_settings(chosen):
    """What the view of a swing needs beside the products."""
    known = chosen.for_stage("scale") | chosen.for_stage("offset")
    names = ("bin_s", "quiet_margin_s", "drift_degree", "noise_order")
    return {name: known[name] for name in names} | {"inertia": _geometry()["inertia"]}


def views(source, chosen):  # noqa: ARG001 - as for the other calibrations
    """What the views of a swing and of a roll need beside the products."""
    return {"scene": scene_settings(chosen), "rolling": roll_settings(chosen)}


def roll_settings(chosen):
    """What the view of a roll needs beside the products."""
    known = chosen.for_stage("bias")
    names = ("segment_s", "trend_degree", "amplitude_degree", "amplitude_harmonics")
    return {name: known[name] for name in names} | {"assumed": _assumed(chosen)}


def _days(source):
    """Files of every day of the source."""
    return inertial_files.days(source.folder, source.date)


def _files(days, start, stop, margin):
    """Files of the days that a span touches."""
    first, last = ((EPOCH + timedelta(seconds=t)).date().isoformat() for t in (start - margin, stop + margin))
    return [one for date, files in days.items() if first <= date <= last for one in files.values()]


def _geometry():
    """Mass, inertia and arms of the test mass with their errors."""
    satellite = catalog.satellite("T").settings()
    return {name + end: satellite[key + end] for name, key in GEOMETRY.items() for end in ("", "_sigma")}


def _assumed(chosen):
    """Scale factors and offset for a roll without a swing."""
    return {name.removeprefix("assumed_"): value for name, value in chosen.for_stage("assumed").items()}


def _report_settings(source, chosen):
    """What the report says beside the products: all settings, and what is printed."""
    values = chosen.for_report()
    printed = {
        section: [{"labels": dict(r.labels), "value": list(r.value), "sigma": list(r.sigma)} for r in records]
        for section, records in catalog.published("inertial_sensor").items()
        if section != "scalars"
    }
    return {"event": source.event, "settings": values, "published": printed}


@flow(name="inertial_sensor_detect")
def detect(source, chosen):
    """Swings and rolls of the files."""
    return _detected(_days(source), source, chosen)


def _detected(days, source, chosen):
    """Swings and rolls of all days in one product."""
    attitudes = (files["ATT"] for files in days.values())
    return inertial_sensor.detect(*attitudes, event=source.event, variant="", **chosen.for_stage("detect"))


def level_one_files(source):
    """Files of all days of a source."""
    return [one for files in _days(source).values() for one in files.values()]


def manoeuvres(found):
    """Swings and rolls of a detect product."""
    for kind in ("swing", "roll"):
        for start, stop in zip(found[f"{kind}_start"].values, found[f"{kind}_stop"].values, strict=True):
            yield {"kind": kind, "start": float(start), "stop": float(stop)}


def simulation(out, chosen, day, seed, effects, _truth):
    """Truth of an invented event; its files are written."""
    records, invented = simulator.simulate(catalog.satellite("T").settings(), chosen, day, seed, effects)
    for record in records:
        for product, values in record.items():
            inertial_files.write(out, product, values)
    return invented | {"satellite": "T"}


def values(document):
    """Offset and scale factors from the swing, bias from the roll."""
    swing, roll = document.get("swing") or {}, document.get("roll") or {}
    if swing.get("adopted"):
        yield from results.vector("", "offset", "um", swing["adopted"])
    for name, unit in (("k", "m s-2 V-1"), ("beta", "rad s-2 V-1")):
        for axis, one in (swing.get(name) or {}).items():
            if one:
                yield results.Value("", f"{name} {axis}", unit, one["value"], one["sigma"], one.get("sigma_total"))
    if roll.get("bias"):
        yield from results.vector("", "bias", "m s-2", roll["bias"])


def printed_offset(one):
    """Row of one printed component of the offset."""
    yield f"offset {one.component}", "µm", one.value[0], one.sigma[0], ""


def printed_bias(one):
    """Row of one printed component of the bias."""
    yield f"bias {one.component}", "m s-2", one.value[0], one.sigma[0], ""


def printed_factor(one):
    """Row of a printed linear scale factor: of the orbit, else of the ground."""
    _, ground, orbit = one.value
    value = ground if orbit is None else orbit
    if one.factor.startswith("k_") and value is not None:
        yield one.factor.replace("_", " "), "m s-2 V-1", value, one.sigma[0], "on ground, " if orbit is None else ""


CALIBRATION = Calibration(
    name="inertial_sensor",
    title="Inertial sensor",
    quantity="Offset, scale factors and bias of the inertial sensor",
    begins=("IS1",),
    satellites=("T",),
    inputs={"sensor": ("IS1",), "attitude": ("ATT",)},
    flow=calibrate,
    detect=detect,
    manoeuvres=manoeuvres,
    simulation=simulation,
    files=inertial_files,
    mission="taiji",
    span_days=100_000,  # all days of one folder are one event
    level_one_files=level_one_files,
    products=inertial_sensor.KINDS,
    result=values,
    printed={"com_offset": printed_offset, "scale_factors": printed_factor, "bias": printed_bias},
    design="inertial_sensor_swing",
    discovery=Discovery(baseline, views),
)
