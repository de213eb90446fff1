"""The campaign as one Prefect flow with one task per event."""

import functools

from flows import campaign as plain
from flows import prefect_server
from flows.engine import warn

ROWS = 1000  # rows of a table that a page can show


def run(campaign, waiting, calibrate, slots, server=None):
    """Rows by number, each event a task; without a server, the same without Prefect.

    Parameters
    ----------
    campaign : Campaign
    waiting : iterable of (number, source)
    calibrate : function of a source that returns its row
    slots : int, events under way at a time
    server : prefect_server.Server already begun, or None

    Returns
    -------
    rows : dict of number to row
    """
    try:
        begun = server or prefect_server.begin()
        import prefect  # noqa: F401 - takes seconds, while the server comes up

        with prefect_server.running(begun) as url:
            prefect_server.bury(url)
            return _flow_on(url, campaign, waiting, calibrate, slots)
    except prefect_server.Unavailable as error:
        warn(f"Prefect's server is not available ({error}); running without it.")
    return plain.in_threads(waiting, calibrate, slots)


def in_flow(campaign, waiting, calibrate, slots, server=None):  # noqa: ARG001 - as for run
    """Rows by number, each event a task of the flow that is running."""
    width = plain.AHEAD * slots if slots > 1 else 1
    return plain.windowed(waiting, functools.partial(_submit, calibrate), _settle, width)


def table(rows):
    """Rows as a page can show them: the failed first, so many in all, and what is left out.

    Parameters
    ----------
    rows : list of dict

    Returns
    -------
    shown : list of dict
    left_out : str, "" if nothing is
    """
    ordered = sorted(rows, key=lambda row: (row["status"] != "failed", row["status"] != "questionable"))
    left_out = f"; {len(rows) - ROWS} of {len(rows)} events are not shown" if len(rows) > ROWS else ""
    return ordered[:ROWS], left_out


def _flow_on(url, campaign, waiting, calibrate, slots):
    """Run all events as tasks of one flow on a server that answers."""
    import prefect
    from prefect.artifacts import create_table_artifact
    from prefect.context import get_run_context
    from prefect.settings import PREFECT_FLOWS_HEARTBEAT_FREQUENCY, temporary_settings
    from prefect.task_runners import ThreadPoolTaskRunner

    known = {"rows": {}}

    def events():
        known["run"] = get_run_context().flow_run.id
        prefect_server.sign(url, known["run"])
        known["rows"] = in_flow(campaign, waiting, calibrate, slots)
        shown, left_out = table(list(known["rows"].values()))
        description = f"Events of the campaign that had something to make{left_out}"
        create_table_artifact(table=shown, key=f"{slug(campaign.calibration)}-events", description=description)

    with temporary_settings(prefect_server.client(url) | {PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):
        runner, name = ThreadPoolTaskRunner(max_workers=slots), f"campaign {campaign.calibration}"
        try:
            prefect.flow(events, name=name, task_runner=runner, persist_result=False)()
        finally:
            if "run" in known:
                prefect_server.drain(url, known["run"], len(known["rows"]))
    return known["rows"]


def slug(name):
    """Name as keys of artifacts and names of deployments are written."""
    return name.replace("_", "-")


def _submit(calibrate, source):
    """Future of the task of one event, and where its row will be: Prefect would keep a state for each part of it."""
    import prefect
    from prefect.cache_policies import NO_CACHE

    kept = []

    def event():
        kept.append(calibrate(source))
        return state_of(kept[0])

    name = str(plain.command.name_of(source))
    return prefect.task(event, name=name, cache_policy=NO_CACHE, persist_result=False).submit(), kept


def state_of(row):
    """Prefect's state of an event: its own name, what was done or what went wrong."""
    from prefect.states import Completed, Failed

    if row["status"] == "failed":
        return Failed(message=row["error"])
    if row.get("error"):
        return Completed(name=row["status"].replace("_", " ").capitalize(), message=row["error"])
    message = f"{row['made']} products made, {row['reused']} reused, {row['seconds']} s"
    return Completed(name=row["status"].replace("_", " ").capitalize(), message=message)


def _settle(submitted):
    """Row of a task, whatever its state."""
    future, kept = submitted
    future.wait()
    return kept[0] if kept else future.state.result()
