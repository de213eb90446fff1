"""Antenna phase centres from Level-1 files of a pair; arguments: source a `Source`, chosen `Parameters`."""

from dataclasses import replace
from datetime import timedelta
from itertools import product

from flows.calibration import EPOCH, Calibration, Discovery, of_columns, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.io import archive
from gravcal.store import results
from tasks import common, kbr_phase_centre
from tasks.stage import lazy

simulator = lazy("gravcal.simulation.kbr_phase_centre")

OBSERVABLES = ("range", "range_rate", "range_acceleration")


@flow(name="kbr_phase_centre")
def calibrate(source, chosen):
    """ProductRef of the report: phase centres of both satellites from the wiggles (attitude manoeuvres) of one day."""
    files = ingested(source, chosen)
    recorded = kbr_phase_centre.align(*files, **chosen.for_stage("align"))
    aligned, *added = DISCOVERY.given("kbr_phase_centre", source, chosen, recorded)
    pointed, equations, quiet, solved, combined = _solved(source, chosen, aligned, OBSERVABLES, *added)
    checked = inputs_checked(source, chosen, files, aligned, pointed, equations)
    about = {"event": source.event, "settings": chosen.for_report()} | nominal_of(source)
    about["published"] = common.printed_of("kbr_phase_centre")
    return kbr_phase_centre.report(combined, pointed, quiet, checked, *solved, **about)


def with_equations(source, chosen, aligned, observables):
    """ProductRef of the pointing, and list of those of the observation equations of each observable."""
    pointed = kbr_phase_centre.pointing(aligned, **_pointing_settings(source, chosen))
    settings = chosen.for_stage("observable") | nominal_of(source)
    return pointed, [kbr_phase_centre.observable(aligned, pointed, variant=one, **settings) for one in observables]


def inputs_checked(source, chosen, files, aligned, pointed, equations):
    """ProductRef of the checks of orbits, attitudes and ranging; the first two equations: range, range rate."""
    wanted, other = CALIBRATION.inputs["orbit"]
    orbits = [one for k, one in enumerate(files) if k % 5 in (1, 2)]  # that were read, and others of the same days
    for day, letter in product(_days(source), source.satellite):
        if all(archive.find(source.folder, name, letter, day) for name in (wanted, other)):
            file = replace(source, date=day).file(other, satellite=letter)
            orbits.append(common.ingest(file, event=source.event))
    settings = nominal_of(source) | chosen.for_stage("checks")
    return kbr_phase_centre.checks(aligned, pointed, *equations[:2], *orbits, **settings)


def _solved(source, chosen, aligned, observables=OBSERVABLES, moved=(), added=""):
    """ProductRefs: pointing, [equations], noise, [solutions], and all observables combined, with errors of a model."""
    pointed, equations = with_equations(source, chosen, aligned, observables)
    quiet = kbr_phase_centre.noise(equations[0], **chosen.for_stage("noise"))
    settings = chosen.for_stage("solve") | nominal_of(source)
    pairs = zip(observables, equations, strict=True)
    solved = [kbr_phase_centre.solve(one, quiet, variant=name, **settings) for name, one in pairs]
    if observables != OBSERVABLES:
        return pointed, equations, quiet, solved, None
    combined = kbr_phase_centre.combine(*solved, **chosen.for_stage("combine"))
    if moved or added:
        combined = kbr_phase_centre.model_error(combined, *moved, added=added, **chosen.for_stage("model_error"))
    return pointed, equations, quiet, solved, combined


def of_range(source, chosen, aligned):
    """{stage: ProductRef} that the observations are built from: those of the observable range."""
    pointed, equations, quiet, solved, _ = _solved(source, chosen, aligned, OBSERVABLES[:1])
    names = ("align", "pointing", "observable", "noise", "solve")
    return dict(zip(names, (aligned, pointed, equations[0], quiet, solved[0]), strict=True))


def aligned_records(source, chosen):
    """ProductRef of ranging, orbits and attitudes on GPS time."""
    return kbr_phase_centre.align(*ingested(source, chosen), **chosen.for_stage("align"))


def scene_settings(source, chosen):
    """Keyword settings of ``observe``: stage settings, nominal phase centres (m), plausible offsets of x, y, z (mm)."""
    known = chosen.for_stage("observable") | chosen.for_stage("solve")
    names = ("orbit_degree", "crn_window_s", "crn_bandwidth_hz", "band_hz")
    known = {name: known[name] for name in names} | nominal_of(source) | {"of_noise": chosen.for_stage("noise")}
    known |= {"of_pointing": _pointing_settings(source, chosen), "of_observable": chosen.for_stage("observable")}
    x, *yz = (chosen.for_stage("report")[f"plausible_{axes}_mm"] for axes in ("x", "yz", "yz"))
    return known | {"plausible_mm": (x, *yz)}


@flow(name="kbr_phase_centre_detect")
def detect(source, chosen):
    """ProductRef of the wiggles (attitude manoeuvres) of one day in the pointing angles."""
    return kbr_phase_centre.pointing(aligned_records(source, chosen), **_pointing_settings(source, chosen))


def level_one_files(source, first="KBR1B"):
    """[LevelOneFile], five a day: ranging (product ``first`` if there), orbits and attitudes of both satellites."""
    ranging = sorted(CALIBRATION.begins, key=lambda name: name != first)
    wanted = [(ranging, archive.TOGETHER[source.satellite])]
    wanted += [(CALIBRATION.inputs[name], letter) for name in ("orbit", "sca") for letter in source.satellite]
    sources = [replace(source, date=day) for day in _days(source)]
    return [one.file(*products, satellite=letter) for one in sources for products, letter in wanted]


def ingested(source, chosen):
    """[ProductRef] of the files of `level_one_files`, ingested."""
    return [common.ingest(file, event=source.event) for file in level_one_files(source, chosen.ranging)]


def _days(source):
    """Days YYYY-MM-DD of a source: those of its event in the catalogue, and of its manoeuvres; without date all."""
    files, letter = archive.inventory(source.folder), archive.TOGETHER[source.satellite]
    there = sorted({one.date for one in files if one.product in CALIBRATION.begins and one.satellite == letter})
    if not source.date:
        return there
    known = _known(source.event)
    spans = [second for one in (known.found if known else ()) for second in (one.start, one.stop)]
    days = {source.date} | {(EPOCH + timedelta(seconds=second)).date().isoformat() for second in spans}
    last = str(known.end_date) if known else source.date
    return [day for day in there if day in days or source.date <= day <= last] or [source.date]


def _known(event):  # Event of this calibration in the catalogue, or None
    known = catalog.event(event) if event in catalog.names("events") else None
    return known if known and known.calibration == "kbr_phase_centre" else None


def _pointing_settings(source, chosen):
    """Settings of the pointing stage; "given": (satellite, axis, sign, start, stop GPS s) of catalogued manoeuvres."""
    wiggles, known = [], _known(source.event)
    for one in known.found if known else ():
        axis = ("pitch", "yaw").index(one.kind.lstrip("+-"))
        sign = {"+": 1, "-": -1}.get(one.kind[0], 0)
        letters = one.satellite or known.letters
        wiggles += [(source.satellite.index(letter), axis, sign, one.start, one.stop) for letter in letters]
    return chosen.for_stage("pointing") | nominal_of(source) | {"given": tuple(wiggles)}


def nominal_of(source):
    """Setting {"nominal_m": (2, 3) m}: centre of mass to phase centre of both satellites, from the catalogue."""
    centres = [catalog.satellite(letter).com_to_antenna.value for letter in source.satellite]
    return {"nominal_m": tuple(tuple(float(v) for v in centre) for centre in centres)}


def manoeuvres(pointed):
    """{"satellite", "kind": "+pitch", ..., "start", "stop" in GPS s} of each wiggle in the Dataset of `detect`."""
    letters, axes = pointed.attrs["satellites"], ("pitch", "yaw")
    columns = [pointed[name].values for name in ("satellite_index", "axis_index", "sign", "start", "stop")]
    for number, axis, sign, start, stop in zip(*columns, strict=True):
        kind = ("", "+", "-")[sign] + axes[axis]
        yield {"satellite": letters[number], "kind": kind, "start": float(start), "stop": float(stop)}


def values(document):
    """`results.Value` in mm of x, y, z of each satellite: the adopted phase centre of a result document."""
    for letter, block in ((document.get("adopted") or {}).get("satellites") or {}).items():
        yield from results.vector(letter, "", "mm", block, ("phase_centre_mm", "sigma_mm", "sigma_total_mm"))


def recomputed(document, section, printed, run):
    """(values, sigmas) for a printed row: component (mm) of Tables 4 to 6, vector (mm, um, um) of Table 7; or None."""
    letter = printed.satellite[-1].upper()
    if section == "vkb1b":
        if not printed.solution.startswith("paper_2020"):
            return None
        own = document["satellites"].get(letter, {}).get("range_acceleration", {}).get("robust")
        fit = own if run == "as_printed" else document["adopted"]["satellites"].get(letter)
        unit, axes = (1, 1e3, 1e3), (0, 1, 2)
    elif printed.component == "bias":
        return None
    else:
        estimator = "robust" if section == "robust" else "ls"
        fit = document["subsets"].get(printed.labels.get("subset"), {}).get(printed.observable, {}).get(letter)
        if section != "subsets":
            fit = document["satellites"].get(letter, {}).get(printed.observable, {}).get(estimator)
        unit, axes = (1,), ("xyz".index(printed.component),)
    names = ("phase_centre_mm", "sigma_mm")
    get = lambda key: [None if fit[key][k] is None else f * fit[key][k] for f, k in zip(unit, axes)]  # noqa: B905, E731
    return fit and tuple(get(key) for key in names)


DISCOVERY = Discovery(
    scene_settings,
    "gravcal.calibrations.kbr_phase_centre.observations",
    records=aligned_records,
    again=1,
    products=of_range,
    result=lambda source, chosen, aligned, *added: _solved(source, chosen, aligned, OBSERVABLES, *added)[-1],
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    detect=detect,
    manoeuvres=manoeuvres,
    simulation=of_columns("gravcal.simulation.kbr_phase_centre"),
    level_one_files=level_one_files,
    products=kbr_phase_centre.KINDS,
    result=values,
    recomputed=recomputed,
    printed={"vkb1b": results.printed_vector("mm")},
    planning=simulator,
    foretold=values,
    truth=lambda truth: sum(truth["phase_centre_mm"].values(), []),
    discovery=DISCOVERY,
)
