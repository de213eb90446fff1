"""Work of the commands, without reading arguments and without printing."""

import collections
import difflib
import functools
import shutil
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path

import typer

from flows import engine, output
from flows.calibration import Calibration, known, load, load_all, model_text
from gravcal import catalog
from gravcal.errors import CatalogError, GravcalError, NoDataError, ProductError, refuse
from gravcal.io import archive
from gravcal.store import configurations, history, keys, location, product, store
from gravcal.store.schemas import VERSION
from tasks.stage import lazy

comparison = lazy("gravcal.report.comparison")
discoveries = lazy("flows.discover")
plain = lazy("gravcal.report.plain")
timeline = lazy("gravcal.browse.timeline")
vcm = lazy("gravcal.io.vcm")

EXIT = {"delivered": 0, "failed": 1, "no_manoeuvre": 3, "no_data": 3, "questionable": 4}


def record(calibration):
    """Record of a calibration; an unknown name is wrong usage."""
    names = known()
    if calibration not in names:
        near = difflib.get_close_matches(calibration, names, 1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise typer.BadParameter(f"no calibration {calibration!r}; there is {', '.join(names)}.{hint}")
    return load(calibration)


def chosen(calibration, settings, model=None, name=None):
    """Parameters of the operational configuration, or of an experiment: recorded, or with KEY=VALUE and model file."""
    record(calibration)
    return configured(calibration, settings, model, name)


def configured(calibration, settings, model=None, name=None):
    """Parameters as of `chosen`, of anything with a file in catalog/parameters: also a simulation or a study."""
    values = pairs(settings)
    if model or values.get("model"):
        values["model"] = model_text(model or values["model"])
    try:
        return configurations.chosen(calibration, values, name)
    except CatalogError as error:
        if any(one in str(error) for one in pairs(settings)) and "configuration" not in error.facts:
            raise typer.BadParameter(f"--set: {error}") from error
        raise


def pairs(texts):
    """{key: value}, both texts, of "key=value" texts (None: {}); a text without "=" is wrong usage."""
    values = {}
    for text in texts or []:
        key, equals, value = text.partition("=")
        if not (key and equals):
            raise typer.BadParameter(f"{text!r}: expected KEY=VALUE")
        values[key.strip()] = value
    return values


def source(calibration, event, data, satellite, date):
    """Source of one event: of the catalogue by its name, or in a folder (data) of a satellite and day, if stated."""
    if (event is None) == (data is None):
        raise typer.BadParameter("give an EVENT of the catalogue or a folder with --data, one of the two")
    if event is not None and event not in catalog.names("events") and Path(event).is_dir():
        raise typer.BadParameter(f"{event} is a folder and no event; give it as --data {event}")
    if event is not None and (satellite or date):
        raise typer.BadParameter("--satellite and --date belong to --data; an EVENT says them itself")
    one = record(calibration)
    check_satellite(calibration, satellite, one.satellites)
    try:
        made = one.source(event=event, data=data, satellite=satellite, date=date)
    except ProductError:
        if data is not None and data.is_dir():
            check_folder(calibration, data)
        raise
    days, own = one.days(data) if data else (), [getattr(made, name, "") for name in ("satellite", "date")]
    if len(folders := [str(folder) for folder, *day in days if day == own]) > 1:
        refuse(data, f"this day in {' and '.join(folders)}", "it in one folder alone", "Give one of them as --data.")
    return made


def check_satellite(calibration, satellite, known):
    """Raise unless letters are those of a calibration's satellites: anything else is wrong usage."""
    if satellite is not None and satellite not in known:
        raise typer.BadParameter(f"--satellite {satellite}: expected {' or '.join(known)} for {calibration}")


def check_folder(calibration, data):
    """Raise where a folder holds none of the files that an event of a calibration begins with.

    The message names the products that there are, and the calibrations that read them.
    """
    installed = load_all()
    inventories = {id(one.files): one.files for one in installed.values()}.values()
    products = sorted({file.product for kind in inventories for file in kind.inventory(data)})
    wanted = installed[calibration].begins
    if set(products) & set(wanted):
        return
    others = [name for name, one in installed.items() if set(products) & set(one.begins)]
    named = " and ".join([", ".join(others[:-1]), others[-1]] if others[1:] else others)
    reads = f" (files of {named})" if others else ""
    remedy = "Run one of these on it, or give another --data." if others else "Check --data."
    there, expected = f"{', '.join(products) or 'no Level-1 file'}{reads}", f"{' or '.join(wanted)} for {calibration}"
    refuse(data, there, expected, remedy, ProductError if products else NoDataError)


def made(body, source, chosen, engine_name):
    """ProductRef that a flow returns for one event; a terminal shows the stages done."""
    with output.progress(body.flow_name) as listener:
        return engine.run(body, source, chosen, engine=engine_name, listener=listener)


def check_searched(calibration, studies=()):
    """Raise BadParameter unless a calibration has a discovery, or is the name of a study."""
    names = [*discoveries.names(), *studies]
    if calibration not in names:
        raise typer.BadParameter(f"no discovery for {calibration!r} yet; there is {', '.join(names)}")


def plan(calibration, sources, chosen):
    """Steps of a plan as dicts: event, stage, action, reasons, and the seconds that it took the last time."""
    usual, flow, rows = functools.cache(history.usual_seconds), record(calibration).flow, []
    for one in (step for source in sources for step in engine.plan(flow, source, chosen)[0]):
        event = None if one.reasons == ("never made",) else one.event
        row = {"event": one.event, "stage": one.stage, "action": one.action, "reasons": list(one.reasons)}
        rows.append(row | {"seconds": None if one.action == "reuse" else usual(one.stage, event)})
    return rows


def sources(calibration, event, data, satellite, date):
    """[Source] of the event or folder stated, of each day of a folder, or of all events of the store if neither is."""
    if event is not None or data is not None:
        try:
            return [source(calibration, event, data, satellite, date)]
        except ProductError:
            if date is not None or data is None or not data.is_dir() or len(record(calibration).days(data)) < 2:
                raise
        candidates = many_sources(calibration, satellite, data)
        for one in (one for one in candidates if isinstance(one, Refused)):
            engine.warn(f"{one.event} left out: {one.error}")
        return [one for one in candidates if not isinstance(one, Refused)]
    one, made = record(calibration), []
    folders = history.level_one_folders(calibration)
    if not folders:
        where, missing = f"product store {location.folder()}", f"no event of {calibration} that was ever run"
        refuse(where, missing, "one", "Give an EVENT or --data DIR.")
    for event_, folder, letters, day in folders:
        try:
            made.append(replace(one.source(data=folder, satellite=letters, date=day), event=event_))
        except GravcalError as error:  # its files are no more
            engine.warn(f"{event_} left out: {error}")
    return made


@dataclass(frozen=True)
class Refused:
    """Takes the place of a `Source` where an event has none: its name, error message and status."""

    event: str
    error: str
    status: str = "failed"


def many_sources(calibration, satellite, data):
    """[Source or Refused] of each event of a folder, or of the catalogue if that is None; of one satellite if named."""
    one = record(calibration)
    check_satellite(calibration, satellite, [*one.satellites, "".join(one.satellites)])
    if data is not None:
        if not data.is_dir():
            refuse(data, "no folder", "one with Level-1 files", "Give the folder with --data.")
        days = [day for day in one.days(data) if satellite is None or set(satellite) & set(day[1])]
        if not days:
            check_folder(calibration, data)
            whose = f" of satellite {satellite}" if satellite else ""
            refuse(data, f"no Level-1 file that begins an event{whose}", "one", "Give another folder.")
        made = [_source(one, None, data=folder, satellite=letters, date=date) for folder, letters, date in days]
        counts = collections.Counter(source.event for source in made)
        twice = "found files of this day, expected them in one folder alone. Give --data one of the folders."
        refused = lambda source, folder: Refused(source.event, f"{folder}: {twice}")  # noqa: E731
        return [s if counts[s.event] == 1 else refused(s, day[0]) for s, day in zip(made, days, strict=True)]
    known_events = catalog.events(calibration=calibration)
    names = [event.name for event in known_events if satellite is None or set(satellite) & set(event.letters)]
    return [_source(one, name, data=None, satellite=None, date=None) for name in names]


def _source(calibration: Calibration, event, **where):
    """Source of one event (None: of the folder in ``where``), or Refused with the reason, for tables of failures."""
    try:
        return calibration.source(event=event, **where)
    except GravcalError as error:
        name = event or "-".join(str(where[part]) for part in ("satellite", "date") if where[part])
        return Refused(name, str(error), status_of(error))


def detect(calibration, source, chosen):
    """{"event", "origin", "manoeuvres": [{"kind", "start", "stop"} in GPS s]} of the data of a source."""
    one = record(calibration)
    if one.detect is None:
        raise CatalogError(f"{source.event}: {calibration} uses the whole record, there is nothing to detect. Use run.")
    return one.detected(made(one.detect, source, chosen, "inline"))


def simulate(calibration, out, seed, truth, effects, settings):
    """Write the Level-1 files of a simulated event; its truth as a dict, also in the file ``truth`` if given."""
    try:
        strengths = {name: float(value) for name, value in pairs(effects).items()}
    except ValueError as error:
        raise typer.BadParameter(f"--effect: {error}; expected SLUG.PARAMETER=NUMBER") from error
    how = {"seed": seed, "truth": truth, "effects": strengths, "settings": pairs(settings)}
    try:
        with output.progress(f"simulating {calibration}"):
            return record(calibration).simulate(out, **how)
    except CatalogError as error:
        raise typer.BadParameter(str(error)) from error


def report_files(event, out, name=None):
    """Files of the last report of an event, operational or of an experiment, copied to a folder if one is given."""
    links, latest = [*store.links("*/*report"), *store.links("*/as/*/*report")], location.folder() / "latest"
    of_event = [(link, folder) for link, folder in links if link.parent == location.links(event, name)]
    reports = [(link, store.read_record(folder)) for link, folder in of_event if store.find(folder.name)]
    if not reports:
        others = sorted(path.name for path in (location.links(event) / "as").glob("*"))
        if others or name:
            there = f"; experiments there: {', '.join(others)} (--as NAME)" if others else ""
            whose = f"experiment {name}" if name else "operational configuration"
            raise ProductError(f"event {event}: there is no report of the {whose} in {location.folder()}{there}.")
        reported = {link.relative_to(latest).parts[0] for link, _ in links} - {event}
        similar = difflib.get_close_matches(event, reported, 3)
        hint = f" Did you mean {', '.join(similar)}?" if similar else ""
        raise ProductError(f"event {event}: there is no report in {location.folder()}.{hint} Make it with gravcal run.")
    files = [link / name for link, record in reports for name in sorted([*record["files"], "product.nc"])]
    if out is None:
        return files
    made = [out / (path.parent.name if reports[1:] else "") / path.name for path in files]  # calibrations share events
    for path, copied in zip(files, made, strict=True):
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copied)
    return made


def compare(calibration, first, second, satellite=None):
    """Comparison document (`comparison.between`) of two configurations by name, for the events that both have."""
    one = record(calibration)
    check_satellite(calibration, satellite, [*one.satellites, "".join(one.satellites), *"".join(one.satellites)])
    for name in (first, second):
        configurations.settings_of(calibration, name)
    wanted = lambda event: satellite is None or bool(set(satellite) & set(timeline.letters_of(event)))  # noqa: E731
    document = comparison.between(one, (first, second), wanted)
    if not document["events"]:
        counts = " and ".join(f"{len(events)} events of {name}" for name, events in document["only_in"].items())
        remedy = f"Run the one that is missing: gravcal campaign {calibration} --as NAME."
        refuse(calibration, f"{counts} and none of both in {location.folder()}", "one", remedy)
    return document


def sequence(path, *, save=False):
    """{"events": CMCAL and KBRCAL sessions of a sequence-of-events file, "in_force": its last VCM and VKB entries}.

    A day of a satellite is one event. What the catalogue knows already is not saved; events without begin or end,
    and those of satellites that the calibration cannot take, are listed ("state") but not saved.
    """
    entries, rows, by_event = vcm.read_sequence(path), [], {}
    for one in vcm.sessions(entries):
        bounds = [bound for bound in (one.start, one.stop) if bound is not None]
        days = [date(2000, 1, 1) + timedelta(days=int((bound + 43200) // 86400)) for bound in bounds]
        name = f"{catalog.satellite(one.satellite).name}-{days[0]}"
        row = vars(one) | {"event": name, "state": "new"}
        if one.start is None or one.stop is None:
            row["state"] = "no begin" if one.start is None else "no end"
        elif not any(one.satellite in letters for letters in record(one.calibration).satellites):
            row["state"] = f"{one.calibration} takes no {one.satellite}"
        elif name in catalog.names("events"):
            row["state"] = "in the catalogue" if catalog.event(name).calibration == one.calibration else "name taken"
        elif any(saved == name and calibration != one.calibration for calibration, saved in by_event):
            row["state"] = "name taken"
        else:
            by_event.setdefault((one.calibration, name), []).append((row, days))
        rows.append(row)
    for (calibration, name), sessions in by_event.items() if save else ():
        design, letter = record(calibration).design, sessions[0][0]["satellite"]
        design = f"{design}_grace" if letter in "AB" and f"{design}_grace" in catalog.names("designs") else design
        bounds = ", ".join(f"{row['start']:.0f} to {row['stop']:.0f}" for row, _ in sessions)
        text = catalog.event_text(
            calibration, design, (letter,), sessions[0][1][0], [], {},
            source=f"sequence-of-events file, GPS seconds {bounds}", last=max(days[-1] for _, days in sessions),
        )  # fmt: skip
        catalog.save_event(name, text)
        for row, _ in sessions:
            row["state"] = "saved"
    last = [vcm.in_force(entries, name, letter, float("inf")) for name in ("VCM", "VKB") for letter in "ABCD"]
    return {"events": rows, "in_force": [vars(one) for one in last if one]}


def status_of(error):
    """Status of an event that ended with an error: "no_data" where there are no files of it, otherwise "failed"."""
    return "no_data" if isinstance(error, NoDataError) else "failed"


def origin_of(source):
    """Origin ("measured", "simulated", ...) of the files of a Source without result, or of an event or folder (str)."""
    event, folder = [source] * 2 if isinstance(source, str) else (source.event, getattr(source, "folder", None))
    stated = catalog.event_origin(event)
    from_files = bool(folder) and not stated and Path(folder).is_dir()
    return archive.origin_below(folder, getattr(source, "date", None)) if from_files else stated or product.MEASURED


def failed(calibration, source, error, configuration=location.OPERATIONAL):
    """Result document of a run that failed; source: a Source, or text that names event or folder."""
    return {
        "schema_version": VERSION,
        "status": status_of(error),
        "calibration": calibration,
        "event": source if isinstance(source, str) else getattr(source, "event", None),
        "origin": origin_of(source),
        "configuration": configuration,
        "checks": [],
        "error": {
            "kind": type(error).__name__,
            "message": str(error),
            "facts": plain.as_plain(getattr(error, "facts", {})),
        },
        "provenance": {"gravcal": keys.versions()["gravcal"]},
    }
