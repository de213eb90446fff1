"""Arguments and options that several commands share, and what the shell offers when a word of them is completed.

What is wrong with them is said before anything runs.
"""

import contextlib
import datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flows import engine
from flows.calibration import known
from flows.engine import ENGINES
from gravcal import catalog
from gravcal.store import history, location


def complete_calibrations(incomplete: str) -> list[str]:
    """Calibrations that begin so."""
    return _beginning(known(), incomplete)


def complete_events(incomplete: str) -> list[str]:
    """Events of the catalogue and of the store."""
    names = {path.name for path in (location.folder() / "latest").glob("*")}
    with contextlib.suppress(Exception):  # a broken catalogue must not break the shell
        names |= {event.name for event in catalog.events()}
    return _beginning(sorted(names), incomplete)


def complete_products(incomplete: str) -> list[str]:
    """Products that the readable links name: EVENT/STAGE."""
    latest = location.folder() / "latest"
    links = sorted(link for link in latest.rglob("*") if link.is_symlink())
    return _beginning([str(link.relative_to(latest)) for link in links], incomplete)


def complete_settings(ctx, incomplete: str) -> list[str]:
    """Parameters of the calibration that was named, with an equals sign."""
    name = _calibration_of(ctx)
    simulated = ctx.info_name == "simulate"
    with contextlib.suppress(Exception):
        known = catalog.parameters(f"simulate_{name}" if simulated else name)
        return _beginning([f"{one}=" for one in known.entries], incomplete)
    return []


def complete_configurations(ctx, incomplete: str) -> list[str]:
    """Recorded experiments of the calibration that was named; what else the commands on configurations take."""
    from gravcal.store import configurations as known

    with contextlib.suppress(Exception):
        name = _calibration_of(ctx)
        more = {"compare": [known.OPERATIONAL, known.CATALOGUE], "promote": [known.CATALOGUE]}.get(ctx.info_name, [])
        more += list(catalog.parameters(name).entries) if ctx.info_name == "settings" else []
        return _beginning([*known.names(name), *more], incomplete)
    return []


def complete_effects(incomplete: str) -> list[str]:
    """Parameters of the effects, with an equals sign."""
    from gravcal.effects import catalogue

    return _beginning(
        [f"{slug}.{p.name}=" for slug, e in sorted(catalogue().items()) for p in e.parameters], incomplete
    )


def _calibration_of(ctx):
    """Calibration that was named before; an option without its value ends the parsing, and its words are left over."""
    return next((word for word in [ctx.params.get("calibration"), *ctx.args] if word in known()), "")


def _beginning(names, incomplete):
    """Those that begin with what was typed."""
    return [name for name in names if name.startswith(incomplete)]


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
Calibration = Annotated[str, typer.Argument(metavar="CALIBRATION", help=KINDS, autocompletion=complete_calibrations)]
EventName = Annotated[str | None, typer.Argument(metavar="[EVENT]", help=EVENT, autocompletion=complete_events)]
Data = Annotated[Path | None, typer.Option("--data", metavar="DIR", help=FOLDER)]
Satellite = Annotated[str | None, typer.Option("--satellite", metavar=LETTERS, help="which satellite of the folder")]
Date = Annotated[str | None, typer.Option("--date", metavar="YYYY-MM-DD", help="which day of the folder", callback=day)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help=OTHER, autocompletion=complete_settings),
]
Json = Annotated[Path | None, json_option("write the result document")]
AS = "name of the experiment that --set or --model make; alone: a recorded experiment again"
As = Annotated[str | None, typer.Option("--as", metavar="NAME", help=AS, autocompletion=complete_configurations)]
Model = Annotated[Path | None, typer.Option("--model", metavar="FILE", help=MODEL)]
Seed = Annotated[int, typer.Option("--seed", help="source of everything random")]
EngineName = StrEnum("EngineName", ENGINES)
Engine = Annotated[EngineName, typer.Option("--engine", help=HISTORY)]
Effects = Annotated[
    list[str] | None,
    typer.Option("--effect", metavar="SLUG.PARAMETER=VALUE", autocompletion=complete_effects),
]
OTHERS = "make again what other versions of numpy, scipy or numba made"
RemakeVersions = Annotated[
    bool,
    typer.Option("--remake-versions", help=OTHERS, envvar=history.REMAKE, callback=engine.remake_versions),
]
