"""All events of a satellite: one Prefect flow, one task per event, the work in Dask worker processes.

Events whose products are all there are answered from the store; if that is true of all, neither Prefect nor Dask
starts. Nothing here imports Prefect before it is wanted: workers import this module.
"""

import collections
import contextlib
import itertools
import os
import threading
import time
import traceback
from dataclasses import dataclass, field

from flows import command, discover, engine
from flows.calibration import Calibration, load
from flows.engine import server
from gravcal.errors import GravcalError, ProductError, refuse
from gravcal.store import history, keys, location, product, results, schemas, store
from tasks import stage

#: Status of a campaign: the first of these that any event has.
ORDER = ("failed", "questionable", "delivered", "no_manoeuvre", "no_data")
SHOWN = 6  # values of an event that a table shows; all of them are in the summary
ROWS = 1000  # rows of a table that a page can show
TASKS = 1000  # of Prefect, each with rows of its database; of more events several are one task


@dataclass(frozen=True)
class Campaign:
    """How the events are processed."""

    calibration: str
    chosen: object
    engine: str = "prefect"  #: "prefect", "inline", or "flow": as tasks of the Prefect flow that is running
    scheduler: str | None = None  #: address of a Dask cluster, or None for processes of this machine
    workers: int | None = None  #: how many of these; None for one for each processor, 0 for none but this
    again: bool = False  #: True to try again what failed though nothing that it depends on has changed
    #: "discover" or "limits" to search the events for what their model gets wrong, "joint" for what they tell a search
    #: over all of them, or ""
    search: str = ""
    #: True to make again the products that other versions of numpy, scipy or numba made
    remake_versions: bool = field(default_factory=history.remakes_versions)

    @property
    def one(self) -> Calibration:
        """Calibration whose flow is run."""
        if not self.search:
            return load(self.calibration)
        if self.search == "joint":
            return discover.evidence_of(self.calibration)
        return discover.as_calibration(self.calibration, self.search == "limits")


def failed_last(campaign, sources):
    """Sources of the events whose last run in this configuration failed, and of those that are refused."""
    name, refused = campaign.one.flow.flow_name, [one for one in sources if isinstance(one, command.Refused)]
    failed = [one.event for one in refused if one.status == "failed"]
    with location.configured(campaign.chosen.configuration):
        return [one for one in sources if one.event in failed or history.failure(one.event, name)]


def run(campaign, sources, listener=None):
    """Process all events; a failed one stops no other. The listener hears the row of each event as it ends.

    The summary has "schema_version", "status", "calibration", "configuration", "origin", "counts" and "events", the
    rows in the order of the sources.
    """
    engine.single_threaded()
    listener = listener or (lambda _: None)
    rows = []
    for source in sources:
        rows.append(answered(campaign, source))
        if rows[-1]:
            listener(rows[-1])
    if None in rows:
        _make_all(campaign, sources, rows, listener)
    for source, row in zip(sources, rows, strict=True):  # one that failed says whether its records are simulated
        if row["status"] == "failed" and hasattr(source, "folder"):
            row["origin"] = command.origin_of(source)
    by_status = collections.Counter(row["status"] for row in rows)
    return {
        "schema_version": schemas.VERSION,
        "status": next((status for status in ORDER if by_status[status]), "no_data"),
        "calibration": campaign.calibration,
        "configuration": campaign.chosen.configuration,
        "origin": product.origins_together(row.get("origin", "") for row in rows) or product.MEASURED,
        "counts": dict(by_status),
        "events": rows,
    }


def exit_code(summary):
    """Exit code: 1 if an event failed, else 4 if one is questionable, else 0 (no data or manoeuvre is no failure)."""
    return command.EXIT[summary["status"]] if summary["status"] in ("failed", "questionable") else 0


def answered(campaign, source):
    """Row (dict) of an event that is refused, all in the store, or fails as before; None if a stage has to run."""
    started, event = time.perf_counter(), source.event
    if isinstance(source, command.Refused):
        return {"event": event, "status": source.status, "error": source.error} | _effort(0, 0, started)
    calibration, chosen = campaign.one, campaign.chosen
    name = calibration.flow.flow_name
    try:
        with location.configured(chosen.configuration):
            failure = None if campaign.again else history.failure(event, name)
            if not failure and not location.links(event, location.OPERATIONAL).exists():
                return None  # never made: its files are read by who makes it
            steps, ref = engine.plan(calibration.flow, source, chosen)
            reusable = list(itertools.takewhile(lambda step: step.action == "reuse", steps))
            effort = _effort(0, len(reusable), started)
            remaining = steps[len(reusable) :]
            if remaining and failure and remaining[0].key and remaining[0].key == failure["failed_key"]:
                failed = {"event": event, "status": "failed", "error": failure["reason"]}
                return failed | {"since": failure["started"]} | effort
            if remaining:
                return None
            with history.recorded(name, ref.event) as note:
                for step in reusable:
                    store.point(step.ref)
                    note(step, "cached", step.ref)
            return _row(calibration, ref, note) | effort
    except GravcalError as error:  # such as a file that is missing: nothing had to be computed to see it
        return _failed(campaign, event, error) | _effort(0, 0, started)
    except Exception:  # noqa: BLE001 - what goes wrong goes wrong again in its worker, which says it
        return None


def _failed(campaign, event, error):  # row (dict) of an event that a GravcalError ended, noted as its last run
    noted = history.recorded(campaign.one.flow.flow_name, event)
    with contextlib.suppress(GravcalError), location.configured(campaign.chosen.configuration), noted:
        raise error
    return {"event": event, "status": command.status_of(error), "error": str(error)}


def make(campaign, source, folder):
    """Row (dict) of one event, its stages run in this process with the store in ``folder``."""
    os.environ[history.REMAKE] = "1" if campaign.remake_versions else "0"
    engine.single_threaded()
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # a run of its own reads with all cores; here each worker has one
    os.environ["GRAVCAL_PRODUCTS"] = folder
    counts, started, event = {"made": 0, "cached": 0}, time.perf_counter(), source.event

    def count(_call, state, _ref):  # listener of stages
        counts[state] += 1

    try:
        with location.configured(campaign.chosen.configuration), engine.one_thread():
            calibration = campaign.one
            noted = history.recorded(calibration.flow.flow_name, event)
            with stage.using(stage.inline, count), noted as note, stage.using(stage.inline, note):
                ref = calibration.flow(source, campaign.chosen)
            row = _row(calibration, ref, note)
    except GravcalError as error:
        row = {"event": event, "status": command.status_of(error), "error": str(error)}
    except Exception as error:  # noqa: BLE001 - one event must not stop the others
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({frame.filename}:{frame.lineno})"
        row = {"event": event, "status": "failed", "error": text}
    finally:
        stage.forget()  # events do not share products; a worker lives for thousands
    return row | _effort(counts["made"], counts["cached"], started)


def _row(calibration: Calibration, ref, note):  # dict of status, verdict, values of a report; note: `history.recorded`
    document = calibration.document(ref)
    verdict = document.get("verdict")
    verdict = verdict.get("text", "") if isinstance(verdict, dict) else verdict or ""
    values = list(calibration.result(document))
    parts = ("value", "sigma", "sigma_total", "unit")
    row = {
        "event": ref.event,
        "status": document["status"],
        "origin": document.get("origin", "measured"),
        "report": str(ref.folder),
        "verdict": verdict,
        "values": {one.label: {part: getattr(one, part) for part in parts} for one in values},
        "said": results.text(values[:SHOWN]),
    }
    if document["status"] == "failed":
        row["error"] = verdict
    other = [reason for one in note.stages.values() for reason in one.get("other_versions", ())]
    return row | ({"other_versions": other} if other else {})


def _effort(made, reused, started):  # numbers of products, and wall time since `started` of perf_counter
    return {"made": made, "reused": reused, "seconds": round(time.perf_counter() - started, 3)}


@contextlib.contextmanager
def cluster(campaign, count):
    """Dask Client of the scheduler named, or of ``count`` worker processes of this machine, one thread each."""
    for name, value in server.DASK.items():
        os.environ.setdefault(name, value)
    from distributed import Client, LocalCluster

    if campaign.scheduler:
        try:
            client = Client(campaign.scheduler, timeout="20s")
        except (OSError, ValueError) as error:
            remedy = "Start one there, or correct the address."
            refuse(f"--scheduler {campaign.scheduler}", str(error), "the address of a Dask scheduler", remedy)
        with client:
            own, versions = keys.versions()["gravcal"], client.run(keys.versions)
            differing = {worker: one["gravcal"] for worker, one in versions.items() if one["gravcal"] != own}
            for worker, version in differing.items():
                refuse(worker, f"gravcal {version}", f"{own}, as here", "Install the same version on all workers.")
            client.get_versions(check=True)
            yield client
        return
    options = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "scheduler_kwargs": {"dashboard": False}}
    options["security"] = True  # TLS with keys of this cluster alone: Dask executes what it is sent, by any user
    local = LocalCluster(n_workers=count, threads_per_worker=1, processes=True, silence_logs=50, **options)
    with local, Client(local) as client:
        yield client


def _make_all(campaign, sources, rows, listener):
    """Replace each None of ``rows`` by the row of its source, made by workers, which begin while a server starts."""
    folder, lock = str(location.folder()), threading.Lock()
    waiting = {number: source for number, source in enumerate(sources) if rows[number] is None}

    def heard(number, row):  # store and announce the row of a source
        rows[number] = row
        if campaign.engine != "flow":  # its tasks show them
            with lock:
                listener(row)
        return row

    if campaign.workers == 0:
        make_here = lambda number: heard(number, make(campaign, waiting[number], folder))  # noqa: E731
        for number, source in waiting.items():
            as_tasks({number: source}, make_here) if campaign.engine == "flow" else make_here(number)
        return None
    count = min(campaign.workers or os.cpu_count() or 1, len(waiting))
    with cluster(campaign, count) as client:
        options = {"pure": False, "retries": 2}
        futures = {number: client.submit(make, campaign, one, folder, **options) for number, one in waiting.items()}

        def row_of(number):
            """Row of one event, made by a worker; one that dies is replaced twice."""
            try:
                row = futures.pop(number).result()
            except Exception as error:  # noqa: BLE001 - a worker that died too often, a lost scheduler
                row = _failed(campaign, waiting[number].event, ProductError(f"{type(error).__name__}: {error}"))
            return heard(number, row)

        def events():
            """Make the events as tasks of the running flow; a table of their rows becomes an artifact."""
            from prefect.artifacts import create_table_artifact

            as_tasks(waiting, row_of)
            shown, left_out = table([rows[number] for number in waiting])
            said = f"Events of the campaign that had something to make{left_out}"
            key = f"{campaign.calibration.replace('_', '-')}-events"
            create_table_artifact(table=shown, key=key, description=said)

        if campaign.engine == "flow":
            return as_tasks(waiting, row_of)
        if campaign.engine == "prefect":
            try:
                with server.running(server.begin()) as url:
                    name = f"campaign {campaign.calibration}"
                    return engine.flow_on(url, events, name, lambda: len(waiting))
            except server.Unavailable as error:
                engine.warn(f"Prefect's server is not available ({error}); running without it.")
        for number in waiting:
            row_of(number)
        return None


def as_tasks(waiting, row_of):
    """Make events {number: source} by ``row_of(number)`` as tasks of the Prefect flow that runs; threads only wait."""
    import prefect
    from prefect.cache_policies import NO_CACHE

    futures, numbers = [], list(waiting)
    size = -(-len(numbers) // TASKS)
    for batch in (numbers[first : first + size] for first in range(0, len(numbers), size or 1)):

        def events(batch=batch):
            return state_of([row_of(number) for number in batch])  # rows are not: Prefect would keep each part of them

        name = " to ".join(dict.fromkeys(str(waiting[number].event) for number in (batch[0], batch[-1])))
        futures.append(prefect.task(events, name=name, cache_policy=NO_CACHE, persist_result=False).submit())
    for future in futures:
        future.wait()


def state_of(rows):
    """Prefect state of one task from its rows: Failed with their errors, else Completed; one row: its status."""
    from prefect.states import Completed, Failed

    failed = [row for row in rows if row["status"] == "failed"]
    if failed:
        many = len(rows) > 1
        return Failed(message="; ".join(f"{row['event']}: {row['error']}" if many else row["error"] for row in failed))
    made, reused, seconds = (sum(row[part] for row in rows) for part in ("made", "reused", "seconds"))
    message = f"{made} products made, {reused} reused, {seconds:.3f} s"
    counts = collections.Counter(row["status"].replace("_", " ").capitalize() for row in rows)
    if len(rows) > 1:
        return Completed(message=", ".join(f"{count} {name}" for name, count in counts.items()) + f"; {message}")
    return Completed(name=next(iter(counts)), message=rows[0].get("error") or message)


def table(rows):
    """(first ROWS rows, failed and questionable before others; text that says how many are left out, "" if none)."""
    shown = sorted(rows, key=lambda row: (row["status"] != "failed", row["status"] != "questionable"))[:ROWS]
    return shown, f"; {len(rows) - ROWS} of {len(rows)} events are not shown" if len(rows) > ROWS else ""
