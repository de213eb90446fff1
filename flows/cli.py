"""The command line: `gravcal`.

Commands read their arguments, call a flow or the store, and say what came out. What belongs to one calibration is asked
of its record (`flows.calibration`). What is wrong with an argument is said before anything runs.
"""

import contextlib
import datetime
import shlex
import shutil
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flows import command, engine, output
from flows.calibration import known, load, load_all
from flows.engine import remake
from gravcal import catalog
from gravcal.errors import GravcalError, NoDataError
from gravcal.io import archive
from gravcal.store import configurations, housekeeping, location, schemas, store
from gravcal.store import history as lineage
from gravcal.store.results import rounded
from tasks.stage import lazy

campaigns = lazy("flows.campaign")
comparison = lazy("gravcal.report.comparison")
designs = lazy("flows.design")
discoveries = lazy("flows.discover")
effect_catalogue = lazy("gravcal.effects")
exports = lazy("flows.export")
fetching = lazy("gravcal.io.fetch")
prefect_server = lazy("flows.engine.server")
remote = lazy("gravcal.store.remote")
report_history = lazy("gravcal.report.history")
reproductions = lazy("flows.reproduce")
servers = lazy("flows.serve")
timeline = lazy("gravcal.browse.timeline")

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


def complete_events() -> list[str]:
    """Events of the catalogue and of the store; typer keeps those that begin as was typed."""
    names = {path.name for path in (location.folder() / "latest").glob("*")}
    with contextlib.suppress(Exception):  # a broken catalogue must not break the shell
        names |= {event.name for event in catalog.events()}
    return sorted(names)


def complete_products() -> list[str]:
    """Products that the readable links name: EVENT/STAGE."""
    latest = location.folder() / "latest"
    links = sorted(link for link in latest.rglob("*") if link.is_symlink())
    return [str(link.relative_to(latest)) for link in links]


def complete_settings(ctx) -> list[str]:
    """Parameters of the calibration that was named, with an equals sign."""
    name = _calibration_of(ctx)
    simulated = ctx.info_name == "simulate"
    with contextlib.suppress(Exception):
        known = catalog.parameters(f"simulate_{name}" if simulated else name)
        return [f"{one}=" for one in known.entries]
    return []


def complete_configurations(ctx) -> list[str]:
    """Recorded experiments of the calibration that was named; what else the commands on configurations take."""
    with contextlib.suppress(Exception):
        name = _calibration_of(ctx)
        more = {
            "compare": [configurations.OPERATIONAL, configurations.CATALOGUE],
            "promote": [configurations.CATALOGUE],
        }.get(ctx.info_name, [])
        more += list(catalog.parameters(name).entries) if ctx.info_name == "settings" else []
        return [*configurations.names(name), *more]
    return []


def complete_effects() -> list[str]:
    """Parameters of the effects, with an equals sign."""
    entries = sorted(effect_catalogue.catalogue().items())
    return [f"{slug}.{p.name}=" for slug, one in entries for p in one.parameters]


def _calibration_of(ctx):
    """Calibration that was named before; an option without its value ends the parsing, and its words are left over."""
    return next((word for word in [ctx.params.get("calibration"), *ctx.args] if word in known()), "")


def writable(ctx: typer.Context, path: Path | None) -> Path | None:
    """Path of a file that can be written; its folder is made, and what stands there is left alone."""
    if path is None or str(path) == "-" or ctx.resilient_parsing:
        return path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        there = path.exists()
        path.open("a").close()
        if not there:
            path.unlink()
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"{path} cannot be written ({error}). Name another file.") from error
    return path


def day(text: str) -> str:
    """Day of the calendar, written YYYY-MM-DD."""
    try:
        if str(datetime.date.fromisoformat(text)) == text:
            return text
    except ValueError:
        pass
    raise typer.BadParameter(f"{text} is no day of the calendar, expected YYYY-MM-DD.")


LETTERS = "C|D|CD|A|B|AB|T|S"
EVENT = "event of the catalogue, such as grace-c-2020-02-01"
FOLDER = "folder with Level-1 files or daily archives"
MODEL = "extended model, as gravcal discover writes it"
KINDS = ", ".join(known())
DOCUMENT = "write the document as JSON ('-': standard output)"
OTHER = "another value of a parameter"
HISTORY = "Prefect keeps a history of runs"
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
WHICH = "EVENT/STAGE, EVENT/as/NAME/STAGE, beginning of a key, or path"
DROPPED = "also what only experiments of this name (or pattern) refer to, with their links"
SEQUENCE = "sequence-of-events file (TN-01): its centre-of-mass and ranging calibrations as events"
COMPARED = "operational, catalogue, or an experiment"
NAMED = "experiment, or catalogue"
PARAMETER = "parameter or configuration"
AS = "name of the experiment that --set or --model make; alone: a recorded experiment again"
OTHERS = "make again what other versions of numpy, scipy or numba made"
Calibration = Annotated[str, typer.Argument(metavar="CALIBRATION", help=KINDS, autocompletion=known)]
Some = Annotated[str | None, typer.Argument(metavar="[CALIBRATION]", help=KINDS, autocompletion=known)]
EventName = Annotated[str | None, typer.Argument(metavar="[EVENT]", help=EVENT, autocompletion=complete_events)]
Data = Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)]
Satellite = Annotated[str | None, typer.Option("--satellite", metavar=LETTERS, help="which satellite of the folder")]
Date = Annotated[str | None, typer.Option("--date", metavar="YYYY-MM-DD", help="which day of the folder", parser=day)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help=OTHER, autocompletion=complete_settings),
]
Json = Annotated[Path | None, typer.Option("--json", metavar="FILE", help=DOCUMENT, callback=writable)]
As = Annotated[str | None, typer.Option("--as", metavar="NAME", help=AS, autocompletion=complete_configurations)]
Model = Annotated[Path | None, typer.Option("--model", metavar="FILE", help=MODEL)]
Seed = Annotated[int, typer.Option("--seed", help="source of everything random")]
EngineName = StrEnum("EngineName", engine.ENGINES)
Engine = Annotated[EngineName, typer.Option("--engine", help=HISTORY)]
Effects = Annotated[
    list[str] | None,
    typer.Option("--effect", metavar="SLUG.PARAMETER=VALUE", autocompletion=complete_effects),
]
RemakeVersions = Annotated[
    bool,
    typer.Option("--remake-versions", help=OTHERS, envvar=lineage.REMAKE, callback=engine.remake_versions),
]
Product = Annotated[str, typer.Argument(metavar="PRODUCT", help=WHICH, autocompletion=complete_products)]
Url = Annotated[str, typer.Argument(metavar="URL", help="s3://BUCKET/FOLDER, another address of fsspec, or a folder")]

app = typer.Typer(help=HELP, rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)
products = typer.Typer(
    help="What lies in the store: list (also without a word), show, verify, prune, pin, unpin, push, pull.",
    rich_markup_mode=None,
)
app.add_typer(products, name="products")


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
        return source, configurations.record(chosen)


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
        ref = command.made(load(calibration).flow, source, chosen, engine)
        document = load(calibration).document(ref)
    output.result(document, ref, json)
    raise typer.Exit(command.EXIT[document["status"]])


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
    output.plan(command.plan(calibration, sources, chosen), json, every)


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
    chosen = configurations.record(command.chosen(calibration, settings))
    source = command.source(calibration, event, data, satellite, date)
    document = command.detect(calibration, source, chosen)
    output.manoeuvres(document, json)
    found = document["manoeuvres"]
    if save:
        known, first = load(calibration), min((m["start"] for m in found), default=0) / 86400 + 0.5
        day = datetime.date.fromisoformat(source.date or "2000-01-01") + datetime.timedelta(0 if source.date else first)
        files = known.level_one_files(source)
        digests = {file.name: archive.file_digest(file.path, file.member) for file in files}
        about = known.design, tuple(source.satellite), day, found, digests, document["origin"]
        event = catalog.save_event(source.event, catalog.event_text(calibration, *about))
        output.say(f"stored as event {event.name}")
    raise typer.Exit(0 if found else 3)


@app.command()
def discover(
    calibration: Annotated[str, typer.Argument(metavar="CALIBRATION", help=WHAT, autocompletion=known)],
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    limits: Annotated[bool, typer.Option("--limits", help=SHOWN)] = False,
    joint: Annotated[bool, typer.Option("--joint", help=JOINT)] = False,
    events: Annotated[str, typer.Option(metavar="EVENT,EVENT", help=THESE)] = "",
    days: Annotated[str, typer.Option(metavar="DIR,DIR", help=DAYS)] = "",
    workers: Annotated[int | None, typer.Option(help=WORKERS)] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help=PAGE, callback=writable)] = None,
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
) -> None:
    """Show what the simulation of an event gets wrong, name the cause, extend the model and measure the gain."""
    calibration = discoveries.ALIASES.get(calibration, calibration)
    if joint or days:
        if event or date or limits or (days and (data or joint)):
            raise typer.BadParameter("--joint takes --satellite, --data and --events; --days folders and --satellite")
        folders = [Path(one) for one in days.split(",")] if days else data and [data]
        if not days and satellite is None:
            raise typer.BadParameter("--joint: expected --satellite, that of the events, or those of both")
        _joint(calibration, satellite, folders, (settings, model, as_), events, str(engine), workers, out, json)
        return
    study = discoveries.STUDIES.get(calibration)
    if study is None:
        source, chosen = _prepared(calibration, event, data, satellite, date, settings, model, as_, json)
    elif event or data or satellite or date or model:
        raise typer.BadParameter(f"{calibration} is a study of printed numbers: it takes no event, folder or model")
    else:
        source, chosen = study, configurations.record(command.configured(calibration, settings, None, as_))
    with _failures(calibration, source, json, chosen.configuration):
        command.check_searched(calibration, discoveries.STUDIES)
        ref = command.made(discoveries.flow_of(calibration, limits), source, chosen, engine)
        document = discoveries.document(ref)
    files = [path for path in sorted(ref.folder.iterdir()) if path.suffix in (".html", ".toml")]
    files += [shutil.copy(path, out) for path in files if out and path.name == "discovery.html"]
    output.discovery(document, files, json)
    raise typer.Exit(command.EXIT[document["status"]])


def _joint(calibration, satellite, data, given, events, engine, workers, out, json):
    """Search many events together, and say what that found and what has changed since the last time."""
    command.check_searched(calibration)
    chosen = configurations.record(command.chosen(calibration, *given))
    named = [one.strip() for one in events.split(",") if one.strip()]
    found = discoveries.joint(calibration, satellite, data, chosen, named, engine=engine, workers=workers)
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
    workers: Annotated[int | None, typer.Option(help=WORKERS)] = None,
    json: Json = None,
) -> None:
    """Update the joint model of a satellite with new events, and say what changed beyond its error."""
    _joint(calibration, satellite, data and [data], (settings,), "", "inline", workers, None, json)


@app.command()
def simulate(
    calibration: Calibration,
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for the Level-1 files")],
    seed: Seed = 1,
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help="where to write the truth")] = None,
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
    satellite: Annotated[str, typer.Option(metavar=LETTERS)] = ...,
    date: Date = ...,
    separate: Annotated[str, typer.Option(metavar="CAUSE,CAUSE", help=APART)] = "",
    budget: Annotated[float | None, typer.Option(metavar="MINUTES", help=BUDGET)] = None,
    constraints: Annotated[Path | None, typer.Option(metavar="FILE", help=CONSTRAINTS)] = None,
    verify: Annotated[int, typer.Option(metavar="N", min=0, help=VERIFY)] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="plan.toml and design.json")] = None,
    json: Json = None,
) -> None:
    """Propose the manoeuvres of the next session: those that make the result best known and causes separable."""
    command.check_satellite(calibration, satellite, command.record(calibration).satellites)
    causes = [one.strip() for one in separate.split(",") if one.strip()]
    limits = designs.constraints(calibration, constraints)
    wanted = {"causes": causes, "minutes": budget, "limits": limits, "verify": verify, "out": out}
    document = designs.designed(calibration, satellite, date, **wanted, say=output.note)
    location.write_json(location.folder() / "designs" / f"{calibration}-{satellite}-{date}.json", document)
    output.design(document, out, json)


@app.command()
def demo(
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="keep the Level-1 files here")] = None,
    seed: Seed = 1,
    engine: Engine = "prefect",
    json: Json = None,
) -> None:
    """Simulate a calibration day, process it as if it were measured, and print estimate beside truth."""
    folder = out or location.folder() / "demo" / f"seed-{seed}"
    first = engine == "prefect" and not (location.folder() / "prefect").exists()  # a first start takes ten seconds
    with prefect_server.early(first) as begun:
        truth = command.simulate(DEFAULT, folder, (seed, folder / "truth.json"), None, None)
        source = command.source(DEFAULT, None, folder, truth["satellite"], truth["date"])
        ref = command.made(load(DEFAULT).flow, source, command.chosen(DEFAULT, None), engine, begun)
    document = load(DEFAULT).document(ref)
    output.result(document, ref, json, truth)
    raise typer.Exit(command.EXIT[document["status"]])


@app.command()
def report(
    event: Annotated[str, typer.Argument(metavar="EVENT", help=LAST, autocompletion=complete_events)],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="copy the report's files here")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment")] = None,
    json: Json = None,
) -> None:
    """Say where the last report of an event is, or copy it."""
    files = [str(path) for path in command.report_files(event, out, as_)]
    if output.delivered({"event": event, "files": files}, json):
        output.say("\n".join(files))


@app.command()
def browse(
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="0: any that is free")] = 8765,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help=HOST)] = "127.0.0.1",
) -> None:
    """Show products, plots, comparisons and reports in a web browser; reads only, until it is ended with Ctrl-C."""
    try:
        from gravcal.browse import app
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"browse needs {error.name}, which is not installed; pip install 'gravcal[browse]'"
        ) from error
    app.serve(load_all(), app.bound(host, port), host, output.say)


@app.command()
def campaign(
    calibration: Calibration,
    satellite: Annotated[str | None, typer.Option(metavar=LETTERS)] = None,
    data: Annotated[Path | None, typer.Option(metavar="DIR", help=MANY)] = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    scheduler: Annotated[str | None, typer.Option(metavar="tls://HOST:PORT")] = None,
    workers: Annotated[int | None, typer.Option(help=WORKERS)] = None,
    only_failed: Annotated[bool, typer.Option("--only-failed", help="try again what failed the last time")] = False,
    search: Annotated[bool, typer.Option("--discover", help="search each event, as gravcal discover does")] = False,
    limits: Annotated[bool, typer.Option("--limits", help="the same, with the detection limits of each")] = False,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
    json: Json = None,
) -> None:
    """Calibrate all events of a satellite, in parallel; a failed event is tabulated and stops no other."""
    chosen = command.chosen(calibration, settings, model, as_)
    sources = command.many_sources(calibration, satellite, data)
    configurations.record(chosen)
    if search or limits:
        command.check_searched(calibration)
    wanted = "limits" if limits else "discover" if search else ""
    how = campaigns.Campaign(calibration, chosen, str(engine), scheduler, workers, again=only_failed, search=wanted)
    if only_failed:
        sources = campaigns.failed_last(how, sources)
        if not sources and output.to_screen(json):
            output.say("nothing failed the last time")
    with output.events_progress(len(sources)) as listener:
        summary = campaigns.run(how, sources, listener)
    output.campaign(summary, campaigns.table(summary["events"]), json)
    raise typer.Exit(campaigns.exit_code(summary))


@app.command()
def fetch(
    event: Annotated[str | None, typer.Argument(metavar="[EVENT]", help="event of the catalogue")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for the archives")] = ...,
    satellite: Annotated[str | None, typer.Option(metavar="C|D|CD|A|B|AB")] = None,
    date: Date = None,
    place: Annotated[
        str, typer.Option("--from", metavar="podaac|isdc|URL", help="isdc needs no login, podaac that of Earthdata")
    ] = "isdc",
    part: Annotated[str, typer.Option(metavar="PART,PART", help=PART)] = "noLRI",
    release: Annotated[str | None, typer.Option(metavar="02|03|04|0201", help="of a day")] = None,
    dry: Annotated[bool, typer.Option("--dry-run", help="only print the addresses, and where they were read")] = False,
    json: Json = None,
) -> None:
    """Fetch the daily archives of an event or day; what broke off is resumed, what is there is kept."""
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
    rows = [vars(one) | {"path": str(one.path)} for one in fetched]
    if output.delivered(rows, json):
        output.table(["archive", "state", "checked by", "bytes"], [list(row.values()) for row in rows])


@app.command()
def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help=PAPER)],
    out: Annotated[Path, typer.Option(metavar="DIR", help="page, tables, both reports, data, store")] = ...,
    place: Annotated[str, typer.Option("--from", metavar="podaac|isdc|URL", help="archive of the days")] = "isdc",
    data: Data = None,
    simulated: Annotated[bool, typer.Option("--simulated", help="simulated days of the same dates")] = False,
    json: Json = None,
) -> None:
    """Process the days of a source paper as printed and as corrected, beside its tables and figures."""
    if paper not in reproductions.papers():
        raise typer.BadParameter(f"no paper {paper!r}; there is {', '.join(reproductions.papers())}")
    with output.bytes_progress() as listener:
        how = {"place": place, "data": data, "simulated": simulated, "listener": listener, "tell": output.note}
        document = reproductions.reproduce(paper, out, **how)
    if output.delivered(document, json):
        rows = [[i["name"], len(i["rows"]), i.get("reason") or i["difference"]] for i in document["items"]]
        output.table(["item", "rows", "what differs, or why it is not made"], rows)
        output.say(f"{document['origin']} days {', '.join(document['days'])}; {out / 'index.html'}")
    raise typer.Exit(command.EXIT[document["status"]])


@app.command()
def serve(
    calibration: Annotated[str, typer.Argument(metavar="[CALIBRATION]", help=KINDS)] = DEFAULT,
    cron: Annotated[str, typer.Option(metavar="'M H D M W'", help="when to reprocess all, UTC")] = "0 3 * * *",
    watched: Annotated[Path | None, typer.Option("--watch", metavar="DIR", help="run when new data are here")] = None,
    every_s: Annotated[float, typer.Option("--every", metavar="SECONDS", min=0.1, help="between two looks")] = 60.0,
    data: Annotated[Path | None, typer.Option(metavar="DIR", help=SERVED)] = None,
    satellite: Annotated[str | None, typer.Option(metavar=LETTERS)] = None,
    settings: Settings = None,
    workers: Annotated[int | None, typer.Option(help="processes here; 0: one, without Dask")] = None,
    joint: Annotated[bool, typer.Option("--joint/--no-joint", help=JOINT)] = True,
    prune_days: Annotated[float, typer.Option("--prune-days", metavar="DAYS", min=0.0, help=PRUNE)] = 30.0,
    quota_gb: Annotated[float | None, typer.Option("--quota-gb", metavar="GB", min=0.0, help=QUOTA)] = None,
) -> None:
    """Run campaigns by the clock and as data arrive, on a Prefect server of its own, until it is ended."""
    command.chosen(calibration, settings)
    for option, folder in (("--watch", watched), ("--data", data)):
        if folder is not None and not folder.is_dir():
            raise typer.BadParameter(f"{option} {folder}: found no folder, expected one with Level-1 files")
    arguments = {"calibration": calibration, "satellite": satellite, "settings": settings, "workers": workers}
    arguments["joint"] = joint
    pruning = {"prune_days": prune_days, "quota_gb": quota_gb}
    servers.serve(servers.Served(cron, watched, every_s, data or watched, arguments, pruning), output.say)


@products.callback(invoke_without_command=True)
def without_word(context: typer.Context) -> None:
    """What lies in the store: list (also without a word), show, verify, prune, pin, unpin, push, pull."""
    if context.invoked_subcommand is None:
        list_products()


@products.command("list")
def list_products(
    event: Annotated[str | None, typer.Option(help="only this event")] = None,
    stage: Annotated[str | None, typer.Option(help="only this stage")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment or operational")] = None,
    all_: Annotated[bool, typer.Option("--all", help="also those replaced by newer ones")] = False,
    json: Json = None,
) -> None:
    """List the products of the store."""
    found, document = housekeeping.entries(event, stage, newest_only=not all_, configuration=as_), []
    facts = ("key", "digest", "bytes", "seconds", "made", "machine", "stage")
    for entry in found:
        row = {"product": entry.ref.name, "path": str(entry.ref.path), "newest": entry.newest}
        row |= {"configurations": list(entry.configurations)}
        document.append(row | {name: entry.record.get(name) for name in facts})
    if output.delivered(document, json):
        names = ("bytes", "seconds", "made")
        rows = [[e.ref.name, e.ref.key[:12], *(e.record[n] for n in names), ", ".join(e.configurations)] for e in found]
        output.table(["product", "key", *names, "configuration"], rows)


@products.command()
def show(product: Product, json: Json = None) -> None:
    """Show what one product holds and how it was made."""
    entry = housekeeping.resolve(product)
    if not output.delivered(entry.record, json):
        return
    dataset = housekeeping.content(entry)
    output.say(f"{entry.ref.name}\n{entry.ref.path}\n")
    rows = [
        [name, " ".join(one.dims), one.dtype, one.attrs.get("units", ""), one.attrs.get("long_name", "")]
        for name, one in dataset.variables.items()
    ]
    output.table(["variable", "dimensions", "type", "units", "meaning"], rows)
    output.say("")
    recipe = entry.record["recipe"]
    output.table(["setting", "value"], [[name, value] for name, value in recipe["settings"].items()])
    output.say("")
    facts = ("made", "machine", "seconds", "stage", "digest", "versions")
    output.table(["made", ""], [[name, entry.record.get(name, "")] for name in facts])


@products.command()
def verify(json: Json = None) -> None:
    """Compare every product with its record, bytes and content; exit code 1 if one differs."""
    with output.waiting("verifying"):
        problems = housekeeping.verify()
    count = len(housekeeping.folders())
    rows = [{"folder": str(folder), "problem": problem} for folder, problem in problems]
    if output.delivered({"products": count, "problems": rows}, json):
        for row in rows:
            output.say(f"{row['folder']}: {row['problem']}")
        output.say(f"{count} products, {len(problems)} problem(s)")
    raise typer.Exit(1 if problems else 0)


@products.command()
def push(url: Url, json: Json = None) -> None:
    """Copy what is delivered, and all it was made of, to an object store; what is there stays."""
    _copied("pushed to", url, remote.push(url), json)


@products.command()
def pull(url: Url, json: Json = None) -> None:
    """Copy the products of an object store here, each compared with its record."""
    _copied("pulled from", url, remote.pull(url), json)


def _copied(what, url, done, json):
    if output.delivered({"products": done[0], "bytes": done[1]}, json):
        output.say(f"{done[0]} products, {done[1] / 1e6:.1f} MB {what} {url}")


@products.command()
def prune(
    remove: Annotated[bool, typer.Option("--remove", help="do it; otherwise only say what would go")] = False,
    older: Annotated[float | None, typer.Option("--older-than-h", help="spare what is younger, hours; 1")] = None,
    quota: Annotated[
        float | None, typer.Option("--quota-gb", min=0, help="the oldest, until the store has less")
    ] = None,
    configuration: Annotated[str | None, typer.Option("--configuration", metavar="NAME", help=DROPPED)] = None,
    json: Json = None,
) -> None:
    """Remove what nothing refers to: products no readable link and no pin leads to, directly or as an input."""
    if configuration == location.OPERATIONAL:
        raise typer.BadParameter("--configuration: the operational one is delivered; expected an experiment's name")
    age, limit = (None if value is None else value * scale for value, scale in ((older, 3600), (quota, 1e9)))
    unused = housekeeping.prune(age, remove, limit, configuration)
    if not output.delivered([{"path": str(path), "bytes": size, "removed": remove} for path, size in unused], json):
        return
    if unused:
        output.table(["bytes", "path"], [[size, path] for path, size in unused])
    output.say(housekeeping.said(unused, remove, quota))


@products.command()
def pin(product: Product, json: Json = None) -> None:
    """Keep a product and all it was made of, whatever else refers to it."""
    entry = housekeeping.resolve(product)
    housekeeping.pin(entry)
    if output.delivered({"product": entry.ref.name, "key": entry.ref.key, "pinned": True}, json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} is pinned")


@products.command()
def unpin(product: Product, json: Json = None) -> None:
    """Let a pinned product go like any other."""
    entry = housekeeping.resolve(product)
    was = housekeeping.unpin(entry)
    if output.delivered({"product": entry.ref.name, "key": entry.ref.key, "pinned": False}, json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} {'is no longer' if was else 'was not'} pinned")


@app.command()
def history(
    product: Product,
    settings: Annotated[bool, typer.Option("--settings", help="with the settings of each")] = False,
    json: Json = None,
) -> None:
    """Print everything a product was made of, down to the raw files."""
    node = lineage.tree(housekeeping.resolve(product))
    if output.delivered(node, json):
        heads = ["product or file", "key or digest", "version", "made"]
        output.table(heads, list(_history_rows(node, 0, set(), settings)))


def _history_rows(node, depth, seen, settings):
    """Rows of a product, its settings if wanted, and its inputs, each product once."""
    name = "  " * depth + node["name"]
    if node["record"] is None:
        yield [name, node["digest"][:12] if "digest" in node else "(no longer in the store)", "", ""]
        return
    record = node["record"]
    key = record["key"]
    yield [name, key[:12], str(record["recipe"]["version"]), "(see above)" if key in seen else record["made"]]
    if key in seen:
        return
    seen.add(key)
    for setting, value in record["recipe"]["settings"].items() if settings else ():
        yield [f"{'  ' * depth}  . {setting} = {value}", "", "", ""]
    for inner in node["inputs"]:
        yield from _history_rows(inner, depth + 1, seen, settings)


@app.command()
def rebuild(product: Product, json: Json = None) -> None:
    """Make a product again from its raw files, in a store of its own, and compare."""
    entry = housekeeping.resolve(product)
    made_of = store.ancestry(entry.ref.key).values()
    with output.waiting("rebuilding", sum(record["seconds"] for record in made_of if record)):
        outcome = remake(entry)
    if output.delivered(outcome, json):
        rows = [[one["stage"], one["verdict"], one["why"]] for one in outcome["stages"]]
        output.table(["stage", "content", "why"], rows)
        output.say(f"{outcome['product']}: {'equal in every number' if outcome['equal'] else 'DIFFERENT'}")
    raise typer.Exit(0 if outcome["equal"] else 1)


@app.command()
def settings(
    calibration: Some = None,
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help=PARAMETER, autocompletion=complete_configurations)
    ] = None,
    forget: Annotated[bool, typer.Option("--forget", help="remove this experiment and its links")] = False,
    json: Json = None,
) -> None:
    """Show parameters with value, unit, the stages they reach and reason, and the configurations that were run."""
    if calibration is None:
        found = {one: configurations.operational(one) for one in command.known()}
        if output.delivered(found, json):
            rows = [[n, len(catalog.parameters(n).entries), _promoted(o), ", ".join(configurations.names(n))]
                    for n, o in found.items()]  # fmt: skip
            output.table(["calibration", "parameters", "operational", "experiments"], rows)
        return
    command.record(calibration)
    if forget:
        configurations.forget(calibration, name or "")
        output.say(f"{calibration}: {name} is forgotten; gravcal products prune removes what only it used")
        return
    known = {one: configurations.settings_of(calibration, one) for one in configurations.names(calibration)}
    plain, used = catalog.parameters(calibration), configurations.chosen(calibration, {})
    names, shown = list(plain.entries), known
    if name in plain.entries:
        names, shown = [name], {one: given for one, given in known.items() if name in given}
    elif name is not None:
        shown = {name: configurations.settings_of(calibration, name)}
        used = plain.with_settings(shown[name])
        names = list(shown[name])
    parts = ("unit", "minimum", "maximum", "allowed", "reason", "stages")
    entries = {
        n: {"value": used.entry(n).value, "catalogue": plain.entry(n).value}
        | {part: getattr(plain.entry(n), part) for part in parts}
        for n in names
    }
    if name in entries:  # stages that another value makes again, those of the newest event of the store
        found = housekeeping.entries(configuration=location.OPERATIONAL)
        mine = [one for one in found if one.ref.kind.startswith(f"{calibration}.")]
        newest = max(mine, key=lambda one: one.record["made"]).ref.event if mine else None
        own = [one for one in found if one.ref.event == newest]
        again = lineage.remade(own, name)
        entries[name]["reaches"] = list(dict.fromkeys(one.ref.kind for one in own if one.ref.key in again))
    document = {
        "calibration": calibration,
        "operational": configurations.operational(calibration),
        "promotions": configurations.promotions(calibration),
        "parameters": entries,
        "configurations": shown,
    }
    if not output.delivered(document, json):
        return
    mark = lambda one: "" if one["value"] == one["catalogue"] else f"catalogue: {one['catalogue']}"  # noqa: E731
    short = lambda text: text if len(text) <= 40 else text[:37] + "..."  # noqa: E731
    rows = [
        [n, short(str(e["value"])), e["unit"] or "", mark(e), ", ".join(e["stages"]), e["reason"]]
        for n, e in entries.items()
    ]
    if rows:
        output.table(["parameter", "value", "unit", "", "stages", "reason"], rows)
    for one in entries.values():
        if one.get("reaches"):
            output.say(f"another value makes again: {', '.join(one['reaches'])}")
    output.say(f"operational: {_promoted(document['operational'])}")
    rows = [[name, ", ".join(configurations.said(given))] for name, given in shown.items()]
    if rows:
        output.table(["configuration", "differs from the catalogue in"], rows)


@app.command()
def promote(
    calibration: Calibration,
    name: Annotated[str, typer.Argument(metavar="NAME", help=NAMED, autocompletion=complete_configurations)],
    why: Annotated[str, typer.Option(metavar="TEXT", help="for the journal of promotions")],
    who: Annotated[str | None, typer.Option(metavar="NAME", help="by default the user")] = None,
    json: Json = None,
) -> None:
    """Make an experiment the operational configuration, or the catalogue again; later plain runs use its settings."""
    command.record(calibration)
    made = configurations.promote(calibration, name, why, who)
    if output.delivered(made, json):
        output.say(f"{calibration}: {_promoted(made)}")
        output.say("Links and reports follow with the next run or campaign; gravcal plan says what that makes again.")


def _promoted(one):
    if not one["when"]:
        return "the catalogue"
    return f"{one['name']} is operational since {one['when'][:16].replace('T', ' ')} UTC ({one['who']}: {one['why']})"


@app.command()
def compare(
    calibration: Calibration,
    first: Annotated[str, typer.Argument(metavar="A", help=COMPARED, autocompletion=complete_configurations)],
    second: Annotated[str, typer.Argument(metavar="B", help=COMPARED, autocompletion=complete_configurations)],
    satellite: Annotated[str | None, typer.Option(metavar=LETTERS, help="only its events")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="page to write", callback=writable)] = None,
    json: Json = None,
) -> None:
    """Say what changes between two configurations, for every event that both have: values, verdicts, checks."""
    document = command.compare(calibration, first, second, satellite)
    output.write_json(document, json)
    if out is not None:
        out.write_text(comparison.page(document))
    if not output.to_screen(json):
        return
    for heads, rows in comparison.tables(document):
        if rows:
            output.table(heads, rows)
            output.say()
    for name, events in document["only_in"].items():
        if events:
            output.say(f"only in {name}: {', '.join(events)}")
    output.say(comparison.ASSUMPTION)
    if out is not None:
        output.say(str(out))


@app.command()
def export(
    event: Annotated[str, typer.Argument(metavar="EVENT", help="event with a report", autocompletion=complete_events)],
    out: Annotated[Path | None, typer.Option(metavar="DIR|FILE.zip", help="EVENT.zip if not given")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment")] = None,
    json: Json = None,
) -> None:
    """Put reports, documents, models, products, provenance and citation of an event into one folder or zip."""
    out = out or Path(f"{event}{f'-{as_}' if as_ else ''}.zip")
    files = exports.export(event, out, as_)
    if output.delivered({"event": event, "out": str(out), "files": files}, json):
        output.say(f"{len(files)} files in {out}; CITATION.cff says what to cite")


@app.command()
def results(
    calibration: Some = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="CSV to write", callback=writable)] = None,
    json: Json = None,
) -> None:
    """List all delivered values with their errors; as CSV or JSON with links to report, document and product."""
    chosen = {calibration: command.record(calibration)} if calibration else load_all()
    rows = timeline.delivered(chosen, lambda entry, name: (entry.ref.folder / name).as_uri())
    if out is not None:
        out.write_text(timeline.csv_of(rows), encoding="utf-8")
    if output.delivered(rows, json):
        said = [row | {"value": rounded(row["value"], row["sigma_total"] or row["sigma"])} for row in rows]
        output.named(said, "event", "calibration", "status", "quantity", "value", "unit")


@app.command()
def events(
    calibration: Some = None,
    sequence: Annotated[Path | None, typer.Option("--from", metavar="FILE", help=SEQUENCE)] = None,
    save: Annotated[bool, typer.Option("--save", help="of --from: into your own catalogue, GRAVCAL_CATALOG")] = False,
    json: Json = None,
) -> None:
    """List the events of the catalogue and whether their files are at hand in GRAVCAL_DATA, or those of a file."""
    if sequence is not None:
        document = command.sequence(sequence, save=save)
        if output.delivered(document, json):
            output.named(document["events"], "event", "calibration", "start", "stop", "state", "comment")
            output.say("in force at the end of the file")
            output.named(document["in_force"], "name", "satellite", "time", "values", "comment")
        return
    rows, installed = [], load_all()
    for event in catalog.events(calibration=calibration):
        if event.calibration in installed:
            try:
                files = str(installed[event.calibration].source(event=event.name).folder)
            except GravcalError as error:
                files = "no data" if isinstance(error, NoDataError) else str(error).partition(": ")[2] or str(error)
            about = event.name, event.calibration, str(event.date or "unknown"), files
            rows.append(dict(zip(("event", "calibration", "date", "files"), about, strict=True)))
    if output.delivered(rows, json):
        output.named(rows, "event", "calibration", "date", "files")


@app.command()
def effects(json: Json = None) -> None:
    """List the effects that a simulation can hide, an estimator fit and discovery name."""
    entries = [
        {
            "slug": slug,
            "channel": entry.channel,
            "reference": entry.reference,
            "parameters": [
                {"name": p.name, "unit": p.unit, "sign": p.meaning, "prior": p.prior_sigma} for p in entry.parameters
            ],
        }
        for slug, entry in sorted(effect_catalogue.catalogue().items())
    ]
    if output.delivered({"schema_version": "1.0", "effects": entries}, json):
        rows = [
            [e["slug"], e["channel"], ", ".join(f"{p['name']} [{p['unit']}]" for p in e["parameters"])] for e in entries
        ]
        output.table(["effect", "acts on", "parameters"], rows)


@app.command()
def series(
    calibration: Calibration,
    satellite: Annotated[str | None, typer.Option(metavar=LETTERS, help="whose events; all if not given")] = None,
    out: Annotated[Path, typer.Option(metavar="FILE", help="page to write", callback=writable)] = Path("series.html"),
    json: Json = None,
) -> None:
    """Results of all events over the years, beside the published ones; for com_offset with the mass trims."""
    one, rows = command.record(calibration), []
    command.check_satellite(calibration, satellite, [*one.satellites, "".join(one.satellites)])
    points = [point for point in timeline.points(one) if satellite is None or point.satellite in satellite]
    letters = sorted({point.satellite for point in points})
    if points:
        points += [point for letter in letters for point in timeline.printed_points(one, letter)]
        trims = [(letter, trim) for letter in letters if one.trims for trim in timeline.trims(letter)]
        rows, page = report_history.history(one.quantity, points, trims, one.band)
    status = "delivered" if rows else "no_data"
    said = {"schema_version": schemas.VERSION, "status": status, "calibration": calibration, "satellite": satellite}
    output.write_json(said | {"rows": rows}, json)
    if rows:
        out.write_text(page, encoding="utf-8")
    if output.to_screen(json):
        whose = f"{calibration}{f' of {satellite}' if satellite else ''}"
        none = f"no result of {whose} in {location.folder()}; {out} is left as it was"
        output.say(f"{len(rows)} rows in {out}" if rows else none)
    raise typer.Exit(command.EXIT[status])


def main() -> None:
    """Entry point: errors of gravcal on one screen, others into a file."""
    engine.single_threaded()
    try:
        app()
    except GravcalError as error:
        output.error(error)
        sys.exit(command.EXIT[command.status_of(error)])
    except Exception as error:  # noqa: BLE001
        output.unexpected(error)
        sys.exit(1)


if __name__ == "__main__":
    main()
