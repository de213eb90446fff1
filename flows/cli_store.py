"""Commands on the store: list, show, verify, prune, pin, unpin, history, rebuild."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_complete, cli_progress
from flows import cli_output as output
from flows.cli_options import json_option

products = typer.Typer(
    help="What lies in the store: list (also without a word), show, verify, prune, pin, unpin.", rich_markup_mode=None
)
VERIFIED_BYTES_PER_S = 100e6  # read, hashed and decoded on one core; only for the time left
WHICH = "EVENT/STAGE, EVENT/as/NAME/STAGE, beginning of a key, or path"
DROPPED = "also what only experiments of this name (or pattern) refer to, with their links"
Product = Annotated[str, typer.Argument(metavar="PRODUCT", help=WHICH, autocompletion=cli_complete.products)]
Json = Annotated[Path | None, json_option("write as JSON")]


@products.callback(invoke_without_command=True)
def without_word(context: typer.Context) -> None:
    """What lies in the store: list (also without a word), show, verify, prune, pin, unpin."""
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
    from gravcal.store import housekeeping

    found = housekeeping.entries(event, stage, newest_only=not all_, configuration=as_)
    document = [_summary(entry) for entry in found]
    output.write_json(document, json)
    if output.to_screen(json):
        names = ("bytes", "seconds", "made")
        rows = [[e.ref.name, e.ref.key[:12], *(e.record[n] for n in names), ", ".join(e.configurations)] for e in found]
        output.table(["product", "key", *names, "configuration"], rows)


@products.command()
def show(product: Product, json: Json = None) -> None:
    """Show what one product holds and how it was made."""
    from gravcal.store import housekeeping

    entry = housekeeping.resolve(product)
    output.write_json(entry.record, json)
    if not output.to_screen(json):
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
    from gravcal.store import housekeeping

    size = sum(entry.record["bytes"] for entry in housekeeping.entries(newest_only=False))
    with cli_progress.waiting("verifying", size / VERIFIED_BYTES_PER_S):
        problems = housekeeping.verify()
    count = len(housekeeping.folders())
    rows = [{"folder": str(folder), "problem": problem} for folder, problem in problems]
    output.write_json({"products": count, "problems": rows}, json)
    if output.to_screen(json):
        for row in rows:
            output.say(f"{row['folder']}: {row['problem']}")
        output.say(f"{count} products, {len(problems)} problem(s)")
    raise typer.Exit(1 if problems else 0)


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
    from gravcal.store import housekeeping, location

    if configuration == location.OPERATIONAL:
        raise typer.BadParameter("--configuration: the operational one is delivered; expected an experiment's name")
    age, limit = (None if value is None else value * scale for value, scale in ((older, 3600), (quota, 1e9)))
    unused = housekeeping.prune(age, remove, limit, configuration)
    output.write_json([{"path": str(path), "bytes": size, "removed": remove} for path, size in unused], json)
    if not output.to_screen(json):
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
    from gravcal.store import housekeeping

    entry = housekeeping.resolve(product)
    housekeeping.pin(entry)
    output.write_json({"product": entry.ref.name, "key": entry.ref.key, "pinned": True}, json)
    if output.to_screen(json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} is pinned")


@products.command()
def unpin(product: Product, json: Json = None) -> None:
    """Let a pinned product go like any other."""
    from gravcal.store import housekeeping

    entry = housekeeping.resolve(product)
    was = housekeeping.unpin(entry)
    output.write_json({"product": entry.ref.name, "key": entry.ref.key, "pinned": False}, json)
    if output.to_screen(json):
        output.say(f"{entry.ref.name} {entry.ref.key[:12]} {'is no longer' if was else 'was not'} pinned")


def history(
    product: Product,
    settings: Annotated[bool, typer.Option("--settings", help="with the settings of each")] = False,
    json: Json = None,
) -> None:
    """Print everything a product was made of, down to the raw files."""
    from gravcal.store import history, housekeeping

    node = history.tree(housekeeping.resolve(product))
    output.write_json(node, json)
    if output.to_screen(json):
        heads = ["product or file", "key or digest", "version", "made"]
        output.table(heads, list(_history_rows(node, 0, set(), settings)))


def rebuild(product: Product, json: Json = None) -> None:
    """Make a product again from its raw files, in a store of its own, and compare."""
    from flows.remake import remake
    from gravcal.store import history, housekeeping

    entry = housekeeping.resolve(product)
    with cli_progress.waiting("rebuilding", history.seconds(entry)):
        outcome = remake(entry)
    output.write_json(outcome, json)
    if output.to_screen(json):
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
