"""The campaign as one Prefect flow with one task per event."""

import os

from flows import campaign as plain
from flows import prefect_server
from flows.engine import warn


def run(campaign, waiting, calibrate):
    """Rows by number, each event a task; without a server, the same without Prefect.

    Parameters
    ----------
    campaign : Campaign
    waiting : list of (number, source)
    calibrate : function of a source that returns its row

    Returns
    -------
    rows : dict of number to row
    """
    try:
        begun = prefect_server.begin()
        import prefect  # noqa: F401 - takes seconds, while the server comes up

        with prefect_server.running(begun) as url:
            prefect_server.bury(url)
            return _flow_on(url, campaign, waiting, calibrate)
    except prefect_server.Unavailable as error:
        warn(f"Prefect's server is not available ({error}); running without it.")
    return plain.in_threads(waiting, calibrate)


def _flow_on(url, campaign, waiting, calibrate):
    """Run all events as tasks of one flow on a server that answers."""
    import prefect
    from prefect.artifacts import create_table_artifact
    from prefect.context import get_run_context
    from prefect.settings import PREFECT_API_URL, PREFECT_FLOWS_HEARTBEAT_FREQUENCY, temporary_settings
    from prefect.task_runners import ThreadPoolTaskRunner

    known = {}

    def events():
        known["run"] = get_run_context().flow_run.id
        submitted = {number: _task(source, calibrate).submit() for number, source in waiting}
        rows = {number: _row(future) for number, future in submitted.items()}
        shown = [{name: value for name, value in row.items() if name != "document"} for row in rows.values()]
        create_table_artifact(table=shown, key=f"{campaign.calibration.replace('_', '-')}-events")
        return rows

    with temporary_settings({PREFECT_API_URL: url, PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):
        runner = ThreadPoolTaskRunner(max_workers=2 * (os.cpu_count() or 1))
        name = f"campaign {campaign.calibration}"
        try:
            with prefect.tags(prefect_server.own_tag()):
                return prefect.flow(events, name=name, task_runner=runner, persist_result=False)()
        finally:
            if known:
                prefect_server.drain(url, known["run"], len(waiting))


def _task(source, calibrate):
    """Prefect task of one event; a failed event ends as Failed and keeps its row."""
    import prefect
    from prefect.cache_policies import NO_CACHE
    from prefect.states import Completed, Failed

    def event():
        row = calibrate(source)
        if row["status"] == "failed":
            return Failed(message=row["error"], data=row)
        return Completed(name=row["status"].replace("_", " ").capitalize(), data=row)

    return prefect.task(event, name=str(plain.command.name_of(source)), cache_policy=NO_CACHE, persist_result=False)


def _row(future):
    """Row of a task, whatever its state."""
    future.wait()
    return future.state.data if isinstance(future.state.data, dict) else future.state.result(raise_on_failure=False)
