"""Gravity-gradient torque and drag: drag by each method from an SGRS file; source: `Source`, chosen: `Parameters`."""

import functools
from pathlib import Path

import numpy as np

from flows.calibration import Calibration, Discovery, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.store import results
from tasks import common, gradient_torque
from tasks.stage import lazy

simulator = lazy("gravcal.simulation.gradient_torque")
icgem = lazy("gravcal.io.icgem")
daily = lazy("gravcal.io.daily")
readers = lazy("gravcal.io.readers")

TAIL_S = 10.0  # of measured accelerations that may be missing at the end: the last value is held


@flow(name="gradient_torque")
def calibrate(source, chosen):
    """ProductRef of the report: drag by two sensors, and by one with the printed and with the corrected equations."""
    positions = daily.sensor_positions(daily.sgrs_file(source.folder, source.date))
    position = positions[min(chosen.single_sensor, len(positions)) - 1]  # two sensors need two, the printed one no zero
    methods = ["two_sensor"] * (len(positions) == 2) + ["one_sensor_published"] * bool(np.abs(position).min() > 1e-9)
    methods.append("one_sensor")
    recorded, field = _recorded(source, chosen)
    solved = functools.partial(_solved, field=field, chosen=chosen, methods=methods)
    observed, *added = DISCOVERY.given("gradient_torque", source, chosen, recorded, solved)
    modelled, drags = _solved(observed, field, chosen, methods, "", *added)
    truths = []
    if chosen.truth:
        file = daily.other_file(Path(chosen.truth).expanduser(), "TRUTH", source.date)
        noise_free = gradient_torque.ingest(file, event=source.event)
        truth = gradient_torque.truth(file, event=source.event, variant="")
        truths = [truth, *_solved(noise_free, field, chosen, methods, ".clean")[1]]
    torque = gradient_torque.torque(modelled, observed, field, **_settings("torque", chosen))
    combined = gradient_torque.combine(modelled, *drags, *truths, methods=methods, **_settings("combine", chosen))
    values = {name: value for name, value in chosen.for_report().items() if name != "truth"}
    checked = gradient_torque.checks(modelled, recorded, **_settings("checks", chosen))
    return gradient_torque.report(combined, torque, modelled, checked, *drags, event=source.event, settings=values)


def _settings(stage, chosen):  # keywords of a stage, with the constants of the satellite
    return chosen.for_stage(stage) | {"satellite": catalog.satellite("S").settings()}


def _recorded(source, chosen):  # ProductRefs of the ingested SGRS file and of the gravity field
    observed = gradient_torque.ingest(daily.sgrs_file(source.folder, source.date), event=source.event)
    file = daily.other_file(icgem.located(chosen.field), "GFC", source.date)
    return observed, gradient_torque.field(file, event=source.event, variant="")


def _solved(observed, field, chosen, methods, suffix="", moved=(), added=""):  # gradient, [drag by each method]
    variant = suffix.removeprefix(".")
    modelled = gradient_torque.gradient(observed, field, variant=variant, **_settings("gradient", chosen))
    settings = _settings("drag", chosen)
    drags = [gradient_torque.drag(modelled, variant=name + suffix, **settings) for name in methods]
    if moved or added:
        each = zip(methods, drags, *(other for _, other in moved), strict=True)
        drags = [gradient_torque.drag_model_error(*own, variant=name, added=added) for name, *own in each]
    return modelled, drags


def by_one_sensor(source, chosen, observed, moved=(), added=""):
    """{"ingest", "gradient", "drag"}: ProductRefs by one sensor; drag with the errors of a model (`moved`, `added`)."""
    model_errors = [(None, [drag]) for drag in moved], added
    modelled, (drag,) = _solved(observed, _recorded(source, chosen)[1], chosen, ["one_sensor"], "", *model_errors)
    return {"ingest": observed, "gradient": modelled, "drag": drag}


def document(ref):
    """Result document of a report (ProductRef), with the keys of all products; "series" of a drag: its key."""
    document = common.document(ref)
    keys = document["provenance"]["products"]
    for name, block in document["drag"].items():
        block["series"] = keys.get(f"gradient_torque.drag.{name}", block["series"])
    return document


def simulation(out, chosen, day, seed, effects, truth):
    """Write the SGRS file of a simulated day: scalars of its truth, a dict; the true series go into ``truth``.nc."""
    field = icgem.read_field(icgem.located(chosen.field), chosen.field_degree)
    flown = (catalog.satellite(chosen.satellite).settings(), chosen, field, day, seed)
    columns, invented = simulator.simulate(*flown, effects, _nongravitational(chosen, day))
    daily.write_sgrs(out / f"SGRS_{chosen.date}_S_01.nc", columns)
    numbers = {name: value for name, value in invented.items() if not isinstance(value, (np.ndarray, dict))}
    numbers |= {"satellite": chosen.satellite}
    if truth is None:
        return numbers
    series = Path(truth).with_suffix(".series.nc" if Path(truth).suffix == ".nc" else ".nc")
    daily.write_sgrs(series, invented["clean"] | {"drag": invented["drag"]})
    return numbers | {"series": series.name}


def _nongravitational(chosen, day):
    """Function of GPS s (n,) -> accelerations (n, 3) m s-2 of an ACT1B or ACC1B file begun at ``day``; None if none."""
    if not chosen.nongravitational:
        return None
    file = archive.from_name(Path(chosen.nongravitational).expanduser())
    if not file or file.product not in ("ACT1B", "ACC1B"):
        refuse("nongravitational", chosen.nongravitational, "an ACT1B or ACC1B file", "Give one.")
    records = readers.read(file)
    elapsed = records["time_tag"].values - records["time_tag"].values[0]
    values = np.stack([records[f"lin_accl_{axis}"].values for axis in "xyz"], axis=1)
    known = np.isfinite(values).all(axis=1)
    covered = float(elapsed[known][-1]) if known.any() else 0.0
    if covered < chosen.duration_s - TAIL_S:
        remedy = f"Give a longer file, or --set duration_s={covered:.0f}."
        refuse(file.path.name, f"{covered:.0f} s of accelerations", f"{chosen.duration_s:.0f} s", remedy)
    return lambda time: np.stack([np.interp(time - day, elapsed[known], one[known]) for one in values.T], axis=1)


def values(document):
    """`results.Value` in m s-2 of each drag solution: rms of total sigma and, where the truth is known, rms error."""
    for name, one in (document.get("drag") or {}).items():
        label = name.replace("_", " ")
        yield results.Value("", f"{label} sigma", "m s-2", one.get("sigma_total_rms"), None, None)
        if one.get("rms_error") is not None:
            yield results.Value("", f"{label} error", "m s-2", one["rms_error"], None, None)


def recomputed(document, section, printed, run):
    """([value], [sigma or None]) for a printed row: drag error (else sigma), degrees seen, centre of pressure; or None.

    The last is as printed that of the panels by area, corrected that of the torque balance.
    """
    if section == "pressure":
        axis, balance = "xyz".index(printed.component), document.get("centre_of_pressure_m")
        if run == "as_printed":
            return [document["panel_pressure_m"]["area_weighted"][axis]], [None]
        return ([balance["value"][axis]], [balance["sigma"][axis]]) if balance else None
    single = "one_sensor_published" if run == "as_printed" else "one_sensor"
    method = {"drag_error_order_two_accelerometers": "two_sensor", "drag_error_order_single_accelerometer": single}
    if printed.name in method:
        one = document["drag"].get(method[printed.name]) or {}
        error = one.get("rms_error")
        return [one.get("sigma_total_rms") if error is None else error], [None]
    if printed.name == "observable_degree_claimed":
        degrees = zip(document["torque"]["degrees"], document["torque"]["above_sensitivity"], strict=True)
        return [", ".join(str(n) for n, above in degrees if above) or "none"], [None]
    return None


DISCOVERY = Discovery(
    lambda _source, chosen: _settings("view", chosen),
    "gravcal.calibrations.gradient_torque.observations",
    records=lambda source, chosen: _recorded(source, chosen)[0],
    products=by_one_sensor,
    again=1,
    result=lambda *arguments: by_one_sensor(*arguments)["drag"],
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    simulation=simulation,
    files=daily,
    level_one_files=lambda source: [daily.sgrs_file(source.folder, source.date)],
    document=document,
    products=gradient_torque.KINDS,
    result=values,
    recomputed=recomputed,
    discovery=DISCOVERY,
)
