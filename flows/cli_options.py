"""Arguments and options that several commands share; what is wrong with them is said before anything runs."""

import datetime
from pathlib import Path
from typing import Annotated

import typer

from flows import cli_complete, engine
from flows.calibration import known
from gravcal.store import history


def writable(ctx: typer.Context, path: Path | None) -> Path | None:
    """Path of a file that can be written; its folder is made, and what stands there is left alone."""
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


def day(ctx: typer.Context, text: str | None) -> str | None:
    """Day of the calendar, written YYYY-MM-DD."""
    if text is None or ctx.resilient_parsing:
        return text
    try:
        if str(datetime.date.fromisoformat(text)) == text:
            return text
    except ValueError:
        pass
    raise typer.BadParameter(f"{text} is no day of the calendar, expected YYYY-MM-DD.")


def json_option(text):
    """Option for a document: a file, or '-' for standard output."""
    return typer.Option("--json", metavar="FILE", help=f"{text} ('-': standard output)", callback=writable)


LETTERS = "C|D|CD|A|B|AB|T|S"
EVENT = "event of the catalogue, such as grace-c-2020-02-01"
FOLDER = "folder with Level-1 files or daily archives"
MODEL = "extended model, as gravcal discover writes it"
KINDS = ", ".join(known())
OTHER = "another value of a parameter"
HISTORY = "Prefect keeps a history of runs"
Calibration = Annotated[
    str, typer.Argument(metavar="CALIBRATION", help=KINDS, autocompletion=cli_complete.calibrations)
]
EventName = Annotated[str | None, typer.Argument(metavar="[EVENT]", help=EVENT, autocompletion=cli_complete.events)]
Data = Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)]
Satellite = Annotated[str | None, typer.Option("--satellite", metavar=LETTERS, help="which satellite of the folder")]
Date = Annotated[str | None, typer.Option("--date", metavar="YYYY-MM-DD", help="which day of the folder", callback=day)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help=OTHER, autocompletion=cli_complete.settings),
]
Json = Annotated[Path | None, json_option("write the result document")]
AS = "name of the experiment that --set or --model make; alone: a recorded experiment again"
As = Annotated[str | None, typer.Option("--as", metavar="NAME", help=AS, autocompletion=cli_complete.configurations)]
Model = Annotated[Path | None, typer.Option("--model", metavar="FILE", help=MODEL)]
Seed = Annotated[int, typer.Option("--seed", help="source of everything random")]
Engine = Annotated[
    str, typer.Option("--engine", metavar="prefect|inline", help=HISTORY, autocompletion=cli_complete.engines)
]
Effects = Annotated[
    list[str] | None,
    typer.Option("--effect", metavar="SLUG.PARAMETER=VALUE", autocompletion=cli_complete.effects),
]
OTHERS = "make again what other versions of numpy, scipy or numba made"
RemakeVersions = Annotated[
    bool,
    typer.Option("--remake-versions", help=OTHERS, envvar=history.REMAKE, callback=engine.remake_versions),
]
