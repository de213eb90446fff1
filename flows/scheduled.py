"""Campaigns as Prefect deployments: "reprocess-all" by the clock, "new-data" when a folder changed.

The page of a run shows the state of each event, a table of the offsets, and links to the reports.
"""

import contextvars
import hashlib
import os
import threading
from pathlib import Path

import prefect
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from prefect.states import Completed, Failed

from flows import campaign, command, watch
from gravcal.data import location, memo

REPORTS = "GRAVCAL_REPORTS"  # address under which the store's objects are served, if they are
AXES = "xyz"


@prefect.flow(name="reprocess-all", persist_result=False)
def reprocess_all(
    calibration: str = "com_offset",
    satellite: str | None = None,
    data: str | None = None,
    settings: list[str] | None = None,
    workers: int | None = None,
):
    """All events of the catalogue, or of a folder; what has not changed is reused."""
    return _campaign(calibration, satellite, data, settings, workers)


@prefect.flow(name="new-data", persist_result=False)
def new_data(
    data: str,
    calibration: str = "com_offset",
    satellite: str | None = None,
    settings: list[str] | None = None,
    workers: int | None = None,
):
    """All events of a folder, if its inventory is not that of the last run."""
    asked = repr([str(Path(data).absolute()), calibration, satellite, settings])
    name = "watched-" + hashlib.sha256(asked.encode()).hexdigest()[:32]
    found = watch.digest(Path(data))
    if found is None or memo.recall(name) == found:
        return Completed(name="Nothing new", message=f"{data}: nothing that the last run has not seen")
    state = _campaign(calibration, satellite, data, settings, workers)
    memo.remember(name, found)
    return state


def _campaign(calibration, satellite, data, settings, workers):
    """State of a campaign inside the flow that is running."""
    chosen = command.chosen(calibration, settings)
    sources = campaign.sources(calibration, satellite, Path(data) if data else None)
    context, turn = contextvars.copy_context(), threading.Lock()

    def listener(row):
        with turn:
            context.run(_record, row)

    summary = campaign.run(campaign.Campaign(calibration, chosen, "inline", None, workers), sources, listener)
    _show(summary)
    return _state(summary)


def _record(row):
    """Show the state of one event as a task of the run that bears its name."""

    def event():
        if row["status"] == "failed":
            return Failed(message=row["error"])
        message = f"{row['made']} products made, {row['reused']} reused, {row['seconds']} s"
        return Completed(name=row["status"].replace("_", " ").capitalize(), message=message)

    prefect.task(event, name=str(row["event"]), cache_policy=NO_CACHE, persist_result=False)(return_state=True)


def _show(summary):
    """Table of offsets and list of reports as artifacts of the run."""
    slug = summary["calibration"].replace("_", "-")
    rows = [_table_row(row) for row in summary["events"]]
    create_table_artifact(table=rows, key=f"{slug}-offsets", description="Events and their offsets in micrometres")
    links = [f"- [{row['event']}]({link})" for row in summary["events"] for link in _links(row)]
    if links:
        create_markdown_artifact("\n".join(links), key=f"{slug}-reports", description="Reports of the events")


def _table_row(row):
    """Row of the table: state of an event and, where there is one, its adopted offset with sigma."""
    document = row.get("document") or {}
    name = (document.get("adopted") or {}).get("variant")
    block = (document.get("variants") or {}).get(name) or {}
    shown = {key: row.get(key, "") for key in ("event", "status", "made", "reused", "seconds")} | {"variant": name}
    for number, axis in enumerate(AXES):
        values = [block.get(key) for key in ("offset_um", "sigma_um")]
        known = [None if value is None else value[number] for value in values]
        shown[axis] = "" if None in known else f"{known[0]:.2f} +- {known[1]:.2f}"
    return shown | {"error": row.get("error", "")}


def _links(row):
    """Addresses of the pages of a report: where they are served, otherwise the files themselves."""
    folder, served = row.get("report"), os.environ.get(REPORTS)
    for page in sorted(Path(folder).resolve().glob("*.html")) if folder else []:
        inside = page.relative_to((location.folder() / "objects").resolve())
        yield f"{served}/{inside.as_posix()}" if served else page.as_uri()


def _state(summary):
    """State of the run: failed when an event failed, and how many of what."""
    message = ", ".join(f"{status}: {count}" for status, count in sorted(summary["counts"].items()))
    if summary["status"] == "failed":
        return Failed(message=message)
    return Completed(name=summary["status"].replace("_", " ").capitalize(), message=message)
