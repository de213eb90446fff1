"""Gravity-gradient torque and drag: from an SGRS file to the drag by each method, and what one sensor can tell."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from flows.calibration import Calibration, Discovery
from flows.engine import flow, models
from gravcal import catalog
from gravcal.errors import ProductError
from gravcal.store import results
from tasks import common, discovery_gradient, gradient_torque
from tasks.stage import lazy

simulator = lazy("gravcal.simulation.gradient_torque")
icgem = lazy("gravcal.io.icgem")
sgrs_files = lazy("gravcal.io.sgrs_files")

TAIL_S = 10.0  # of measured accelerations that may be missing at the end: the last value is held


@flow(name="gradient_torque")
def calibrate(source, chosen):
    """Drag by two sensors and by one, as printed and as it should be."""
    file, fields, truth_file = _files(source, chosen)
    methods = _methods(file, chosen)
    recorded, stored = _recorded(source, file, fields)
    observed, moved = recorded, []
    if chosen.model:
        solved = functools.partial(_solved, stored=stored, chosen=chosen, methods=methods)
        observed, moved = models.taken_out(chosen.model, _without(observed, stored, chosen), solved)
    modelled, drags = _solved(observed, stored, chosen, methods)
    for k, name in enumerate(methods if moved else ()):
        others = (result[1][k] for result in moved)
        drags[k] = gradient_torque.drag_model_error(drags[k], *others, variant=name)
    known = []
    if truth_file is not None:
        clean = gradient_torque.ingest(truth_file, event=source.event)
        truth = gradient_torque.truth(truth_file, event=source.event, variant="")
        known = [truth, *_solved(clean, stored, chosen, methods, ".clean")[1]]
    torque = gradient_torque.torque(modelled, observed, stored, satellite=_satellite(), **chosen.for_stage("torque"))
    shared = {name: getattr(chosen, name) for name in ("single_sensor", "elongation")}
    settings = chosen.for_stage("combine") | shared | {"methods": methods, "satellite": _satellite()}
    combined = gradient_torque.combine(modelled, *drags, *known, **settings)
    values = {name: value for name, value in chosen.for_report().items() if name != "truth"}
    checked = gradient_torque.checks(modelled, recorded, satellite=_satellite(), **chosen.for_stage("checks"))
    return gradient_torque.report(combined, torque, modelled, checked, *drags, event=source.event, settings=values)


def _solved(observed, stored, chosen, methods, suffix=""):
    """Gradient and drags of one set of readings."""
    numbers = {"satellite": _satellite()}
    variant = suffix.removeprefix(".")
    modelled = gradient_torque.gradient(observed, stored, variant=variant, **numbers, **chosen.for_stage("gradient"))
    settings = chosen.for_stage("drag") | {"satellite": _satellite()}
    return modelled, [gradient_torque.drag(modelled, variant=name + suffix, **settings) for name in methods]


def _recorded(source, file, fields):
    """Readings and gravity field."""
    observed = gradient_torque.ingest(file, event=source.event)
    return observed, gradient_torque.field(fields, event=source.event, variant="")


def _of_one(observed, stored, chosen):
    """Readings with gradient and drag by one sensor."""
    modelled, (drag,) = _solved(observed, stored, chosen, ["one_sensor"])
    return observed, modelled, drag


def _without(observed, stored, chosen):
    """(model, variant) -> readings without the effects of that model."""
    products = _of_one(observed, stored, chosen)
    return functools.partial(_extended, products, scene_settings(None, chosen))


def _extended(products, scene, model, variant):
    """Readings without the effects of a model."""
    return discovery_gradient.extend(*products, model=model, scene=scene, variant=variant)


def baseline(source, chosen):
    """Products that discovery looks at: readings, gradient, drag by one sensor."""
    file, fields, _ = _files(source, chosen)
    observed, stored = _recorded(source, file, fields)
    observed = _without(observed, stored, chosen)(chosen.model, "extended") if chosen.model else observed
    return _of_one(observed, stored, chosen)


def from_one_sensor(source, chosen, observed):
    """The same products from other readings of the day."""
    _, fields, _ = _files(source, chosen)
    return _of_one(observed, gradient_torque.field(fields, event=source.event, variant=""), chosen)


def scene_settings(source, chosen):  # noqa: ARG001 - as for the other calibrations
    """What the view of a day needs beside the products."""
    names = ("elongation", "gap_limit_s", "torque_step_s", "torque_noise_order", "control_hz", "control_damping")
    known = {name: getattr(chosen, name) for name in names} | chosen.for_stage("view")
    return known | {"satellite": _satellite()}


def _satellite():
    """Numbers of the satellite, which every stage takes."""
    return catalog.satellite("S").settings()


def _files(source, chosen):
    """SGRS file, gravity field, and truth if there is one."""
    file = sgrs_files.find(source.folder, source.date)
    fields = sgrs_files.other_file(icgem.located(chosen.field), "GFC", source.date)
    truth = sgrs_files.other_file(Path(chosen.truth).expanduser(), "TRUTH", source.date) if chosen.truth else None
    return file, fields, truth


def _methods(file, chosen):
    """Methods that the file allows: two sensors need two, the printed one needs places without a zero."""
    places = sgrs_files.sensor_positions(file)
    two = ["two_sensor"] if len(places) == 2 else []
    place = places[min(chosen.single_sensor, len(places)) - 1]
    return [*two, *(["one_sensor_published"] if np.abs(place).min() > 1e-9 else []), "one_sensor"]


def level_one_files(source):
    """The SGRS file of a day."""
    return [sgrs_files.find(source.folder, source.date)]


def document(ref):
    """Result document of a report product, with the keys of everything it was made from."""
    found = common.document(ref)
    keys = found["provenance"]["products"]
    for name, block in found["drag"].items():
        block["series"] = keys.get(f"gradient_torque.drag.{name}", block["series"])
    return found


def simulation(out, chosen, day, seed, effects, truth):
    """Numbers of the truth of an invented day; its file is written, and as netCDF beside the truth the true series."""
    field = icgem.read_field(icgem.located(chosen.field), chosen.field_degree)
    flown = (catalog.satellite(chosen.satellite).settings(), chosen, field, day, seed)
    columns, invented = simulator.simulate(*flown, effects, _nongravitational(chosen, day))
    sgrs_files.write(out / sgrs_files.file_name(chosen.date), columns)
    numbers = {name: value for name, value in invented.items() if not isinstance(value, (np.ndarray, dict))}
    numbers |= {"satellite": chosen.satellite}
    if truth is None:
        return numbers
    series = Path(truth).with_suffix(".nc")
    sgrs_files.write(series, invented["clean"] | {"drag": invented["drag"]})
    return numbers | {"series": series.name}


def _nongravitational(chosen, day):
    """Accelerations of an ACT1B file as a function of time, or None."""
    if not chosen.nongravitational:
        return None
    from gravcal.io import archive, readers

    file = archive.from_name(Path(chosen.nongravitational).expanduser())
    if file.product not in ("ACT1B", "ACC1B"):
        raise ProductError(f"nongravitational: found {file.path.name}, expected an ACT1B or ACC1B file. Give one.")
    read = readers.read(file)
    since = read["time_tag"].values - read["time_tag"].values[0]
    values = np.stack([read[f"lin_accl_{axis}"].values for axis in "xyz"], axis=1)
    known = np.isfinite(values).all(axis=1)
    covered = float(since[known][-1]) if known.any() else 0.0
    if covered < chosen.duration_s - TAIL_S:
        raise ProductError(
            f"{file.path.name}: found {covered:.0f} s of accelerations, expected {chosen.duration_s:.0f} s. Give a "
            f"longer file, or --set duration_s={covered:.0f}."
        )
    return lambda time: np.stack([np.interp(time - day, since[known], one[known]) for one in values.T], axis=1)


def values(document):
    """Total sigma of each solution for the drag, and its error where the truth is known."""
    for name, one in (document.get("drag") or {}).items():
        label = name.replace("_", " ")
        yield results.Value("", label, "m s-2", one.get("sigma_total_rms"), None, None)
        if one.get("rms_error") is not None:
            yield results.Value("", f"{label} error", "m s-2", one["rms_error"], None, None)


CALIBRATION = Calibration(
    name="gradient_torque",
    title="Gradient and torque",
    quantity="Drag: sigma (rms) with one and with two sensors",
    begins=("SGRS",),
    satellites=("S",),
    inputs={"sensors": ("SGRS",)},
    flow=calibrate,
    simulation=simulation,
    files=sgrs_files,
    mission="demo",
    level_one_files=level_one_files,
    document=document,
    products=gradient_torque.KINDS,
    result=values,
    levels={
        "two sensor": "drag_error_order_two_accelerometers",
        "one sensor": "drag_error_order_single_accelerometer",
        "one sensor published": "drag_error_order_single_accelerometer",
    },
    discovery=Discovery(baseline, scene_settings, again=from_one_sensor),
)
