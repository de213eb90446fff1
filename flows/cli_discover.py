"""The command `gravcal discover`."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_complete
from flows import cli_output as output
from flows.cli_options import KINDS, As, Data, Date, Engine, EventName, Json, Model, RemakeVersions, Satellite, Settings

VIEWS = "attitude, ranging, magnetometer, published_table"
PAGE = "page to write; of a view of measured data discovery_VIEW.html here if not given, of a calibration a copy"
WHAT = f"{KINDS}, or a view of measured data: {VIEWS}"


def discover(
    calibration: Annotated[
        str, typer.Argument(metavar="CALIBRATION", help=WHAT, autocompletion=cli_complete.calibrations)
    ],
    event: EventName = None,
    data: Data = None,
    satellite: Satellite = None,
    date: Date = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help=PAGE)] = None,
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
) -> None:
    """Show what the simulation of an event gets wrong, name the cause, extend the model and measure the gain."""
    from flows import command, discover

    if calibration not in discover.names() and calibration in discover.measured_views():
        if model is not None or as_ is not None:
            raise typer.BadParameter(
                f"--model and --as belong to a calibration ({', '.join(discover.names())}), not to a view"
            )
        document, page = discover.measured(calibration, data, satellite, date, command.pairs(settings))
        files = [_written(page, out or Path(f"discovery_{calibration}.html"))]
    else:
        chosen = command.chosen(calibration, settings, model, as_)
        with output.failures(calibration, event or str(data), json, chosen.configuration):
            source = command.source(calibration, event, data, satellite, date)
        with output.failures(calibration, source, json, chosen.configuration):
            command.recorded(chosen)
            document, files = command.discover(calibration, source, chosen, engine)
        pages = [path.read_text() for path in files if path.name == "discovery.html"]
        files += [_written(page, out) for page in pages if out]
    output.write_json(document, json)
    if output.to_screen(json):
        _say(document, files)
    raise typer.Exit(command.EXIT.get(document.get("status"), 1))


def _written(page, path):
    """Path of a page that is written there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page)
    return path


def _say(document, files):
    """Verdict, findings and where the files are."""
    from gravcal.report import discovery

    output.say(f"{document['event']}: {discovery.verdict(document)}")
    rows = []
    for one in document.get("findings", []):
        for name, parameter in one["parameters"].items():
            if parameter["value"] is not None:
                rows.append([one.get("in", ""), one["cause"], name, *discovery.scaled(parameter)])
    if rows:
        several = len({row[0] for row in rows}) > 1
        heads = ["search", "cause", "parameter", "value", "unit"]
        output.table(heads[not several :], [row[not several :] for row in rows])
    change = document.get("calibration_change", {})
    if rows and change.get("change"):
        names = zip(change["names"], change["change"], change["change_in_old_sigma"], strict=True)
        moved = ", ".join(f"{n} {c:+.3g} ({s:+.1f} old sigma)" for n, c, s in names if c is not None and s is not None)
        output.say(f"Calibration result moves by {moved or 'what cannot be said'} {change['unit']}.")
    for path in files:
        output.say(str(path))
