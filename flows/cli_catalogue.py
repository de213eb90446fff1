"""Commands on what is known: effects of the forward model, and the history of a satellite."""

from pathlib import Path
from typing import Annotated

import typer

from flows import cli_output as output
from flows.cli_options import LETTERS, Calibration, json_option, writable


def effects(
    json: Annotated[Path | None, json_option("write the list")] = None,
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
    calibration: Calibration,
    satellite: Annotated[
        str | None, typer.Option("--satellite", metavar=LETTERS, help="whose events; all if not given")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="page to write", callback=writable)] = Path(
        "series.html"
    ),
    json: Annotated[Path | None, json_option("write the rows")] = None,
) -> None:
    """Results of all events over the years, beside the published ones; for com_offset with the mass trims."""
    from flows import command
    from gravcal.store import location, schemas

    rows, page = command.series(calibration, satellite)
    status = "delivered" if rows else "no_data"
    said = {"schema_version": schemas.VERSION, "status": status, "calibration": calibration, "satellite": satellite}
    output.write_json(said | {"rows": rows}, json)
    if rows:
        out.write_text(page, encoding="utf-8")
    if output.to_screen(json):
        whose = f"{calibration}{f' of {satellite}' if satellite else ''}"
        none = f"no result of {whose} in {location.folder()}; {out} is left as it was"
        output.say(f"{len(rows)} rows in {out}" if rows else none)
    raise typer.Exit(command.EXIT[status])


def save_event(calibration, source, document):
    """Name of the event stored in the user's own catalogue with its manoeuvres and the digests of its files."""
    from datetime import date, timedelta

    from flows import command
    from gravcal import catalog
    from gravcal.store import memory

    known = command.record(calibration)
    files = known.level_one_files(source)
    digests = {file.name: memory.file_digest(file.path, file.member) for file in files}
    first = date(2000, 1, 1) + timedelta(
        days=(min((m["start"] for m in document["manoeuvres"]), default=0) / 86400) + 0.5
    )
    day, letters = date.fromisoformat(source.date) if source.date else first, tuple(source.satellite)
    text = catalog.event_text(
        calibration, known.design, letters, day, document["manoeuvres"], digests, document["origin"]
    )
    return catalog.save_event(source.event, text).name
