"""Commands on what is known: effects of the forward model, and the history of a satellite."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output


def effects(
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write the list ('-': standard output)")
    ] = None,
) -> None:
    """List the effects that a simulation can hide, an estimator fit and discovery name."""
    from gravcal.effects import catalogue

    entries = [
        {
            "slug": slug,
            "channel": entry.channel,
            "reference": entry.reference,
            "parameters": [
                {"name": p.name, "unit": p.unit, "sign": p.meaning, "prior": p.prior_sigma} for p in entry.parameters
            ],
        }
        for slug, entry in sorted(catalogue().items())
    ]
    output.write_json({"schema_version": "1.0", "effects": entries}, json)
    if output.to_screen(json):
        rows = [
            [e["slug"], e["channel"], ", ".join(f"{p['name']} [{p['unit']}]" for p in e["parameters"])] for e in entries
        ]
        output.table(["effect", "acts on", "parameters"], rows)


def series(
    calibration: Annotated[str, typer.Argument(metavar="CALIBRATION", help="com_offset")],
    satellite: Annotated[str, typer.Option("--satellite", metavar="C|D", help="whose events")] = "C",
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="page to write")] = Path("series.html"),
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write the rows ('-': standard output)")
    ] = None,
) -> None:
    """Results of all events of a satellite over the years, beside the published ones, trims drawn in."""
    from flows import command

    rows, page = command.flow_module(calibration).series(satellite)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(page)
    output.write_json({"schema_version": "1.0", "satellite": satellite, "rows": rows}, json)
    if output.to_screen(json):
        output.say(f"{len(rows)} rows in {out}")


def save_event(calibration, source, document):
    """Name of the event stored in the user's own catalogue with its manoeuvres and the digests of its files."""
    from datetime import date, timedelta

    from flows import command
    from gravcal.data import catalog, memo

    files = command.flow_module(calibration).level_one_files(source)
    digests = {file.name: memo.file_digest(file.path, file.member) for file in files}
    first = date(2000, 1, 1) + timedelta(
        days=(min((m["start"] for m in document["manoeuvres"]), default=0) / 86400) + 0.5
    )
    day, letters = date.fromisoformat(source.date) if source.date else first, tuple(source.satellite)
    text = catalog.event_text(calibration, letters, day, document["manoeuvres"], digests)
    return catalog.save_event(source.event, text).name
