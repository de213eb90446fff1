"""The command line: `gravcal`.

Commands read their arguments, call a flow or the store, and say what came out. What belongs to one calibration is asked
of its record (`flows.calibration`). What is wrong with an argument is said before anything runs.
"""

import contextlib
import datetime
import shlex
import shutil
import sys
import tomllib
from enum import StrEnum
from inspect import Parameter, Signature, signature
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
report_history = lazy("gravcal.report.history")
reproductions = lazy("flows.reproduce")
servers = lazy("flows.serve")
timeline = lazy("gravcal.browse.timeline")

DEFAULT = "com_offset"  # calibration of demo
#: Arguments and options of the commands, in the words of typer: those of a command beside what is the same for all.
ARGUMENTS = tomllib.loads(Path(__file__).with_name("arguments.toml").read_text(encoding="utf-8"))
KINDS = ", ".join(known())
ENGINES = StrEnum("EngineName", engine.ENGINES)
TYPES = {"path": Path, "whole": int, "number": float, "flag": bool, "texts": list[str], "engine": ENGINES, "text": str}


def complete_events() -> list[str]:
    """Names of events of the catalogue and of the store, of which typer keeps those that begin as was typed."""
    names = {path.name for path in (location.folder() / "latest").glob("*")}
    with contextlib.suppress(Exception):  # a broken catalogue must not break the shell
        names |= {event.name for event in catalog.events()}
    return sorted(names)


def complete_settings(ctx) -> list[str]:
    """Completions "name=" of the parameters of the calibration named on the command line."""
    words = [ctx.params.get("calibration"), *ctx.args]  # an option without its value leaves its words over
    name = next((word for word in words if word in known()), "")
    with contextlib.suppress(Exception):
        return [f"{one}=" for one in catalog.parameters("simulate_" * (ctx.info_name == "simulate") + name).entries]
    return []


def complete_effects() -> list[str]:
    """Completions "slug.parameter=" of all effects of the catalogue."""
    entries = sorted(effect_catalogue.catalogue().items())
    return [f"{slug}.{p.name}=" for slug, one in entries for p in one.parameters]


def writable(ctx: typer.Context, path: Path | None) -> Path | None:
    """Path itself, BadParameter unless a file can be written there; creates its folder, keeps an existing file."""
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
        return datetime.date.fromisoformat(text).isoformat()
    except ValueError:
        raise typer.BadParameter(f"{text} is no day of the calendar, expected YYYY-MM-DD.") from None


#: Functions that arguments name: what completes, checks or reads them.
FUNCTIONS = {one.__name__: one for one in (complete_events, complete_settings, complete_effects, writable, day, known)}

app = typer.Typer(help=ARGUMENTS["help"], rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)
products = typer.Typer(help=ARGUMENTS["store"], rich_markup_mode=None)
app.add_typer(products, name="products")


def command_of(group, name=None):
    """Decorator that makes a function a command; its parameters are those of `ARGUMENTS` with their names."""

    def decorate(body):  # the command
        own = ARGUMENTS.get(body.__name__, {})
        made = [argument(n, ARGUMENTS["common"].get(n, {}) | own.get(n, {})) for n in signature(body).parameters]
        body.__signature__ = Signature(made)
        return group.command(name)(body)

    return decorate


def argument(name, stated):
    """Parameter of a command as typer takes it: an option if a flag is stated, else an argument by its place."""
    about = {key: FUNCTIONS.get(value, value) if isinstance(value, str) else value for key, value in stated.items()}
    kind, flag, required = TYPES[about.pop("type", "text")], about.pop("flag", None), about.pop("required", False)
    default = about.pop("default", False if kind is bool else None)
    if "help" in about:
        about["help"] = about["help"].replace("{kinds}", KINDS)
    made = typer.Option(flag, **about) if flag else typer.Argument(**about)
    annotation = Annotated[kind if required or default is not None else kind | None, made]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=... if required else default, annotation=annotation)


@contextlib.contextmanager
def _failures(calibration, source, json_path, configuration):
    """Context that writes a document of status "failed" (source: Source, or event or folder name) before it raises."""
    try:
        yield
    except GravcalError as problem:
        output.write_json(command.failed(calibration, source, problem, configuration), json_path)
        raise


def _prepared(calibration, event, data, satellite, date, settings, model, as_, json):
    """(Source, Parameters) of one event; if refused, a document of status "failed" is written first."""
    with _failures(calibration, event or str(data), json, as_ or location.OPERATIONAL):
        chosen = command.chosen(calibration, settings, model, as_)
    with _failures(calibration, event or str(data), json, chosen.configuration):
        return command.source(calibration, event, data, satellite, date), configurations.record(chosen)


@command_of(app)
def run(calibration, event, data, satellite, date, settings, model, as_, json, engine) -> None:
    """Calibrate one event; what is in the store already is reused. With --set or --model: an experiment beside it."""
    source, chosen = _prepared(calibration, event, data, satellite, date, settings, model, as_, json)
    with _failures(calibration, source, json, chosen.configuration):
        ref = command.made(load(calibration).flow, source, chosen, engine)
        document = load(calibration).document(ref)
    output.result(document, ref, json)
    raise typer.Exit(command.EXIT[document["status"]])


@command_of(app)
def plan(calibration, event, data, satellite, date, settings, model, as_, every, json) -> None:
    """Say what a run or campaign would make again, why and how long; without EVENT or folder for all of the store."""
    chosen = command.chosen(calibration, settings, model, as_)
    sources = command.sources(calibration, event, data, satellite, date)
    output.plan(command.plan(calibration, sources, chosen), json, every)


@command_of(app)
def detect(calibration, event, data, satellite, date, settings, json, save) -> None:
    """Find the manoeuvres in the data of an event or folder."""
    source = command.source(calibration, event, data, satellite, date)
    chosen = configurations.record(command.chosen(calibration, settings))
    document = command.detect(calibration, source, chosen)
    output.manoeuvres(document, json)
    if save:
        known = load(calibration)
        files = known.level_one_files(source)
        days = sorted(datetime.date.fromisoformat(file.date) for file in files)
        digests = {file.name: archive.file_digest(file.path, file.member) for file in files}
        about = known.design, tuple(source.satellite), days[0], document["manoeuvres"], digests, document["origin"]
        event = catalog.save_event(source.event, catalog.event_text(calibration, *about, last=days[-1]))
        output.say(f"stored as event {event.name}")
    raise typer.Exit(0 if document["manoeuvres"] else 3)


@command_of(app)
def discover(
    calibration, event, data, satellite, date, settings, model, as_, limits, joint, events, days, workers, out, json,
    engine,
) -> None:  # fmt: skip
    """Show what the simulation of an event gets wrong, name the cause, extend the model and measure the gain."""
    calibration = discoveries.ALIASES.get(calibration, calibration)
    if joint or days:
        if event or date or limits or (days and (joint or not data)):
            raise typer.BadParameter("--joint takes --satellite, --data and --events; --days --data and --satellite")
        if joint and satellite is None:
            raise typer.BadParameter("--joint: expected --satellite, that of the events, or those of both")
        _joint(calibration, satellite, data and [data], (settings, model, as_), events, str(engine), workers, out, json)
        return
    if events or workers is not None:
        raise typer.BadParameter("--events and --workers belong to --joint and --days")
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


def _joint(calibration, satellite, data, configuration, events, engine, workers, out, json):
    """Run the joint search of many events and print it; configuration: (settings, model, name); out: copy of page."""
    command.check_searched(calibration)
    chosen = configurations.record(command.chosen(calibration, *configuration))
    named = [one.strip() for one in events.split(",") if one.strip()]
    with _failures(calibration, satellite or str(data), json, chosen.configuration):
        searches = discoveries.joint(calibration, satellite, data, chosen, named, engine=engine, workers=workers)
    for document, files, _ in searches if out else ():
        named = out.with_stem(f"{out.stem}-{document['satellite']}") if len(searches) > 1 else out
        shutil.copy(next(path for path in files if path.name == "joint.html"), named)
    output.joint(searches, json)


@command_of(app)
def watch(calibration, satellite, data, settings, workers, json) -> None:
    """Update the joint model of a satellite with new events, and say what changed beyond its error."""
    _joint(calibration, satellite, data and [data], (settings,), "", "inline", workers, None, json)


@command_of(app)
def simulate(calibration, out, seed, truth, effect, settings, planned, json) -> None:
    """Write the Level-1 files of an invented event; the truth goes to a file of its own that no run reads."""
    settings = [*(settings or []), *([f"design={planned}"] if planned else [])]
    before = {path: path.stat().st_mtime_ns for path in out.glob("*")}
    made = command.simulate(calibration, out, seed, truth, effect, settings)
    aside = {made.get("series"), truth and truth.name}
    new = (one for one in out.iterdir() if one.is_file() and one.name not in aside)
    files = sorted(str(one) for one in new if before.get(one) != one.stat().st_mtime_ns)
    whose = {name: made[name] for name in ("satellite", "date") if made.get(name)}
    then = shlex.join(["gravcal", "run", calibration, "--data", str(out), *(f"--{n}={v}" for n, v in whose.items())])
    document = {"calibration": calibration, "folder": str(out), "seed": seed, "files": files, "run": then}
    if output.delivered(document, json):
        kinds = ", ".join(dict.fromkeys(Path(one).name.partition("_")[0] for one in files))
        size = sum(Path(one).stat().st_size for one in files) / 1e6
        said = f"{len(files)} Level-1 files of an invented event ({' '.join(whose.values())}) in {out}, {size:.1f} MB"
        output.say(f"{said}: {kinds}" + (f"\ntruth in {truth}; no run reads it" if truth else ""))
        output.say(f"calibrate: {then}")


@command_of(app)
def design(calibration, satellite, date, separate, budget, constraints, verify, out, json) -> None:
    """Propose the manoeuvres of the next session: those that make the result best known and causes separable."""
    command.check_satellite(calibration, satellite, command.record(calibration).satellites)
    causes = [one.strip() for one in separate.split(",") if one.strip()]
    limits = designs.constraints(calibration, constraints)
    wanted = {"causes": causes, "minutes": budget, "limits": limits, "verify": verify, "out": out}
    document = designs.designed(calibration, satellite, date, **wanted, say=output.note)
    location.write_json(location.folder() / "designs" / f"{calibration}-{satellite}-{date}.json", document)
    output.design(document, out, json)


@command_of(app)
def demo(out, seed, engine, json) -> None:
    """Simulate a calibration day, process it as if it were measured, and print estimate beside truth."""
    folder = out or location.folder() / "demo" / f"seed-{seed}"
    truth = command.simulate(DEFAULT, folder, seed, folder / "truth.json", None, None)
    source = command.source(DEFAULT, None, folder, truth["satellite"], truth["date"])
    ref = command.made(load(DEFAULT).flow, source, command.chosen(DEFAULT, None), engine)
    document = load(DEFAULT).document(ref)
    output.result(document, ref, json, truth)
    raise typer.Exit(command.EXIT[document["status"]])


@command_of(app)
def report(event, out, as_, json) -> None:
    """Say where the last report of an event is, or copy it."""
    files = [str(path) for path in command.report_files(event, out, as_)]
    if output.delivered({"event": event, "files": files}, json):
        output.say("\n".join(files))


@command_of(app)
def browse(port, host) -> None:
    """Show products, plots, comparisons and reports in a web browser; reads only, until it is ended with Ctrl-C."""
    try:
        from gravcal.browse import app
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"browse needs {error.name}, which is not installed; pip install 'gravcal[browse]'"
        ) from error
    app.serve(load_all(), app.bound(host, port), host, output.say)


@command_of(app)
def campaign(
    calibration, satellite, data, settings, model, as_, scheduler, workers, only_failed, search, limits, engine, json
) -> None:
    """Calibrate all events of a satellite, in parallel; a failed event is tabulated and stops no other."""
    chosen = command.chosen(calibration, settings, model, as_)
    with _failures(calibration, satellite or str(data), json, chosen.configuration):
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


@command_of(app)
def fetch(event, out, satellite, date, place, part, release, dry, json) -> None:
    """Fetch the daily archives of an event or day; what broke off is resumed, what is there is kept."""
    if event is None and None in (satellite, date) or event and (satellite or date or release or part != "noLRI"):
        raise typer.BadParameter("give an EVENT of the catalogue alone, or --satellite and --date")
    if not event and satellite not in ("A", "B", "AB", "C", "D", "CD"):
        raise typer.BadParameter(f"--satellite {satellite}: expected A, B, AB, C, D or CD")
    if event:
        archives = fetching.of_event(catalog.event(event))
    else:
        parts = part.replace(" ", "").split(",")
        archives = fetching.of_day(satellite, datetime.date.fromisoformat(date), parts, release)
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


@command_of(app)
def reproduce(paper, out, place, data, simulated, json) -> None:
    """Process the days of a source paper as printed and as corrected, beside its tables and figures."""
    if paper not in reproductions.papers():
        raise typer.BadParameter(f"no paper {paper!r}; there is {', '.join(reproductions.papers())}")
    out = out or Path(f"reproduction-{paper}")
    with output.bytes_progress() as listener:
        how = {"place": place, "data": data, "simulated": simulated, "listener": listener, "tell": output.note}
        document = reproductions.reproduce(paper, out, **how)
    if output.delivered(document, json):
        output.say(f"{document['origin']} days {', '.join(document['days'])}; {out / 'index.html'}")
    raise typer.Exit(command.EXIT[document["status"]])


@command_of(app)
def serve(calibration, cron, watched, every_s, data, satellite, settings, workers, joint, prune_days, quota_gb) -> None:
    """Run campaigns by the clock and as data arrive, on a Prefect server of its own, until it is ended."""
    command.chosen(calibration, settings)
    command.check_satellite(calibration, satellite, [*(own := command.record(calibration).satellites), "".join(own)])
    for option, folder in (("--watch", watched), ("--data", data)):
        if folder is not None and not folder.is_dir():
            raise typer.BadParameter(f"{option} {folder}: found no folder, expected one with Level-1 files")
    arguments = {"calibration": calibration, "satellite": satellite, "settings": settings, "workers": workers}
    arguments["joint"] = joint
    pruning = {"prune_days": prune_days, "quota_gb": quota_gb}
    servers.serve(servers.Served(cron, watched, every_s, data or watched, arguments, pruning), output.say)


@products.callback(invoke_without_command=True)
def without_word(context: typer.Context) -> None:
    """What lies in the store: list (also without a word), show, verify, prune, pin, unpin."""
    if context.invoked_subcommand is None:
        list_products(event=None, stage=None, as_=None, all_=False, json=None)


@command_of(products, "list")
def list_products(event, stage, as_, all_, json) -> None:
    """List the products of the store."""
    kept, document = housekeeping.entries(event, stage, newest_only=not all_, configuration=as_), []
    facts = ("key", "digest", "bytes", "seconds", "made", "machine", "stage")
    for entry in kept:
        row = {"product": entry.ref.name, "path": str(entry.ref.path), "newest": entry.newest}
        row |= {"configurations": list(entry.configurations)}
        document.append(row | {name: entry.record.get(name) for name in facts})
    if output.delivered(document, json):
        names = ("bytes", "seconds", "made")
        rows = [[e.ref.name, e.ref.key[:12], *(e.record[n] for n in names), ", ".join(e.configurations)] for e in kept]
        output.table(["product", "key", *names, "configuration"], rows)


@command_of(products)
def show(product, json) -> None:
    """Show what one product holds and the settings it was made with."""
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
    output.table(["setting", "value"], [*entry.record["recipe"]["settings"].items()])


@command_of(products)
def verify(json) -> None:
    """Compare every product with its record, bytes and content; exit code 1 if one differs."""
    with output.progress("verifying"):
        problems = housekeeping.verify()
    count = len(housekeeping.folders())
    rows = [{"folder": str(folder), "problem": problem} for folder, problem in problems]
    if output.delivered({"products": count, "problems": rows}, json):
        for row in rows:
            output.say(f"{row['folder']}: {row['problem']}")
        output.say(f"{count} products, {len(problems)} problem(s)")
    raise typer.Exit(1 if problems else 0)


@command_of(products)
def prune(remove, older, quota, configuration, json) -> None:
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


@command_of(products)
def pin(product, json) -> None:
    """Keep a product and all it was made of, whatever else refers to it."""
    entry = housekeeping.resolve(product)
    housekeeping.pin(entry)
    if output.delivered({"product": entry.ref.name, "key": entry.ref.key, "pinned": True}, json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} is pinned")


@command_of(products)
def unpin(product, json) -> None:
    """Let a pinned product go like any other."""
    entry = housekeeping.resolve(product)
    was = housekeeping.unpin(entry)
    if output.delivered({"product": entry.ref.name, "key": entry.ref.key, "pinned": False}, json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} {'is no longer' if was else 'was not'} pinned")


@command_of(app)
def history(product, with_settings, json) -> None:
    """Print everything a product was made of, down to the raw files."""
    node = lineage.tree(housekeeping.resolve(product))
    if output.delivered(node, json):
        heads = ["product or file", "key or digest", "version", "made"]
        output.table(heads, list(_history_rows(node, 0, set(), with_settings)))


def _history_rows(node, depth, listed, settings):
    """Rows (name, key or digest, version, made) of a provenance tree, indented by depth; ``listed``: keys so far."""
    name = "  " * depth + node["name"]
    if node["record"] is None:
        yield [name, node["digest"][:12] if "digest" in node else "(no longer in the store)", "", ""]
        return
    record = node["record"]
    key = record["key"]
    yield [name, key[:12], str(record["recipe"]["version"]), "(see above)" if key in listed else record["made"]]
    if key in listed:
        return
    listed.add(key)
    for setting, value in record["recipe"]["settings"].items() if settings else ():
        yield [f"{'  ' * depth}  . {setting} = {value}", "", "", ""]
    for inner in node["inputs"]:
        yield from _history_rows(inner, depth + 1, listed, settings)


@command_of(app)
def rebuild(product, json) -> None:
    """Make a product again from its raw files, in a store of its own, and compare."""
    entry = housekeeping.resolve(product)
    made_of = store.ancestry(entry.ref.key).values()
    with output.progress("rebuilding", sum(record["seconds"] for record in made_of if record)):
        outcome = remake(entry)
    if output.delivered(outcome, json):
        rows = [[one["stage"], one["verdict"], one["why"]] for one in outcome["stages"]]
        output.table(["stage", "content", "why"], rows)
        output.say(f"{outcome['product']}: {'equal in every number' if outcome['equal'] else 'DIFFERENT'}")
    raise typer.Exit(0 if outcome["equal"] else 1)


@command_of(app)
def settings(calibration, name, json) -> None:
    """Show parameters with value, unit, the stages they reach and reason, and the configurations that were run."""
    if calibration is None:
        operational = {one: configurations.operational(one) for one in command.known()}
        if output.delivered(operational, json):
            rows = [[n, len(catalog.parameters(n).entries), _promoted(o), ", ".join(configurations.names(n))]
                    for n, o in operational.items()]  # fmt: skip
            output.table(["calibration", "parameters", "operational", "experiments"], rows)
        return
    command.record(calibration)
    known = {one: configurations.settings_of(calibration, one) for one in configurations.names(calibration)}
    plain, used = catalog.parameters(calibration), configurations.chosen(calibration, {})
    names, shown = list(plain.entries), known
    if name in plain.entries:
        names, shown = [name], {one: changes for one, changes in known.items() if name in changes}
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
    output.say(f"operational: {_promoted(document['operational'])}")
    rows = [[name, ", ".join(configurations.said(changes))] for name, changes in shown.items()]
    if rows:
        output.table(["configuration", "differs from the catalogue in"], rows)


@command_of(app)
def promote(calibration, name, why, who, json) -> None:
    """Make an experiment the operational configuration, or the catalogue again; later plain runs use its settings."""
    command.record(calibration)
    made = configurations.promote(calibration, name, why, who)
    if output.delivered(made, json):
        output.say(f"{calibration}: {_promoted(made)}")
        output.say("Links and reports stay until the next run or campaign; gravcal plan says what that makes again.")


def _promoted(one):  # text on a promotion, dict of `configurations.operational`
    if not one["when"]:
        return "the catalogue"
    return f"{one['name']} is operational since {one['when'][:16].replace('T', ' ')} UTC ({one['who']}: {one['why']})"


@command_of(app)
def compare(calibration, first, second, satellite, out, json) -> None:
    """Say what changes between two configurations, for every event that both have: values, verdicts, checks."""
    document = command.compare(calibration, first, second, satellite)
    if out is not None:
        out.write_text(comparison.page(document))
    if not output.delivered(document, json):
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


@command_of(app)
def export(event, out, as_, json) -> None:
    """Put reports, documents, models, products, provenance and citation of an event into one folder or zip."""
    out = out or Path(f"{event}{f'-{as_}' if as_ else ''}.zip")
    files, left_out = exports.export(event, out, as_)
    if output.delivered({"event": event, "out": str(out), "files": files, "left_out": left_out}, json):
        output.say(f"{len(files)} files in {out}; CITATION.cff says what to cite")
        if left_out:
            output.say(f"left out, made from other files of these days: {', '.join(left_out)}")


@command_of(app)
def results(calibration, out, json) -> None:
    """List all delivered values with their errors; as CSV or JSON with links to report, document and product."""
    chosen = {calibration: command.record(calibration)} if calibration else load_all()
    rows = timeline.delivered(chosen, lambda entry, name: (entry.ref.folder / name).as_uri())
    if out is not None:
        out.write_text(timeline.csv_of(rows), encoding="utf-8")
    if output.delivered(rows, json):
        said = [row | {"value": rounded(row["value"], row["sigma_total"] or row["sigma"])} for row in rows]
        output.named(said, "event", "calibration", "origin", "status", "satellite", "quantity", "value", "unit")


@command_of(app)
def events(calibration, sequence, save, json) -> None:
    """List the events of the catalogue and whether their files are at hand in GRAVCAL_DATA, or those of a file."""
    if sequence is not None:
        document = command.sequence(sequence, save=save)
        if output.delivered(document, json):
            output.named(document["events"], "event", "calibration", "start", "stop", "state", "comment")
            output.say("in force at the end of the file")
            output.named(document["in_force"], "name", "satellite", "time", "values", "comment")
        return
    rows, installed = [], {calibration: command.record(calibration)} if calibration else load_all()
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


@command_of(app)
def effects(json) -> None:
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


@command_of(app)
def series(calibration, satellite, out, json) -> None:
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
