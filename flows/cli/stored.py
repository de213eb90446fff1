"""Commands on what is there: products, history, rebuild; settings, promote, compare; events, effects, series."""

from pathlib import Path
from typing import Annotated

import typer

from flows import command, output
from flows.cli.options import (
    KINDS,
    LETTERS,
    Calibration,
    complete_calibrations,
    complete_configurations,
    complete_events,
    complete_products,
    json_option,
    writable,
)
from flows.engine.remake import remake
from gravcal import catalog
from gravcal.store import configurations, housekeeping, location, schemas
from gravcal.store import history as lineage
from gravcal.store.results import rounded
from tasks.stage import lazy

comparison = lazy("gravcal.report.comparison")
remote = lazy("gravcal.store.remote")

products = typer.Typer(
    help="What lies in the store: list (also without a word), show, verify, prune, pin, unpin, push, pull.",
    rich_markup_mode=None,
)
VERIFIED_BYTES_PER_S = 100e6  # read, hashed and decoded on one core; only for the time left
WHICH = "EVENT/STAGE, EVENT/as/NAME/STAGE, beginning of a key, or path"
DROPPED = "also what only experiments of this name (or pattern) refer to, with their links"
Product = Annotated[str, typer.Argument(metavar="PRODUCT", help=WHICH, autocompletion=complete_products)]
Url = Annotated[str, typer.Argument(metavar="URL", help="s3://BUCKET/FOLDER, another address of fsspec, or a folder")]
Json = Annotated[Path | None, json_option("write as JSON")]


@products.callback(invoke_without_command=True)
def without_word(context: typer.Context) -> None:
    """What lies in the store: list (also without a word), show, verify, prune, pin, unpin, push, pull."""
    if context.invoked_subcommand is None:
        list_products()


@products.command("list")
def list_products(
    event: Annotated[str | None, typer.Option("--event", help="only this event")] = None,
    stage: Annotated[str | None, typer.Option("--stage", help="only this stage")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment or operational")] = None,
    all_: Annotated[bool, typer.Option("--all", help="also those replaced by newer ones")] = False,
    json: Json = None,
) -> None:
    """List the products of the store."""
    found = housekeeping.entries(event, stage, newest_only=not all_, configuration=as_)
    document = [_summary(entry) for entry in found]
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
    rows = [[name, " ".join(one.dims), one.dtype, one.attrs.get("units", ""), one.attrs.get("long_name", "")]
            for name, one in dataset.variables.items()]  # fmt: skip
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
    size = sum(entry.record["bytes"] for entry in housekeeping.entries(newest_only=False))
    with output.waiting("verifying", size / VERIFIED_BYTES_PER_S):
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
    """Say how much was copied."""
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
    verb = "removed" if remove else "would be removed (--remove does it)"
    output.say(f"{len(unused)} entries, {sum(size for _, size in unused) / 1e6:.1f} MB {verb}")
    left = housekeeping.size() - (0 if remove else sum(size for _, size in unused))
    if limit is not None and left > limit:
        output.say(
            f"{left / 1e9:.3f} GB stay, the quota is {quota:g} GB: they are delivered, pinned, or of the last hour"
        )


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


def rebuild(product: Product, json: Json = None) -> None:
    """Make a product again from its raw files, in a store of its own, and compare."""
    entry = housekeeping.resolve(product)
    with output.waiting("rebuilding", lineage.seconds(entry)):
        outcome = remake(entry)
    if output.delivered(outcome, json):
        rows = [[one["stage"], one["verdict"], one["why"]] for one in outcome["stages"]]
        output.table(["stage", "content", "why"], rows)
        output.say(f"{outcome['product']}: {'equal in every number' if outcome['equal'] else 'DIFFERENT'}")
    raise typer.Exit(0 if outcome["equal"] else 1)


def _summary(entry):
    """One product for JSON."""
    names = ("key", "digest", "bytes", "seconds", "made", "machine", "stage")
    known = {name: entry.record.get(name) for name in names}
    return {
        "product": entry.ref.name,
        "path": str(entry.ref.path),
        "newest": entry.newest,
        "configurations": list(entry.configurations),
    } | known


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


SEQUENCE = "sequence-of-events file (TN-01): its centre-of-mass and ranging calibrations as events"
COMPARED = "operational, catalogue, or an experiment"
NAMED = "experiment, or catalogue"
SHOWN = "parameter or configuration"
Some = Annotated[str | None, typer.Argument(metavar="[CALIBRATION]", help=KINDS, autocompletion=complete_calibrations)]


def settings(
    calibration: Some = None,
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help=SHOWN, autocompletion=complete_configurations)
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
    document = _document(calibration, name)
    if output.delivered(document, json):
        _say(document)


def promote(
    calibration: Calibration,
    name: Annotated[str, typer.Argument(metavar="NAME", help=NAMED, autocompletion=complete_configurations)],
    why: Annotated[str, typer.Option("--why", metavar="TEXT", help="for the journal of promotions")],
    who: Annotated[str | None, typer.Option("--who", metavar="NAME", help="by default the user")] = None,
    json: Json = None,
) -> None:
    """Make an experiment the operational configuration, or the catalogue again; later plain runs use its settings."""
    command.record(calibration)
    made = configurations.promote(calibration, name, why, who)
    if output.delivered(made, json):
        output.say(f"{calibration}: {_promoted(made)}")
        output.say("Links and reports follow with the next run or campaign; gravcal plan says what that makes again.")


def compare(
    calibration: Calibration,
    first: Annotated[str, typer.Argument(metavar="A", help=COMPARED, autocompletion=complete_configurations)],
    second: Annotated[str, typer.Argument(metavar="B", help=COMPARED, autocompletion=complete_configurations)],
    satellite: Annotated[str | None, typer.Option("--satellite", metavar=LETTERS, help="only its events")] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="page to write", callback=writable)] = None,
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


def export(
    event: Annotated[str, typer.Argument(metavar="EVENT", help="event with a report", autocompletion=complete_events)],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR|FILE.zip", help="EVENT.zip if not given")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment")] = None,
    json: Json = None,
) -> None:
    """Put reports, documents, models, products, provenance and citation of an event into one folder or zip."""
    from flows import export

    out = out or Path(f"{event}{f'-{as_}' if as_ else ''}.zip")
    files = export.export(event, out, as_)
    if output.delivered({"event": event, "out": str(out), "files": files}, json):
        output.say(f"{len(files)} files in {out}; CITATION.cff says what to cite")


def results(
    calibration: Some = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="CSV to write", callback=writable)] = None,
    json: Json = None,
) -> None:
    """List all delivered values with their errors; as CSV or JSON with links to report, document and product."""
    rows = command.results(calibration)
    if out is not None:
        from gravcal.browse import timeline

        out.write_text(timeline.csv_of(rows), encoding="utf-8")
    if output.delivered(rows, json):
        names = ("event", "calibration", "status", "quantity", "value", "unit")
        said = [row | {"value": rounded(row["value"], row["sigma_total"] or row["sigma"])} for row in rows]
        output.table(names, [[row[name] for name in names] for row in said])


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
            names = ("event", "calibration", "start", "stop", "state", "comment")
            output.table(names, [[row[name] for name in names] for row in document["events"]])
            names = ("name", "satellite", "time", "values", "comment")
            output.say("in force at the end of the file")
            output.table(names, [[row[name] for name in names] for row in document["in_force"]])
        return
    rows = command.events(calibration)
    if output.delivered(rows, json):
        names = ("event", "calibration", "date", "files")
        output.table(names, [[row[name] for name in names] for row in rows])


def _document(calibration, name):
    """Parameters, operational configuration and experiments, or only what is named."""
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
    if name in entries:
        entries[name]["reaches"] = command.reached(calibration, name)
    head = {"calibration": calibration, "operational": configurations.operational(calibration)}
    return head | {"promotions": configurations.promotions(calibration), "parameters": entries, "configurations": shown}


def _say(document):
    """Tables of parameters and configurations."""
    mark = lambda one: "" if one["value"] == one["catalogue"] else f"catalogue: {one['catalogue']}"  # noqa: E731
    rows = [[n, _short(e["value"]), e["unit"] or "", mark(e), ", ".join(e["stages"]), e["reason"]]
            for n, e in document["parameters"].items()]  # fmt: skip
    if rows:
        output.table(["parameter", "value", "unit", "", "stages", "reason"], rows)
    for one in document["parameters"].values():
        if one.get("reaches"):
            output.say(f"another value makes again: {', '.join(one['reaches'])}")
    output.say(f"operational: {_promoted(document['operational'])}")
    rows = [[name, ", ".join(configurations.said(given))] for name, given in document["configurations"].items()]
    if rows:
        output.table(["configuration", "differs from the catalogue in"], rows)


def _promoted(one):
    """An entry of the journal of promotions in words."""
    if not one["when"]:
        return "the catalogue"
    return f"{one['name']} is operational since {one['when'][:16].replace('T', ' ')} UTC ({one['who']}: {one['why']})"


def _short(value):
    """A value on one line."""
    text = str(value)
    return text if len(text) <= 40 else text[:37] + "..."


def effects(
    json: Annotated[Path | None, json_option("write the list")] = None,
) -> None:
    """List the effects that a simulation can hide, an estimator fit and discovery name."""
    from gravcal.effects import catalogue

    entries = [
        {
            "slug": slug,
            "channel": entry.channel,
            "reference": entry.reference,
            "parameters": [
                {"name": p.name, "unit": p.unit, "sign": p.meaning, "prior": p.prior_sigma} for p in entry.parameters
            ],
        }
        for slug, entry in sorted(catalogue().items())
    ]
    if output.delivered({"schema_version": "1.0", "effects": entries}, json):
        rows = [
            [e["slug"], e["channel"], ", ".join(f"{p['name']} [{p['unit']}]" for p in e["parameters"])] for e in entries
        ]
        output.table(["effect", "acts on", "parameters"], rows)


def series(
    calibration: Calibration,
    satellite: Annotated[
        str | None, typer.Option("--satellite", metavar=LETTERS, help="whose events; all if not given")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="page to write", callback=writable)] = Path(
        "series.html"
    ),
    json: Annotated[Path | None, json_option("write the rows")] = None,
) -> None:
    """Results of all events over the years, beside the published ones; for com_offset with the mass trims."""
    rows, page = command.series(calibration, satellite)
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
