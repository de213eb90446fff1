"""Campaigns as Prefect deployments: "reprocess-all" by the clock, "new-data" when a folder changed.

The page of a run shows the state of each event while it runs, a table of the offsets, and links to the reports.
"""

import hashlib
import itertools
import os
from pathlib import Path

import prefect
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from prefect.states import Completed, Failed
from prefect.task_runners import ThreadPoolTaskRunner

from flows import campaign, campaign_prefect, command, watch
from gravcal.data import location, memo

REPORTS = "GRAVCAL_REPORTS"  # address under which the store's objects are served, if they are
AXES = "xyz"
HOW = {"persist_result": False, "task_runner": ThreadPoolTaskRunner(max_workers=2 * (os.cpu_count() or 1))}
REUSED = 100  # events with nothing to make that a run shows as tasks; the table has them all


@prefect.flow(name="reprocess-all", **HOW)
def reprocess_all(
    calibration: str = "com_offset",
    satellite: str | None = None,
    data: str | None = None,
    settings: list[str] | None = None,
    workers: int | None = None,
):
    """All events of the catalogue, or of a folder; what has not changed is reused."""
    return _campaign(calibration, satellite, data, settings, workers)


@prefect.flow(name="new-data", **HOW)
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
    seen = itertools.count()

    def listener(row):
        if next(seen) < REUSED:
            _record(row)

    summary = campaign.run(campaign.Campaign(calibration, chosen, "flow", None, workers), sources, listener)
    _show(summary)
    return _state(summary)


def _record(row):
    """Show the state of an event that had nothing to make as a task of the run that bears its name."""

    def event():
        return campaign_prefect.state_of(row)

    prefect.task(event, name=str(row["event"]), cache_policy=NO_CACHE, persist_result=False)(return_state=True)


def _show(summary):
    """Table of offsets and list of reports as artifacts of the run."""
    key = campaign_prefect.slug(summary["calibration"])
    rows, left_out = campaign_prefect.table(summary["events"])
    shown = [_table_row(row) for row in rows]
    description = f"Events and their offsets in micrometres{left_out}"
    create_table_artifact(table=shown, key=f"{key}-offsets", description=description)
    links = [f"- [{row['event']}]({link})" for row in rows for link in _links(row)]
    if links:
        create_markdown_artifact("\n".join(links), key=f"{key}-reports", description="Reports of the events")


def _table_row(row):
    """Row of the table: state of an event and, where there is one, its adopted offset with sigma."""
    adopted = row.get("adopted") or {}
    shown = {key: row.get(key, "") for key in ("event", "status", "made", "reused", "seconds")}
    shown["variant"] = adopted.get("variant", "")
    for number, axis in enumerate(AXES):
        known = [adopted[key][number] for key in ("offset_um", "sigma_um")] if adopted else [None]
        shown[axis] = "" if None in known else f"{known[0]:.2f} +- {known[1]:.2f}"
    return shown | {"said": row.get("error") or row.get("verdict", ""), "report": row.get("report", "")}


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
