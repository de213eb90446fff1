"""Commands on configurations: settings, promote, compare; and the events of the catalogue."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_complete
from flows import cli_output as output
from flows.cli_options import KINDS, LETTERS, Calibration, json_option, writable

COMPARED = "operational, catalogue, or an experiment"
NAMED = "experiment, or catalogue"
SHOWN = "parameter or configuration"
Some = Annotated[
    str | None, typer.Argument(metavar="[CALIBRATION]", help=KINDS, autocompletion=cli_complete.calibrations)
]
Json = Annotated[Path | None, json_option("write as JSON")]


def settings(
    calibration: Some = None,
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help=SHOWN, autocompletion=cli_complete.configurations)
    ] = None,
    forget: Annotated[bool, typer.Option("--forget", help="remove this experiment and its links")] = False,
    json: Json = None,
) -> None:
    """Show parameters with value, unit and reason, and the configurations that were run."""
    from flows import command
    from gravcal import catalog
    from gravcal.store import configurations

    if calibration is None:
        found = {one: configurations.operational(one) for one in command.known()}
        output.write_json(found, json)
        if output.to_screen(json):
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
    output.write_json(document, json)
    if output.to_screen(json):
        _say(document)


def promote(
    calibration: Calibration,
    name: Annotated[str, typer.Argument(metavar="NAME", help=NAMED, autocompletion=cli_complete.configurations)],
    why: Annotated[str, typer.Option("--why", metavar="TEXT", help="for the journal of promotions")],
    who: Annotated[str | None, typer.Option("--who", metavar="NAME", help="by default the user")] = None,
    json: Json = None,
) -> None:
    """Make an experiment the operational configuration, or the catalogue again; later plain runs use its settings."""
    from flows import command
    from gravcal.store import configurations

    command.record(calibration)
    made = configurations.promote(calibration, name, why, who)
    output.write_json(made, json)
    if output.to_screen(json):
        output.say(f"{calibration}: {_promoted(made)}")
        output.say("Links and reports follow with the next run or campaign; gravcal plan says what that makes again.")


def compare(
    calibration: Calibration,
    first: Annotated[str, typer.Argument(metavar="A", help=COMPARED, autocompletion=cli_complete.configurations)],
    second: Annotated[str, typer.Argument(metavar="B", help=COMPARED, autocompletion=cli_complete.configurations)],
    satellite: Annotated[str | None, typer.Option("--satellite", metavar=LETTERS, help="only its events")] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="page to write", callback=writable)] = None,
    json: Json = None,
) -> None:
    """Say what changes between two configurations, for every event that both have: values, verdicts, checks."""
    from flows import command
    from gravcal.report import comparison

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


def events(calibration: Some = None, json: Json = None) -> None:
    """List the events of the catalogue, and whether their files are at hand in GRAVCAL_DATA."""
    from flows import command

    rows = command.events(calibration)
    output.write_json(rows, json)
    if output.to_screen(json):
        names = ("event", "calibration", "date", "files")
        output.table(names, [[row[name] for name in names] for row in rows])


def _document(calibration, name):
    """Parameters, operational configuration and experiments, or only what is named."""
    from gravcal import catalog
    from gravcal.store import configurations

    known = {one: configurations.settings_of(calibration, one) for one in configurations.names(calibration)}
    plain, used = catalog.parameters(calibration), configurations.chosen(calibration, {})
    names, shown = list(plain.entries), known
    if name in plain.entries:
        names, shown = [name], {one: given for one, given in known.items() if name in given}
    elif name is not None:
        shown = {name: configurations.settings_of(calibration, name)}
        used = plain.with_settings(shown[name])
        names = list(shown[name])
    parts = ("unit", "minimum", "maximum", "allowed", "reason")
    entries = {
        n: {"value": used.entry(n).value, "catalogue": plain.entry(n).value}
        | {part: getattr(plain.entry(n), part) for part in parts}
        for n in names
    }
    head = {"calibration": calibration, "operational": configurations.operational(calibration)}
    return head | {"promotions": configurations.promotions(calibration), "parameters": entries, "configurations": shown}


def _say(document):
    """Tables of parameters and configurations."""
    from gravcal.store import configurations

    mark = lambda one: "" if one["value"] == one["catalogue"] else f"catalogue: {one['catalogue']}"  # noqa: E731
    rows = [[n, _short(e["value"]), e["unit"] or "", mark(e), e["reason"]] for n, e in document["parameters"].items()]
    if rows:
        output.table(["parameter", "value", "unit", "", "reason"], rows)
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
