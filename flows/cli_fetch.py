"""The command that brings Level-1 archives from the official archives."""

import contextlib
import datetime
import sys
from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output
from flows.cli_options import Date, json_option


def fetch(
    event: Annotated[str | None, typer.Argument(metavar="[EVENT]", help="event of the catalogue")] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="folder for the archives")] = ...,
    satellite: Annotated[str | None, typer.Option("--satellite", metavar="C|D|CD|A|B|AB")] = None,
    date: Date = None,
    place: Annotated[
        str, typer.Option("--from", metavar="podaac|isdc|URL", help="isdc needs no login, podaac that of Earthdata")
    ] = "isdc",
    json: Annotated[Path | None, json_option("list")] = None,
) -> None:
    """Fetch the daily Level-1 archives of an event or day; what broke off is resumed, what is there is kept."""
    from gravcal.io import fetch as fetching

    archives = _archives(event, satellite, date)
    with _progress() as listener:
        output.note(f"asking {place.rpartition('@')[2]} for {len(archives)} archive(s), from {archives[0].name} on")
        fetched = fetching.fetch(archives, out, place, listener, fetching.Patience(tell=output.note))
    names = ("path", "state", "checked", "size")
    rows = [{name: getattr(one, name) for name in names} | {"path": str(one.path)} for one in fetched]
    output.write_json(rows, json)
    if output.to_screen(json):
        output.table(["archive", "state", "checked by", "bytes"], [[row[name] for name in names] for row in rows])


def _archives(event, satellite, date):
    """Archives wanted by event, or by satellite and date."""
    from gravcal import catalog
    from gravcal.io import fetch as fetching

    if (event is None) == (satellite is None or date is None) or (event and (satellite or date)):
        raise typer.BadParameter("give an EVENT of the catalogue, or --satellite and --date")
    if event:
        return fetching.of_event(catalog.event(event))
    if satellite not in ("A", "B", "AB", "C", "D", "CD"):
        raise typer.BadParameter(f"--satellite {satellite}: expected A, B, AB, C, D or CD")
    return fetching.of_day(satellite, datetime.date.fromisoformat(date))


@contextlib.contextmanager
def _progress():
    """Listener that shows a bar for each archive, if standard error is a terminal; otherwise None."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bars:
        rows = {}

        def listener(name, done, total):
            if name not in rows:
                rows[name] = bars.add_task(name, total=total)
            bars.update(rows[name], completed=done, total=total)

        yield listener
