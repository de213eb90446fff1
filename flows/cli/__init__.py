"""The command line: `gravcal`.

Commands only read their arguments, call a flow or the store, and say what came out. What belongs to one calibration
is asked of its record (`flows.calibration`).
"""

import contextlib
import datetime
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from flows import command, output
from flows.calibration import load_all
from flows.cli import stored
from flows.cli.options import (
    KINDS,
    LETTERS,
    As,
    Calibration,
    Data,
    Date,
    Effects,
    Engine,
    EventName,
    Json,
    Model,
    RemakeVersions,
    Satellite,
    Seed,
    Settings,
    complete_calibrations,
    complete_events,
    json_option,
    writable,
)
from flows.engine import single_threaded
from gravcal.errors import GravcalError

HELP = """
In-orbit calibration of gravity missions: Level-1 files in, calibration values with honest errors out.

\b
gravcal demo                                          simulate a calibration day, process it, compare with the truth
gravcal fetch grace-c-2020-02-01 --out DIR            Level-1 archives of an event, from the official archives
gravcal run com_offset --data DIR --satellite C       calibrate: any folder of Level-1 files, or an event's name
gravcal run com_offset EVENT --set lowpass_hz=0.3     only what depends on the setting is made again
gravcal plan com_offset EVENT --set lowpass_hz=0.3    what would be made again, and why
gravcal run com_offset EVENT --as NAME                a what-if beside the delivery; settings, compare, promote
gravcal campaign com_offset --data DIR                every event of a folder, in parallel
gravcal discover com_offset EVENT                     what the simulation gets wrong, the cause, the gain
gravcal design com_offset --satellite C --date DAY    the manoeuvres of the next session
gravcal reproduce com_offset --out DIR                the source paper again, as printed and as corrected
gravcal report EVENT                                  where the report is
gravcal export EVENT                                  all of an event in one zip, with what to cite
gravcal results --out results.csv                     every delivered value, with links
gravcal browse                                        events, plots, comparisons and reports in a web browser
gravcal products                                      what lies in the store (GRAVCAL_PRODUCTS)
"""
DEFAULT = "com_offset"  # calibration of demo and serve
LAST = "event whose last report is wanted"
SHOWN = "also from which size on each effect of the catalogue would have been named in this event"
PAGE = "copy of the page"
JOINT = "search all events of a satellite together: causes with their scope, and how the result moves"
DAYS = "folders of days, or one with many: which causes repeat, with their values"
THESE = "with --joint: only these"
WORKERS = "processes here; 0: none but this"
FLOWN = "design of the catalogue, or plan.toml of gravcal design, that is flown"
APART = "causes that the session is to tell apart (gravcal effects)"
BUDGET = "of manoeuvres in all, without: as many as the published session"
CONSTRAINTS = "TOML with limits; a name that is not one says which there are"
VERIFY = "flights of the design that are simulated and calibrated, to compare errors with those predicted"
WHAT = f"{KINDS}, or printed numbers: published_table"
MANY = "folder with Level-1 files of many days, or with one folder per event"
SERVED = "reprocess the events of this folder; otherwise those of the catalogue, with their files in GRAVCAL_DATA"
PAPER = "com_offset, kbr_phase_centre, inertial_sensor or gradient_torque: its source"
PART = "noLRI, LRI, ACX, ACX2, MAG (magnetometer as calibrated by GFZ), SOE (sequence of events)"
HOST = "address to listen on; the token in the address printed is asked for everywhere"
PRUNE = "after a run by the clock remove what nothing refers to and is older"
QUOTA = "and of the rest the oldest, until the store has less"

app = typer.Typer(help=HELP, rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)


@contextlib.contextmanager
def _failures(calibration, source, json_path, configuration):
    """Write a document with status "failed" before an error goes on."""
    try:
        yield
    except GravcalError as problem:
        output.write_json(command.failed(calibration, source, problem, configuration), json_path)
        raise


def _prepared(calibration, event, data, satellite, date, settings, model, as_, json):
    """Source and parameters of one event; where there is none, the document says so."""
    chosen = command.chosen(calibration, settings, model, as_)
    with _failures(calibration, event or str(data), json, chosen.configuration):
        source = command.source(calibration, event, data, satellite, date)
        return source, command.recorded(chosen)


@app.command()
def run(
    calibration: Calibration,
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
) -> None:
    """Calibrate one event; what is in the store already is reused. With --set or --model: an experiment beside it."""
    source, chosen = _prepared(calibration, event, data, satellite, date, settings, model, as_, json)
    with _failures(calibration, source, json, chosen.configuration):
        document, ref = command.calibrate(calibration, source, chosen, engine)
    output.result(document, ref, json)
    raise typer.Exit(command.EXIT.get(document.get("status"), 1))


@app.command()
def plan(
    calibration: Calibration,
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    every: Annotated[bool, typer.Option("--all", help="each product, also those that are reused")] = False,
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
) -> None:
    """Say what a run or campaign would make again, why and how long; without EVENT or folder for all of the store."""
    chosen = command.chosen(calibration, settings, model, as_)
    sources = command.sources(calibration, event, data, satellite, date)
    steps = [step for source in sources for step in command.plan(calibration, source, chosen)]
    output.plan(command.timed(steps), json, every)


@app.command()
def detect(
    calibration: Calibration,
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    json: Json = None,
    save: Annotated[
        bool, typer.Option("--save", help="store the event in your own catalogue, GRAVCAL_CATALOG")
    ] = False,
) -> None:
    """Find the manoeuvres in the data of an event or folder."""
    chosen = command.recorded(command.chosen(calibration, settings))
    source = command.source(calibration, event, data, satellite, date)
    document = command.detect(calibration, source, chosen)
    output.manoeuvres(document, json)
    if save:
        output.say(f"stored as event {command.save_event(calibration, source, document)}")
    raise typer.Exit(0 if document["manoeuvres"] else 3)


@app.command()
def discover(
    calibration: Annotated[str, typer.Argument(metavar="CALIBRATION", help=WHAT, autocompletion=complete_calibrations)],
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    limits: Annotated[bool, typer.Option("--limits", help=SHOWN)] = False,
    joint: Annotated[bool, typer.Option("--joint", help=JOINT)] = False,
    events: Annotated[str, typer.Option("--events", metavar="EVENT,EVENT", help=THESE)] = "",
    days: Annotated[str, typer.Option("--days", metavar="DIR,DIR", help=DAYS)] = "",
    workers: Annotated[int | None, typer.Option("--workers", help=WORKERS)] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help=PAGE, callback=writable)] = None,
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
) -> None:
    """Show what the simulation of an event gets wrong, name the cause, extend the model and measure the gain."""
    from flows import discover

    calibration = discover.ALIASES.get(calibration, calibration)
    if joint or days:
        if event or date or limits or (days and (data or joint)):
            raise typer.BadParameter("--joint takes --satellite, --data and --events; --days folders and --satellite")
        folders = [Path(one) for one in days.split(",")] if days else data and [data]
        if not days and satellite is None:
            raise typer.BadParameter("--joint: expected --satellite, that of the events, or those of both")
        _joint(calibration, satellite, folders, (settings, model, as_), events, str(engine), workers, out, json)
        return
    study = discover.STUDIES.get(calibration)
    if study is None:
        source, chosen = _prepared(calibration, event, data, satellite, date, settings, model, as_, json)
    elif event or data or satellite or date or model:
        raise typer.BadParameter(f"{calibration} is a study of printed numbers: it takes no event, folder or model")
    else:
        source, chosen = study, command.recorded(command.configured(calibration, settings, None, as_))
    with _failures(calibration, source, json, chosen.configuration):
        document, files = command.discover(calibration, source, chosen, engine, limits)
    files += [shutil.copy(path, out) for path in files if out and path.name == "discovery.html"]
    output.discovery(document, files, json)
    raise typer.Exit(command.EXIT.get(document.get("status"), 1))


def _joint(calibration, satellite, data, given, events, engine, workers, out, json):
    """Search many events together, and say what that found and what has changed since the last time."""
    from flows import joint

    command.searched(calibration)
    chosen = command.recorded(command.chosen(calibration, *given))
    named = [one.strip() for one in events.split(",") if one.strip()]
    found = joint.joint(calibration, satellite, data, chosen, named, engine=engine, workers=workers)
    for document, files, _ in found if out else ():
        named = out.with_stem(f"{out.stem}-{document['satellite']}") if len(found) > 1 else out
        shutil.copy(next(path for path in files if path.name == "joint.html"), named)
    output.joint(found, json)


@app.command()
def watch(
    calibration: Calibration = DEFAULT,
    satellite: Satellite = ...,
    data: Data = None,
    settings: Settings = None,
    workers: Annotated[int | None, typer.Option("--workers", help=WORKERS)] = None,
    json: Json = None,
) -> None:
    """Update the joint model of a satellite with new events, and say what changed beyond its error."""
    _joint(calibration, satellite, data and [data], (settings,), "", "inline", workers, None, json)


@app.command()
def simulate(
    calibration: Calibration,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder for the Level-1 files")],
    seed: Seed = 1,
    truth: Annotated[Path | None, typer.Option("--truth", metavar="FILE", help="where to write the truth")] = None,
    effect: Effects = None,
    settings: Settings = None,
    planned: Annotated[str | None, typer.Option("--design", metavar="NAME|FILE", help=FLOWN)] = None,
    json: Json = None,
) -> None:
    """Write the Level-1 files of an invented event; the truth goes to a file of its own that no run reads."""
    settings = [*(settings or []), *([f"design={planned}"] if planned else [])]
    made = command.simulate(calibration, out, (seed, truth), effect, settings)
    files = sorted(str(path) for path in out.iterdir() if path.is_file())
    whose = {name: made[name] for name in ("satellite", "date") if made.get(name)}
    run = shlex.join(["gravcal", "run", calibration, "--data", str(out), *(f"--{n}={v}" for n, v in whose.items())])
    document = {"calibration": calibration, "folder": str(out), "seed": seed, "files": files, "run": run}
    if output.delivered(document, json):
        kinds = ", ".join(dict.fromkeys(Path(one).name.partition("_")[0] for one in files))
        size = sum(Path(one).stat().st_size for one in files) / 1e6
        said = f"{len(files)} Level-1 files of an invented event ({' '.join(whose.values())}) in {out}, {size:.1f} MB"
        output.say(f"{said}: {kinds}" + (f"\ntruth in {truth}; no run reads it" if truth else ""))
        output.say(f"calibrate: {run}")


@app.command()
def design(
    calibration: Calibration,
    satellite: Annotated[str, typer.Option("--satellite", metavar=LETTERS)] = ...,
    date: Date = ...,
    separate: Annotated[str, typer.Option("--separate", metavar="CAUSE,CAUSE", help=APART)] = "",
    budget: Annotated[float | None, typer.Option("--budget", metavar="MINUTES", help=BUDGET)] = None,
    constraints: Annotated[Path | None, typer.Option("--constraints", metavar="FILE", help=CONSTRAINTS)] = None,
    verify: Annotated[int, typer.Option("--verify", metavar="N", min=0, help=VERIFY)] = 0,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="plan.toml and design.json")] = None,
    json: Json = None,
) -> None:
    """Propose the manoeuvres of the next session: those that make the result best known and causes separable."""
    from flows import design
    from gravcal.store import location

    command.check_satellite(calibration, satellite, command.record(calibration).satellites)
    causes = [one.strip() for one in separate.split(",") if one.strip()]
    limits = design.constraints(calibration, constraints)
    wanted = {"causes": causes, "minutes": budget, "limits": limits, "verify": verify, "out": out}
    document = design.designed(calibration, satellite, date, **wanted, say=output.note)
    location.write_json(location.folder() / "designs" / f"{calibration}-{satellite}-{date}.json", document)
    output.design(document, out, json)


@app.command()
def demo(
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="keep the Level-1 files here")] = None,
    seed: Seed = 1,
    engine: Engine = "prefect",
    json: Json = None,
) -> None:
    """Simulate a calibration day, process it as if it were measured, and print estimate beside truth."""
    document, ref, truth = command.demo(DEFAULT, out, seed, engine)
    output.result(document, ref, json, truth)
    raise typer.Exit(command.EXIT.get(document.get("status"), 1))


@app.command()
def report(
    event: Annotated[str, typer.Argument(metavar="EVENT", help=LAST, autocompletion=complete_events)],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="copy the report's files here")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment")] = None,
    json: Json = None,
) -> None:
    """Say where the last report of an event is, or copy it."""
    files = [str(path) for path in command.report_files(event, out, as_)]
    if output.delivered({"event": event, "files": files}, json):
        output.say("\n".join(files))


@app.command()
def browse(
    port: Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="0: any that is free")] = 8765,
    host: Annotated[str, typer.Option("--host", metavar="ADDRESS", help=HOST)] = "127.0.0.1",
) -> None:
    """Show products, plots, comparisons and reports in a web browser; reads only, until it is ended with Ctrl-C."""
    try:
        from gravcal.browse import app
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"browse needs {error.name}, which is not installed; pip install 'gravcal[browse]'"
        ) from error
    app.serve(load_all(), app.bound(host, port), host, output.say_at_once)


@app.command()
def campaign(
    calibration: Calibration,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar=LETTERS)] = None,
    data: Annotated[Path | None, typer.Option("--data", metavar="DIR", help=MANY)] = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    scheduler: Annotated[str | None, typer.Option("--scheduler", metavar="tls://HOST:PORT")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help=WORKERS)] = None,
    only_failed: Annotated[bool, typer.Option("--only-failed", help="try again what failed the last time")] = False,
    search: Annotated[bool, typer.Option("--discover", help="search each event, as gravcal discover does")] = False,
    limits: Annotated[bool, typer.Option("--limits", help="the same, with the detection limits of each")] = False,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
    json: Annotated[Path | None, json_option("summary")] = None,
) -> None:
    """Calibrate all events of a satellite, in parallel; a failed event is tabulated and stops no other."""
    from flows import campaign

    chosen = command.chosen(calibration, settings, model, as_)
    sources = campaign.sources(calibration, satellite, data)
    command.recorded(chosen)
    if search or limits:
        command.searched(calibration)
    wanted = "limits" if limits else "discover" if search else ""
    how = campaign.Campaign(calibration, chosen, str(engine), scheduler, workers, again=only_failed, search=wanted)
    if only_failed:
        sources = campaign.failed_last(how, sources)
        if not sources and output.to_screen(json):
            output.say("nothing failed the last time")
    with output.events_progress(len(sources)) as listener:
        summary = campaign.run(how, sources, listener)
    output.campaign(summary, json)
    raise typer.Exit(campaign.exit_code(summary))


@app.command()
def fetch(
    event: Annotated[str | None, typer.Argument(metavar="[EVENT]", help="event of the catalogue")] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder for the archives")] = ...,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar="C|D|CD|A|B|AB")] = None,
    date: Date = None,
    place: Annotated[
        str, typer.Option("--from", metavar="podaac|isdc|URL", help="isdc needs no login, podaac that of Earthdata")
    ] = "isdc",
    part: Annotated[str, typer.Option("--part", metavar="PART,PART", help=PART)] = "noLRI",
    release: Annotated[str | None, typer.Option("--release", metavar="02|03|04|0201", help="of a day")] = None,
    dry: Annotated[bool, typer.Option("--dry-run", help="only print the addresses, and where they were read")] = False,
    json: Annotated[Path | None, json_option("list")] = None,
) -> None:
    """Fetch the daily archives of an event or day; what broke off is resumed, what is there is kept."""
    from gravcal import catalog
    from gravcal.io import fetch as fetching

    if (event is None) == (satellite is None or date is None) or (event and (satellite or date)):
        raise typer.BadParameter("give an EVENT of the catalogue, or --satellite and --date")
    if not event and satellite not in ("A", "B", "AB", "C", "D", "CD"):
        raise typer.BadParameter(f"--satellite {satellite}: expected A, B, AB, C, D or CD")
    day = None if event else datetime.date.fromisoformat(date)
    if event:
        archives = fetching.of_event(catalog.event(event))
    else:
        archives = fetching.of_day(satellite, day, part.split(","), release)
    if dry:
        rows = [{"address": fetching.addresses(one, place)[0], "read": one.layout["read"]} for one in archives]
        if output.delivered(rows, json):
            output.say("\n".join(f"{row['address']}\n    {row['read']}" for row in rows))
        return
    with output.bytes_progress() as listener:
        output.note(f"asking {place.rpartition('@')[2]} for {len(archives)} archive(s), from {archives[0].name} on")
        fetched = fetching.fetch(archives, out, place, listener, fetching.Patience(tell=output.note))
    names = ("path", "state", "checked", "size")
    rows = [{name: getattr(one, name) for name in names} | {"path": str(one.path)} for one in fetched]
    if output.delivered(rows, json):
        output.table(["archive", "state", "checked by", "bytes"], [[row[name] for name in names] for row in rows])


@app.command()
def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help=PAPER)],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="page, tables, both reports, data, store")] = ...,
    place: Annotated[str, typer.Option("--from", metavar="podaac|isdc|URL", help="archive of the days")] = "isdc",
    data: Data = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="simulated days of the same dates")] = False,
    json: Json = None,
) -> None:
    """Process the days of a source paper as printed and as corrected, beside its tables and figures."""
    from flows import reproduce

    if paper not in reproduce.papers():
        raise typer.BadParameter(f"no paper {paper!r}; there is {', '.join(reproduce.papers())}")
    with output.bytes_progress() as listener:
        how = {"place": place, "data": data, "simulated": simulated, "listener": listener, "tell": output.note}
        document = reproduce.reproduce(paper, out, **how)
    if output.delivered(document, json):
        rows = [[i["name"], len(i["rows"]), i.get("reason") or i["difference"]] for i in document["items"]]
        output.table(["item", "rows", "what differs, or why it is not made"], rows)
        output.say(f"{document['origin']} days {', '.join(document['days'])}; {out / 'index.html'}")
    raise typer.Exit(command.EXIT.get(document["status"], 1))


@app.command()
def serve(
    calibration: Annotated[str, typer.Argument(metavar="[CALIBRATION]", help=KINDS)] = DEFAULT,
    cron: Annotated[
        str, typer.Option("--cron", metavar="'M H D M W'", help="when to reprocess all, UTC")
    ] = "0 3 * * *",
    watched: Annotated[Path | None, typer.Option("--watch", metavar="DIR", help="run when new data are here")] = None,
    every_s: Annotated[float, typer.Option("--every", metavar="SECONDS", min=0.1, help="between two looks")] = 60.0,
    data: Annotated[Path | None, typer.Option("--data", metavar="DIR", help=SERVED)] = None,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar=LETTERS)] = None,
    settings: Settings = None,
    workers: Annotated[int | None, typer.Option("--workers", help="processes here; 0: one, without Dask")] = None,
    joint: Annotated[bool, typer.Option("--joint/--no-joint", help=JOINT)] = True,
    prune_days: Annotated[float, typer.Option("--prune-days", metavar="DAYS", min=0.0, help=PRUNE)] = 30.0,
    quota_gb: Annotated[float | None, typer.Option("--quota-gb", metavar="GB", min=0.0, help=QUOTA)] = None,
) -> None:
    """Run campaigns by the clock and as data arrive, on a Prefect server of its own, until it is ended."""
    from flows import serve

    command.chosen(calibration, settings)
    for option, folder in (("--watch", watched), ("--data", data)):
        if folder is not None and not folder.is_dir():
            raise typer.BadParameter(f"{option} {folder}: found no folder, expected one with Level-1 files")
    arguments = {"calibration": calibration, "satellite": satellite, "settings": settings, "workers": workers}
    arguments["joint"] = joint
    pruning = {"prune_days": prune_days, "quota_gb": quota_gb}
    serve.serve(serve.Served(cron, watched, every_s, data or watched, arguments, pruning), output.say_at_once)


app.add_typer(stored.products, name="products")
for _command in (
    stored.effects,
    stored.series,
    stored.settings,
    stored.promote,
    stored.compare,
    stored.events,
    stored.results,
    stored.export,
    stored.history,
    stored.rebuild,
):
    app.command()(_command)


def main() -> None:
    """Entry point: errors of gravcal on one screen, others into a file."""
    single_threaded()
    try:
        app()
    except GravcalError as error:
        output.error(error)
        sys.exit(command.EXIT[command.status_of(error)])
    except Exception as error:  # noqa: BLE001
        output.unexpected(error)
        sys.exit(1)
