"""The command that keeps results up to date by the clock and as data arrive."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output
from flows.cli_options import KINDS

FOLDER = "reprocess the events of this folder; otherwise those of the catalogue, with their files in GRAVCAL_DATA"

PRUNE = "after a run by the clock remove what nothing refers to and is older"
QUOTA = "and of the rest the oldest, until the store has less"


def serve(
    calibration: Annotated[str, typer.Argument(metavar="[CALIBRATION]", help=KINDS)] = "com_offset",
    cron: Annotated[
        str, typer.Option("--cron", metavar="'M H D M W'", help="when to reprocess all, UTC")
    ] = "0 3 * * *",
    watched: Annotated[Path | None, typer.Option("--watch", metavar="DIR", help="run when new data are here")] = None,
    every_s: Annotated[float, typer.Option("--every", metavar="SECONDS", min=0.1, help="between two looks")] = 60.0,
    data: Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)] = None,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar="C|D|CD|A|B|AB|T|S")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="processes here; 0: one, without Dask")] = None,
    prune_days: Annotated[float, typer.Option("--prune-days", metavar="DAYS", min=0.0, help=PRUNE)] = 30.0,
    quota_gb: Annotated[float | None, typer.Option("--quota-gb", metavar="GB", min=0.0, help=QUOTA)] = None,
) -> None:
    """Run campaigns by the clock and as data arrive, on a Prefect server of its own, until it is ended."""
    from flows import command
    from flows import serve as serving

    command.chosen(calibration, settings)
    for option, folder in (("--watch", watched), ("--data", data)):
        if folder is not None and not folder.is_dir():
            raise typer.BadParameter(f"{option} {folder}: found no folder, expected one with Level-1 files")
    given = {"calibration": calibration, "satellite": satellite, "settings": settings, "workers": workers}
    pruning = {"prune_days": prune_days, "quota_gb": quota_gb}
    served = serving.Served(cron, watched, every_s, data or watched, given, pruning)
    serving.serve(served, _said)


def _said(text):
    """One line, at once: the process goes on for long."""
    output.say(text)
    sys.stdout.flush()
