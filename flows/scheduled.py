"""Campaigns as Prefect deployments: "reprocess-all" by the clock, "new-data" when a folder changed.

The page of a run shows the state of each event while it runs, a table of the offsets, and links to the reports.
"""

import hashlib
import itertools
import json
import os
from pathlib import Path

import prefect
from prefect.artifacts import create_markdown_artifact, create_table_artifact
from prefect.cache_policies import NO_CACHE
from prefect.context import get_run_context
from prefect.states import Completed, Failed
from prefect.task_runners import ThreadPoolTaskRunner

from flows import campaign, command, discover
from flows.calibration import load
from flows.engine import server
from gravcal.errors import GravcalError
from gravcal.io import archive
from gravcal.store import configurations, housekeeping, location

REPORTS = "GRAVCAL_REPORTS"  # addresses under which the store's objects are served, if they are
REGISTERED = "GRAVCAL_REGISTERED"  # deployments as gravcal serve registered them, if it started this run
HOW = {"persist_result": False, "task_runner": ThreadPoolTaskRunner(max_workers=2 * (os.cpu_count() or 1))}
TOGETHER = "What all events of a satellite say together, and what changed beyond its error"
REUSED = 100  # events with nothing to make that a run shows as tasks; the table has them all


@prefect.flow(name="reprocess-all", **HOW)
def reprocess_all(
    calibration: str,
    satellite: str | None = None,
    data: str | None = None,
    settings: list[str] | None = None,
    workers: int | None = None,
    joint: bool = True,
    prune_days: float | None = None,
    quota_gb: float | None = None,
):
    """All events of the catalogue, or of a folder; what has not changed is reused. Then the store is pruned."""
    if refused := refusal():
        return refused
    state = _campaign(calibration, satellite, data, settings, workers, joint)
    if prune_days is not None or quota_gb is not None:
        limits = ((prune_days, 86400), (quota_gb, 1e9))
        age, quota = (None if value is None else value * scale for value, scale in limits)
        said = housekeeping.said(housekeeping.prune(age, True, quota), True, quota_gb)
        create_markdown_artifact(said, key="store", description="What was removed from the store")
    return state


@prefect.flow(name="new-data", **HOW)
def new_data(
    data: str,
    calibration: str,
    satellite: str | None = None,
    settings: list[str] | None = None,
    workers: int | None = None,
    joint: bool = True,
):
    """All events of a folder, if its inventory is not that of the last run."""
    if refused := refusal():
        return refused
    asked = repr([str(Path(data).absolute()), calibration, satellite, settings])
    name = "watched-" + hashlib.sha256(asked.encode()).hexdigest()[:32]
    inventory = archive.state_of(data)
    if inventory is None or location.recall(name) == inventory:
        return Completed(name="Nothing new", message=f"{data}: nothing that the last run has not seen")
    state = _campaign(calibration, satellite, data, settings, workers, joint)
    location.remember(name, inventory)
    return state


def refusal():
    """Failed state of a run whose deployment or parameters differ from `REGISTERED`; None if equal or that is unset."""
    if REGISTERED not in os.environ:
        return None
    run = get_run_context().flow_run
    known = json.loads(os.environ[REGISTERED]).get(str(run.deployment_id), {})
    now = server.registered(os.environ["PREFECT_API_URL"], run.deployment_id) if known else {}
    changed = sorted(name for name in now if now[name] != known[name])
    if known and not changed and run.parameters == known["parameters"]:
        return None
    fault = f"found {', '.join(changed) or 'parameters of the run'} changed"
    said = f"deployment {run.deployment_id}: {fault}, expected what gravcal serve registered. Start gravcal serve anew."
    return Failed(name="Refused", message=said)


def _campaign(calibration, satellite, data, settings, workers, joint):
    """Prefect state of a campaign inside the running flow; its tables, links and joint search become artifacts."""
    chosen = configurations.record(command.chosen(calibration, settings))
    sources = command.many_sources(calibration, satellite, Path(data) if data else None)
    numbers = itertools.count()

    def listener(row):  # a task of the run for an event that had nothing to make
        if next(numbers) < REUSED:
            how = {"name": str(row["event"]), "cache_policy": NO_CACHE, "persist_result": False}
            prefect.task(lambda: campaign.state_of([row]), **how)(return_state=True)

    summary = campaign.run(campaign.Campaign(calibration, chosen, "flow", None, workers), sources, listener)
    key, (rows, left_out) = calibration.replace("_", "-"), campaign.table(summary["events"])
    names, table = ("event", "status", "origin", "made", "reused", "seconds", "values", "said", "report"), []
    for row in rows:
        row = row | {"values": row.get("said", ""), "said": row.get("error") or row.get("verdict", "")}
        table.append({name: row.get(name, "") for name in names})
    create_table_artifact(table=table, key=f"{key}-values", description=f"Events and their values{left_out}")
    made = {row["event"]: Path(row["report"]) for row in rows if "report" in row}
    links = [f"- [{event}]({_address(page)})" for event, one in made.items() for page in sorted(one.glob("*.html"))]
    if links:
        create_markdown_artifact("\n".join(links), key=f"{key}-reports", description="Reports of the events")
    if joint and load(calibration).discovery is not None:
        _together(calibration, satellite, data, chosen, workers)
    message = ", ".join(f"{status}: {count}" for status, count in sorted(summary["counts"].items()))
    if summary["status"] == "failed":
        return Failed(message=message)
    return Completed(name=summary["status"].replace("_", " ").capitalize(), message=message)


def _together(calibration, satellite, data, chosen, workers):
    """Repeat the joint search of each satellite; an artifact of the run lists what changed beyond its error."""
    searches, lines, data = [], [], Path(data) if data else None
    try:
        searches = discover.joint(calibration, satellite, data and [data], chosen, engine="flow", workers=workers)
    except GravcalError as error:  # too few events, say: no failure of the campaign
        lines.append(str(error))
    for document, files, changes in searches:
        lines += ["", f"{document['event']}: {document['verdict']['text']}", "", *(f"- changed: {t}" for t in changes)]
        lines += [f"- [{path.name}]({_address(path)})" for path in files if path.suffix == ".html"]
    create_markdown_artifact("\n".join(lines), key=f"{calibration.replace('_', '-')}-joint", description=TOGETHER)


def _address(page):
    """URL (str) of a file of the store: where it is served (`REPORTS`), otherwise file:// itself."""
    served, inside = os.environ.get(REPORTS), page.resolve().relative_to((location.folder() / "objects").resolve())
    return served.format(inside.as_posix()) if served else page.resolve().as_uri()
