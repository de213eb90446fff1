"""The command that processes many events."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output
from flows import cli_progress

FOLDER = "folder with Level-1 files of many days, or with one folder per event"


def campaign(
    calibration: Annotated[str, typer.Argument(metavar="CALIBRATION", help="com_offset")],
    satellite: Annotated[str | None, typer.Option("--satellite", metavar="C|D|CD|A|B|AB|T|S")] = None,
    data: Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
    scheduler: Annotated[str | None, typer.Option("--scheduler", metavar="tcp://HOST:PORT")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="processes here; 0: none but this")] = None,
    engine: Annotated[str, typer.Option("--engine", metavar="prefect|inline")] = "prefect",
    json: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="summary ('-': standard output)")] = None,
) -> None:
    """Calibrate all events of a satellite, in parallel; a failed event is tabulated and stops no other."""
    from flows import campaign as flow
    from flows import command

    chosen = command.chosen(calibration, settings)
    if engine not in ("prefect", "inline"):
        raise typer.BadParameter(f"--engine {engine}: expected prefect or inline")
    sources = flow.sources(calibration, satellite, data)
    with cli_progress.events_progress(len(sources)) as listener:
        summary = flow.run(flow.Campaign(calibration, chosen, engine, scheduler, workers), sources, listener)
    output.write_json(summary, json)
    output.campaign(summary, json)
    raise typer.Exit(flow.exit_code(summary))
