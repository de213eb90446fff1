"""The command that processes many events."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output
from flows import cli_progress
from flows.cli_options import LETTERS, As, Calibration, Engine, Model, RemakeVersions, Settings, json_option

FOLDER = "folder with Level-1 files of many days, or with one folder per event"


def campaign(
    calibration: Calibration,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar=LETTERS)] = None,
    data: Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)] = None,
    settings: Settings = None,
    model: Model = None,
    as_: As = None,
    scheduler: Annotated[str | None, typer.Option("--scheduler", metavar="tls://HOST:PORT")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="processes here; 0: none but this")] = None,
    only_failed: Annotated[bool, typer.Option("--only-failed", help="try again what failed the last time")] = False,
    remake_versions: RemakeVersions = False,  # noqa: ARG001 - its callback
    engine: Engine = "prefect",
    json: Annotated[Path | None, json_option("summary")] = None,
) -> None:
    """Calibrate all events of a satellite, in parallel; a failed event is tabulated and stops no other."""
    from flows import campaign as flow
    from flows import command

    chosen = command.chosen(calibration, settings, model, as_)
    if engine not in ("prefect", "inline"):
        raise typer.BadParameter(f"--engine {engine}: expected prefect or inline")
    sources = flow.sources(calibration, satellite, data)
    command.recorded(chosen)
    campaign_ = flow.Campaign(calibration, chosen, engine, scheduler, workers, again=only_failed)
    if only_failed:
        sources = flow.failed_last(campaign_, sources)
        if not sources and output.to_screen(json):
            output.say("nothing failed the last time")
    with cli_progress.events_progress(len(sources)) as listener:
        summary = flow.run(campaign_, sources, listener)
    output.write_json(summary, json)
    output.campaign(summary, json)
    raise typer.Exit(flow.exit_code(summary))
