"""Inertial sensor: scale factors, offset and bias from voltages, attitude; source: `Source`, chosen: `Parameters`."""

from datetime import timedelta

from flows.calibration import EPOCH, Calibration, Discovery, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import common, discovery, inertial_sensor
from tasks.stage import lazy, read

simulator = lazy("gravcal.simulation.inertial_sensor")
daily = lazy("gravcal.io.daily")

GEOMETRY = {"mass": "test_mass", "inertia": "test_mass_inertia", "arm": "electrode_arm"}


@flow(name="inertial_sensor")
def calibrate(source, chosen):
    """ProductRef of the report: scale factors and offset from a swing, bias from a roll."""
    products, files = _solved(source, chosen, widened=True)
    if files:
        satellite = catalog.satellite("T").settings()
        known = {"orbit_height": satellite["orbit_height"], "inertia": satellite["test_mass_inertia"]}
        settings = {"event": source.event, "variant": ""} | known | chosen.for_stage("checks")
        products["checks"] = inertial_sensor.checks(products["detect"], *level_one_files(source), **settings)
    products.pop("segment", None)
    about = {"event": source.event, "settings": chosen.for_report(), "published": common.printed_of("inertial_sensor")}
    return inertial_sensor.report(*products.values(), names=list(products), **about)


def observed(source, chosen, search=None, variant=None):
    """{name: ProductRef} for the observations: of the swing, of the roll; "detect" alone if there is neither.

    With a search (ProductRef), its findings are taken out of the records; variant of these products.
    """
    products, files = _solved(source, chosen, widened=False, search=search and {"product": search, "variant": variant})
    return {name: one for name, one in products.items() if name != "detect" or not files}


def _solved(source, chosen, *, widened, search=None):
    """({name: ProductRef}, Level-1 files): less model effects (widened: with errors) or the findings of a search."""
    days, event = daily.days(source.folder, source.date), source.event
    products, files = {"detect": _detected(days, source, chosen)}, []
    detected = read(products["detect"])
    if detected["swing_start"].size:
        files += _files(days, detected["swing_start"][0], detected["swing_stop"][0], chosen.margin_s)
        aligned = inertial_sensor.align(products["detect"], *files, event=event, **chosen.for_stage("align"))
        products |= _without_model(source, chosen, _swing, aligned, {}, (widened, search))
    if detected["roll_start"].size:
        own = _files(days, detected["roll_start"][0], detected["roll_stop"][-1], 0.0)
        segmented = inertial_sensor.segment(products["detect"], *own, event=event, **chosen.for_stage("segment"))
        known = {name: products[name] for name in ("scale", "offset") if name in products}
        products |= _without_model(source, chosen, _roll, segmented, known, (widened, search))
        files += own
    return products, files


def _swing(chosen, aligned, _known):  # {name: ProductRef} from the aligned record of a swing
    scaled = inertial_sensor.scale(aligned, geometry=geometry(), **chosen.for_stage("scale"))
    moved = inertial_sensor.offset(aligned, scaled, **chosen.for_stage("offset"))
    return {"align": aligned, "scale": scaled, "offset": moved}


def _roll(chosen, segmented, known):
    """{name: ProductRef} from the bins of a roll; known are scale and offset of a swing, {} without one."""
    settings = {"assumed": assumed(chosen)} | chosen.for_stage("bias")
    return {"segment": segmented, "bias": inertial_sensor.bias(segmented, *known.values(), **settings)}


def _without_model(source, chosen, solve, records, known, how):
    """{name: ProductRef} by `_swing` or `_roll` (solve) of records less a model or findings; how: (widened, search)."""
    products, (widened, search) = solve(chosen, records, known), how
    if search:
        if chosen.model:
            products = _without_model(source, chosen, solve, records, known, (False, None))
        parts = products | known
        about = {"observations": DISCOVERY.observations, "settings": views(None, chosen), "tentative": True}
        about |= {"records": records.kind, "names": list(parts), "variant": search["variant"], "event": records.event}
        return solve(chosen, discovery.extend_by(search["product"], *parts.values(), **about), known)
    one = lambda moved: solve(chosen, moved, known)  # noqa: E731
    without, moved = DISCOVERY.taken_out(source, chosen, records, one, products | known, alone=not widened)
    if without is records:  # no model, or none of this day
        return products
    products = solve(chosen, without, known)
    for name in ("scale", "offset", "bias") if moved else ():
        if name in products:
            solved = (one[name] for one in (products, *moved))
            products[name] = inertial_sensor.model_error(*solved, kind=f"inertial_sensor.{name}")
    return products


def views(_source, chosen):
    """Keyword settings of ``observe`` for a swing ("scene") and a roll ("rolling"), and the pointing limit in rad."""
    known = chosen.for_stage("scale") | chosen.for_stage("offset") | {"inertia": geometry()["inertia"]}
    scene = {name: known[name] for name in ("bin_s", "quiet_margin_s", "drift_degree", "noise_order", "inertia")}
    known = chosen.for_stage("bias") | {"assumed": assumed(chosen)}
    names = ("segment_s", "uniformity_limit", "share_limit")
    names += ("trend_degree", "amplitude_degree", "amplitude_harmonics", "assumed")
    limit = chosen.for_stage("checks")["pointing_limit_rad"]
    return {"scene": scene, "rolling": {name: known[name] for name in names}, "pointing_limit_rad": limit}


def _files(days, start, stop, margin):  # Level-1 files of the days between two GPS s, margin in s
    first, last = ((EPOCH + timedelta(seconds=float(t))).date().isoformat() for t in (start - margin, stop + margin))
    return [one for date, files in days.items() if first <= date <= last for one in files.values()]


def geometry():
    """Mass (kg), inertia (kg m2) and electrode arms (m) of the test mass, {name: value, name_sigma: error}."""
    satellite = catalog.satellite("T").settings()
    return {name + end: satellite[key + end] for name, key in GEOMETRY.items() for end in ("", "_sigma")}


def assumed(chosen):
    """{name: value} of scale factors and offset assumed for a roll without a swing, settings "assumed_<name>"."""
    return {name.removeprefix("assumed_"): value for name, value in chosen.for_stage("assumed").items()}


@flow(name="inertial_sensor_detect")
def detect(source, chosen):
    """ProductRef of the swings and rolls in the attitude files."""
    return _detected(daily.days(source.folder, source.date), source, chosen)


def _detected(days, source, chosen):  # ProductRef of "detect"; days {date: {product: file}}
    attitudes = (files["ATT"] for files in days.values())
    return inertial_sensor.detect(*attitudes, event=source.event, variant="", **chosen.for_stage("detect"))


def level_one_files(source):
    """[LevelOneFile]: IS1, ATT and ORB files of all days of a source."""
    return [one for files in daily.days(source.folder, source.date).values() for one in files.values()]


def manoeuvres(detected):
    """{"kind": "swing" or "roll", "start", "stop" in GPS s} of each manoeuvre in the Dataset of `detect`."""
    for kind in ("swing", "roll"):
        for start, stop in zip(detected[f"{kind}_start"].values, detected[f"{kind}_stop"].values, strict=True):
            yield {"kind": kind, "start": float(start), "stop": float(stop)}


def simulation(out, chosen, day, seed, effects, _truth):
    """Write the files of a simulated event of the day that begins at GPS s ``day``; its truth, a dict."""
    records, invented = simulator.simulate(catalog.satellite("T").settings(), chosen, day, seed, effects)
    for record in records:
        for product, values in record.items():
            daily.write(out, product, values)
    return invented | {"satellite": "T"}


def values(document):
    """`results.Value` of a document: offset (um) and scale factors from the swing, bias (m s-2) from the roll."""
    swing, roll = document.get("swing") or {}, document.get("roll") or {}
    if swing.get("adopted"):
        yield from results.vector("", "offset", "um", swing["adopted"])
    for name, unit in (("k", "m s-2 V-1"), ("beta", "rad s-2 V-1")):
        for axis, one in (swing.get(name) or {}).items():
            if one:
                yield results.Value("", f"{name} {axis}", unit, one["value"], one["sigma"], one.get("sigma_total"))
    if roll.get("bias"):
        yield from results.vector("", "bias", "m s-2", roll["bias"])


def foretold(document):
    """`results.Value`, six: offset (um) and linear scale factors k (m s-2 V-1), None where not determined."""
    swing = document.get("swing") or {}
    yield from results.vector("", "offset", "um", swing.get("adopted") or {})
    for axis in results.AXES:
        one = (swing.get("k") or {}).get(axis) or {}
        yield results.Value("", f"k {axis}", "m s-2 V-1", one.get("value"), one.get("sigma"), None)


def printed_component(word, unit):
    """Function of a published record -> [row (panel, unit, value, sigma, remark)] of its one component."""
    return lambda one: [(f"{word} {one.component}", unit, one.value[0], one.sigma[0], "")]


def printed_factor(one):
    """Row (panel, unit, value, sigma, remark) of a published linear scale factor: in orbit, else on ground."""
    _, ground, orbit = one.value
    value = ground if orbit is None else orbit
    if one.factor.startswith("k_") and value is not None:
        yield one.factor.replace("_", " "), "m s-2 V-1", value, one.sigma[0], "on ground, " if orbit is None else ""


def recomputed(document, section, printed, _run):
    """(values, sigmas) for a printed row of Tables 4 to 6: scale factor, component of offset or bias; or None."""
    swing, roll = document.get("swing") or {}, document.get("roll") or {}
    if section == "scale_factors":
        name, _, axis = printed.factor.partition("_")
        one = (swing.get(name) or {}).get(axis)
        return one and ((None, None, one["value"]), (None, None, one["sigma"]))
    block = swing.get("adopted") if section == "com_offset" else roll.get("bias") if section == "bias" else None
    k = "xyz".index(printed.labels.get("component", "x"))
    return block and ([block["value"][k]], [block["sigma"][k]])


SEEN = "gravcal.calibrations.inertial_sensor.observations"
DISCOVERY = Discovery(views, SEEN, products=observed, again=2, rebuilt=observed)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    detect=detect,
    manoeuvres=manoeuvres,
    simulation=simulation,
    files=daily,
    level_one_files=level_one_files,
    products=inertial_sensor.KINDS,
    result=values,
    recomputed=recomputed,
    printed={
        "com_offset": printed_component("offset", "µm"),
        "scale_factors": printed_factor,
        "bias": printed_component("bias", "m s-2"),
    },
    planning=simulator,
    foretold=foretold,
    truth=lambda truth: truth["com_to_test_mass_um"] + truth["k"],
    discovery=DISCOVERY,
)
