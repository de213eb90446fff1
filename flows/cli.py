"""The command line: `gravcal`.

Commands only read their arguments, call a flow or the store, and say what came out. What belongs to one calibration
is asked of the module `flows.<calibration>`: source, calibrate, document, detect, detected, simulate.
"""

import sys
from pathlib import Path
from typing import Annotated

import typer

from flows import (
    cli_browse,
    cli_campaign,
    cli_catalogue,
    cli_complete,
    cli_configurations,
    cli_discover,
    cli_fetch,
    cli_serve,
    cli_store,
)
from flows import cli_output as output
from flows.cli_options import (
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
)
from flows.engine import single_threaded

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
gravcal report EVENT                                  where the report is
gravcal browse                                        events, plots, comparisons and reports in a web browser
gravcal products                                      what lies in the store (GRAVCAL_PRODUCTS)
"""

app = typer.Typer(help=HELP, rich_markup_mode=None, pretty_exceptions_enable=False, no_args_is_help=True)
LAST = "event whose last report is wanted"


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
    from flows import command

    chosen = command.chosen(calibration, settings, model, as_)
    with output.failures(calibration, event or str(data), json, chosen.configuration):
        source = command.source(calibration, event, data, satellite, date)
    with output.failures(calibration, source, json, chosen.configuration):
        command.recorded(chosen)
        document, ref = command.calibrate(calibration, source, chosen, engine)
    output.write_json(document, json)
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
    json: Json = None,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
) -> None:
    """Say what a run would reuse, what it would make, and why; without EVENT or folder for all events of the store."""
    from flows import command

    chosen = command.chosen(calibration, settings, model, as_)
    sources = command.sources(calibration, event, data, satellite, date)
    output.plan([step for source in sources for step in command.plan(calibration, source, chosen)], json)


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
    from flows import command

    chosen = command.recorded(command.chosen(calibration, settings))
    source = command.source(calibration, event, data, satellite, date)
    document = command.detect(calibration, source, chosen)
    output.write_json(document, json)
    output.manoeuvres(document, json)
    if save:
        output.say(f"stored as event {cli_catalogue.save_event(calibration, source, document)}")
    raise typer.Exit(0 if document["manoeuvres"] else 3)


@app.command()
def simulate(
    calibration: Calibration,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder for the Level-1 files")],
    seed: Seed = 1,
    truth: Annotated[Path | None, typer.Option("--truth", metavar="FILE", help="where to write the truth")] = None,
    effect: Effects = None,
    settings: Settings = None,
    json: Json = None,
) -> None:
    """Write the Level-1 files of an invented event; the truth goes to a file of its own that no run reads."""
    from flows import command

    command.simulate(calibration, out, (seed, truth), effect, settings)
    files = sorted(str(path) for path in out.iterdir() if path.is_file())
    output.write_json({"calibration": calibration, "folder": str(out), "seed": seed, "files": files}, json)
    if output.to_screen(json):
        output.say(f"Level-1 files of an invented event in {out}" + (f", truth in {truth}" if truth else ""))


@app.command()
def demo(
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="keep the Level-1 files here")] = None,
    seed: Seed = 1,
    engine: Engine = "prefect",
    json: Json = None,
) -> None:
    """Simulate a calibration day, process it as if it were measured, and print estimate beside truth."""
    from flows import command

    document, ref, truth = command.demo(out, seed, engine)
    output.write_json(document, json)
    output.comparison(document, truth, ref, json)
    raise typer.Exit(command.EXIT.get(document.get("status"), 1))


@app.command()
def report(
    event: Annotated[str, typer.Argument(metavar="EVENT", help=LAST, autocompletion=cli_complete.events)],
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="copy the report's files here")] = None,
    as_: Annotated[str | None, typer.Option("--as", metavar="NAME", help="of this experiment")] = None,
    json: Json = None,
) -> None:
    """Say where the last report of an event is, or copy it."""
    from flows import command

    files = [str(path) for path in command.report_files(event, out, as_)]
    output.write_json({"event": event, "files": files}, json)
    for path in files if output.to_screen(json) else ():
        output.say(path)


app.command()(cli_browse.browse)
app.command()(cli_discover.discover)
app.command()(cli_campaign.campaign)
app.command()(cli_fetch.fetch)
app.command()(cli_serve.serve)
app.command()(cli_catalogue.effects)
app.command()(cli_catalogue.series)
app.command()(cli_configurations.settings)
app.command()(cli_configurations.promote)
app.command()(cli_configurations.compare)
app.command()(cli_configurations.events)
app.add_typer(cli_store.products, name="products")
app.command()(cli_store.history)
app.command()(cli_store.rebuild)


def main() -> None:
    """Entry point: errors of gravcal on one screen, others into a file."""
    from gravcal.errors import GravcalError

    single_threaded()
    try:
        app()
    except GravcalError as error:
        from flows import command

        output.error(error)
        sys.exit(command.EXIT[command.status_of(error)])
    except Exception as error:  # noqa: BLE001
        output.unexpected(error)
        sys.exit(1)


if __name__ == "__main__":
    main()
