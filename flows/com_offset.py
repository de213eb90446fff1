"""Centre-of-mass offset from Level-1 files (10.3390/rs14164030); arguments: source a `Source`, chosen `Parameters`."""

from flows.calibration import Calibration, Discovery, of_columns, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import com_offset, common
from tasks.stage import lazy

simulator = lazy("gravcal.simulation.com_offset")

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
TORQUERS = ("inertia", "dipole_per_current")
TORQUERS_WITH_SIGMA = (*TORQUERS, "inertia_sigma", "dipole_per_current_sigma")


@flow(name="com_offset")
def calibrate(source, chosen):
    """ProductRef of the report on the offset of the centre of mass from the manoeuvres of one day."""
    spans, recorded = _aligned(source, chosen)
    aligned, *added = DISCOVERY.given("com_offset", source, chosen, recorded)
    checked = com_offset.field(aligned, **chosen.for_stage("field"))
    surveyed = com_offset.survey(aligned, checked)
    smoothed, angular, solved = _solved(source, chosen, aligned, checked, VARIANTS)
    others = [common.ingest(file, event=source.event) for file in source.files(*CALIBRATION.inputs["orbit"])[1:]]
    judged = com_offset.checks(aligned, checked, smoothed, *others, **chosen.for_stage("checks"))
    products = (_joined(chosen, solved, *added), *solved, *angular, smoothed, checked, surveyed, spans, aligned, judged)
    known, settings = catalog.satellite(source.satellite).settings(), chosen.for_report()
    settings |= {name: known[name] for name in ("roll_response", "roll_response_sigma") if name in known}
    about = {"event": source.event, "satellite": source.satellite, "settings": settings}
    return com_offset.report(*products, **about, published=common.printed_of("com_offset", source.event))


def _aligned(source, chosen):  # ProductRefs of the stages "detect" and "align"
    files = {name: common.ingest(source.file(*names), event=source.event) for name, names in CALIBRATION.inputs.items()}
    detected = com_offset.detect(files["mag"], **chosen.for_stage("detect"))
    return detected, com_offset.align(detected, *files.values(), **chosen.for_stage("align"))


def _solved(source, chosen, aligned, checked, variants):
    """ProductRef of the attitude; lists, by variant, of angular accelerations and of offsets of all manoeuvres."""
    satellite = catalog.satellite(source.satellite).settings()
    settings = {n: satellite[n] for n in TORQUERS_WITH_SIGMA} | chosen.for_stage("angular_acceleration")
    torquers = {n: satellite[n] for n in TORQUERS}
    smoothed = com_offset.attitude(aligned, checked, **chosen.for_stage("attitude"), **torquers)
    angular = [com_offset.angular_acceleration(smoothed, aligned, variant=one, **settings) for one in variants]
    by_variant = dict(zip(variants, angular, strict=True))
    if chosen.method == "published":
        solved = [com_offset.published_solve(aligned, smoothed, one, variant=name) for name, one in by_variant.items()]
        return smoothed, angular, solved
    pieces = com_offset.quiet(aligned, **chosen.for_stage("quiet"))
    measured, solved = com_offset.noise(pieces, **chosen.for_stage("noise")), []
    for variant, one in by_variant.items():
        resampled = com_offset.equations(aligned, smoothed, one, variant=variant, **chosen.for_stage("equations"))
        solved.append(com_offset.solve(resampled, measured, variant=variant, **chosen.for_stage("solve")))
    return smoothed, angular, solved


def with_torquers(source, chosen, aligned):
    """{stage: ProductRef} for the observations: aligned records, field, attitude, and the solution of variant "mtq"."""
    checked = com_offset.field(aligned, **chosen.for_stage("field"))
    smoothed, _, (solved,) = _solved(source, chosen, aligned, checked, ("mtq",))
    return {"align": aligned, "field": checked, "attitude": smoothed, "solve": solved}


def combined(source, chosen, aligned, moved=(), added=""):
    """ProductRef of the offset by all variants; with the errors of a model: ``moved`` results, or ``added`` JSON."""
    checked = com_offset.field(aligned, **chosen.for_stage("field"))
    return _joined(chosen, _solved(source, chosen, aligned, checked, VARIANTS)[2], moved, added)


def _joined(chosen, solved, moved, added):  # ProductRef: solutions of the variants combined, as `combined` says
    offset = com_offset.combine(*solved, **chosen.for_stage("combine"))
    if not (moved or added):
        return offset
    return com_offset.model_error(offset, *moved, added=added, **chosen.for_stage("model_error"))


def scene_settings(source, chosen):
    """Keyword settings of ``observe``: torquers and mass (kg) of the satellite, and those of the stages, by name."""
    satellite = catalog.satellite(source.satellite).settings()
    known = {n: satellite[n] for n in TORQUERS} | {"mass": float(satellite["mass_at_launch"])}
    known["period_s"] = chosen.for_stage("detect")["period_s"]
    known["drag_sigma_m_s2"] = chosen.for_stage("combine")["drag_sigma_m_s2"]
    known["linear_drift_degree"] = chosen.for_stage("discovery")["linear_drift_degree"]
    for stage in ("attitude", "quiet", "equations", "noise", "solve"):
        known |= chosen.for_stage(stage)
    return dict(sorted(known.items()))


@flow(name="com_offset_detect")
def detect(source, chosen):
    """ProductRef of the manoeuvres of one day."""
    magnetometer = common.ingest(source.file(*CALIBRATION.inputs["mag"]), event=source.event)
    return com_offset.detect(magnetometer, **chosen.for_stage("detect"))


def manoeuvres(detected):
    """{"kind": "roll", "pitch" or "yaw", "start", "stop" in GPS s} of each manoeuvre in the Dataset of `detect`."""
    columns = (detected[name].values for name in ("kind", "start", "stop"))
    for kind, start, stop in zip(*columns, strict=True):
        yield {"kind": ("roll", "pitch", "yaw")[int(kind)], "start": float(start), "stop": float(stop)}


def values(document, variant=None):
    """Offset in um of a variant (None: the adopted one) of a result document, a `results.Value` for each axis."""
    variant = variant or (document.get("adopted") or {}).get("variant")
    offset = (document.get("variants") or {}).get(variant)
    return results.vector("", "", "um", offset, ("offset_um", "sigma_um", "sigma_total_um")) if offset else ()


def recomputed(document, section, printed, _run):
    """(offset, sigma) (3,) um of a variant, of all manoeuvres or one, for a printed row of Tables 6 to 9; else None."""
    if document["event"] not in printed.events:
        return None
    blocks, variant = document["variants"], printed.labels.get("variant", "acc")
    if section == "manoeuvres":
        kind = lambda one: (one["kind"], one["latitude_class"])  # noqa: E731
        rows = [dict(one.labels) for one in catalog.published("com_offset")["manoeuvres"] if one.variant == variant]
        rows = [row["order"] for row in rows if kind(row) == kind(printed.labels)]
        alike = [one for one in document["manoeuvres"] if kind(one) == kind(printed.labels)]
        place = rows.index(printed.order)  # among those of its kind and latitude: simulated days have another order
        blocks = alike[place]["variants"] if place < len(alike) else {}
    block = blocks.get(variant)
    return block and (block["offset_um"], block["sigma_um"])


DISCOVERY = Discovery(
    scene_settings,
    "gravcal.calibrations.com_offset.observations",
    records=lambda source, chosen: _aligned(source, chosen)[1],
    products=with_torquers,
    again=1,
    result=combined,
    housekeeping=("MAS1B", "AHK1B"),
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    detect=detect,
    manoeuvres=manoeuvres,
    simulation=of_columns("gravcal.simulation.com_offset"),
    products=com_offset.KINDS,
    result=values,
    printed={"history": results.printed_vector("µm")},
    recomputed=recomputed,
    planning=simulator,
    information=lambda products: products["solve"]["information"].values,
    foretold=lambda document: values(document, "mtq"),
    truth=lambda truth: truth["offset_um"],
    discovery=DISCOVERY,
)
