"""Commands on the store: list, show, verify, prune, history, rebuild."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output

products = typer.Typer(
    help="What lies in the store: list, show, verify, prune.", rich_markup_mode=None, no_args_is_help=True
)
Product = Annotated[str, typer.Argument(metavar="PRODUCT", help="EVENT/STAGE, beginning of a key, or path")]
Json = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="write as JSON ('-': standard output)")]


@products.command("list")
def list_products(
    event: Annotated[str | None, typer.Option("--event", help="only this event")] = None,
    stage: Annotated[str | None, typer.Option("--stage", help="only this stage")] = None,
    all_: Annotated[bool, typer.Option("--all", help="also those replaced by newer ones")] = False,
    json: Json = None,
) -> None:
    """List the products of the store."""
    from gravcal.data import housekeeping

    found = housekeeping.entries(event, stage, newest_only=not all_)
    document = [_summary(entry) for entry in found]
    output.write_json(document, json)
    if output.to_screen(json):
        rows = [[e.ref.name, e.ref.key[:12], e.record["bytes"], e.record["seconds"], e.record["made"]] for e in found]
        output.table(["product", "key", "bytes", "seconds", "made"], rows)


@products.command()
def show(product: Product, json: Json = None) -> None:
    """Show what one product holds and how it was made."""
    from gravcal.data import housekeeping

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
def verify() -> None:
    """Compare every product with its record, bytes and content; exit code 1 if one differs."""
    from gravcal.data import housekeeping

    problems = housekeeping.verify()
    for folder, problem in problems:
        output.say(f"{folder}: {problem}")
    output.say(f"{len(housekeeping.folders())} products, {len(problems)} problem(s)")
    raise typer.Exit(1 if problems else 0)


@products.command()
def prune(
    remove: Annotated[bool, typer.Option("--remove", help="do it; otherwise only say what would go")] = False,
    older: Annotated[float, typer.Option("--older-than-h", help="spare what is younger, hours")] = 1.0,
) -> None:
    """Remove what nothing refers to: products no readable link leads to, directly or as an input."""
    from gravcal.data import housekeeping

    unused = housekeeping.prune(older * 3600, remove)
    for path, size in unused:
        output.say(f"{size:>12}  {path}")
    verb = "removed" if remove else "would be removed (--remove does it)"
    output.say(f"{len(unused)} entries, {sum(size for _, size in unused) / 1e6:.1f} MB {verb}")


def history(product: Product, json: Json = None) -> None:
    """Print everything a product was made of, down to the raw files."""
    from gravcal.data import housekeeping, lineage

    node = lineage.tree(housekeeping.resolve(product))
    output.write_json(node, json)
    if output.to_screen(json):
        _print_node(node, 0, set())


def rebuild(product: Product, json: Json = None) -> None:
    """Make a product again from its raw files, in a store of its own, and compare."""
    from flows.remake import remake
    from gravcal.data import housekeeping

    outcome = remake(housekeeping.resolve(product))
    output.write_json(outcome, json)
    if output.to_screen(json):
        rows = [[one["stage"], one["verdict"], one["why"]] for one in outcome["stages"]]
        output.table(["stage", "content", "why"], rows)
        output.say(f"{outcome['product']}: {'equal, bit for bit' if outcome['equal'] else 'DIFFERENT'}")
    raise typer.Exit(0 if outcome["equal"] else 1)


def _summary(entry):
    """One product for JSON."""
    names = ("key", "digest", "bytes", "seconds", "made", "machine", "stage")
    known = {name: entry.record.get(name) for name in names}
    return {"product": entry.ref.name, "path": str(entry.ref.path), "newest": entry.newest} | known


def _print_node(node, depth, seen):
    """Print a product, its settings and its inputs, each product once."""
    indent = "  " * depth
    if node["record"] is None:
        digest = f"  sha256 {node['digest'][:12]}" if "digest" in node else "  (no longer in the store)"
        output.say(f"{indent}{node['name']}{digest}")
        return
    record = node["record"]
    key = record["key"]
    again = "  (see above)" if key in seen else ""
    output.say(f"{indent}{node['name']}  {key[:12]}  version {record['recipe']['version']}  {record['made']}{again}")
    if again:
        return
    seen.add(key)
    for name, value in record["recipe"]["settings"].items():
        output.say(f"{indent}  . {name} = {value}")
    for inner in node["inputs"]:
        _print_node(inner, depth + 1, seen)
