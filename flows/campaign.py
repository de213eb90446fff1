"""All events of a satellite: one Prefect flow, one task per event, the work in Dask worker processes.

Events whose products are all there are answered from the store; if that is true of all, neither Prefect nor Dask
starts.
"""

import contextlib
import os
from collections import Counter
from dataclasses import dataclass

from flows import campaign_work, command, engine
from gravcal.data import location
from gravcal.errors import GravcalError, ProductError

ENDED_WELL = ("delivered", "no_manoeuvre")


@dataclass(frozen=True)
class Campaign:
    """How the events are processed; ``workers`` are processes of this machine, 0 means in this one."""

    calibration: str
    chosen: object
    engine: str = "prefect"
    scheduler: str | None = None
    workers: int | None = None


def sources(calibration, satellite, data):
    """Where the files of each event are: from the catalogue, or from a folder.

    Parameters
    ----------
    calibration : str
    satellite : str or None, only this one
    data : Path or None, folder with files of many days, or with one folder per event

    Returns
    -------
    sources : list
    """
    module = command.flow_module(calibration)
    if data is not None:
        days = _days(module, data, satellite)
        return [_source(module, None, data=folder, satellite=one, date=date) for folder, one, date in days]
    from gravcal.data import catalog

    names = [event.name for event in catalog.events(satellite=satellite) if event.calibration == calibration]
    return [_source(module, name, data=None, satellite=None, date=None) for name in names]


def run(campaign, sources, listener=None):
    """Process all events; a failed one stops no other.

    Parameters
    ----------
    campaign : Campaign
    sources : list
    listener : function of one row, called as each event ends; or None

    Returns
    -------
    summary : dict: "schema_version", "status", "calibration", "counts", "events": list of rows in the order of the
    sources
    """
    engine.single_threaded()
    rows, waiting = {}, []
    for number, source in enumerate(sources):
        if campaign.workers == 0 or isinstance(source, campaign_work.Refused) or _is_done(campaign, source):
            rows[number] = _here(campaign, source, listener)
        else:
            waiting.append((number, source))
    if waiting:
        rows |= _run_waiting(campaign, waiting, listener)
    events = [rows[number] for number in range(len(sources))]
    counts = Counter(row["status"] for row in events)
    status = "failed" if set(counts) - set(ENDED_WELL) else "delivered" if counts["delivered"] else "no_manoeuvre"
    return {
        "schema_version": 1,
        "status": status,
        "calibration": campaign.calibration,
        "counts": dict(counts),
        "events": events,
    }


def exit_code(summary):
    """0 when no event failed, 1 when one did, 3 when there was nothing to calibrate."""
    return command.EXIT[summary["status"]]


@contextlib.contextmanager
def cluster(campaign, events):
    """Client of the cluster named, or of worker processes of this machine, one thread each."""
    from distributed import Client, LocalCluster

    if campaign.scheduler:
        with Client(campaign.scheduler, timeout="20s") as client:
            _check_versions(client)
            yield client
        return
    count = min(campaign.workers or os.cpu_count() or 1, events)
    local = LocalCluster(
        n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None, silence_logs=50
    )
    with local, Client(local) as client:
        yield client


def _run_waiting(campaign, waiting, listener):
    """Rows of the events that have something to make, by number."""
    with cluster(campaign, len(waiting)) as client:
        folder = str(location.folder())

        def calibrate(source):
            future = client.submit(
                campaign_work.calibrate, campaign.calibration, source, campaign.chosen, folder, pure=False, retries=2
            )
            try:
                row = future.result()
            except Exception as error:  # noqa: BLE001 - a worker that died too often, a lost scheduler
                row = {
                    "event": command.name_of(source),
                    "status": "failed",
                    "error": f"{type(error).__name__}: {error}",
                }
            if listener:
                listener(row)
            return row

        if campaign.engine == "prefect":
            from flows import campaign_prefect

            return campaign_prefect.run(campaign, waiting, calibrate)
        return in_threads(waiting, calibrate)


def in_threads(waiting, calibrate):
    """Rows by number; threads only wait for the workers. An interrupt leaves at once: closing the cluster ends them."""
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(2 * (os.cpu_count() or 1))
    try:
        rows = pool.map(calibrate, [source for _, source in waiting])
        return dict(zip([number for number, _ in waiting], rows, strict=True))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _is_done(campaign, source):
    """Whether every product of an event is in the store; what cannot be planned is left to its worker."""
    try:
        body = command.flow_module(campaign.calibration).calibrate
        steps, ref = engine.plan(body, source, campaign.chosen)
    except GravcalError:
        return False
    return ref is not None and all(step.action == "reuse" for step in steps)


def _here(campaign, source, listener):
    """Row of an event that is answered from the store, or made in this process."""
    row = campaign_work.calibrate(campaign.calibration, source, campaign.chosen, str(location.folder()))
    if listener:
        listener(row)
    return row


def _source(module, event, **where):
    """Source of one event; where there is none, its reason, to be tabulated like any other failure."""
    try:
        return module.source(event=event, **where)
    except GravcalError as error:
        name = event or "-".join(str(where[part]) for part in ("satellite", "date") if where[part])
        return campaign_work.Refused(name, str(error))


def _days(module, data, satellite):
    """Folders, satellites and dates of the events below a folder, of one satellite if it is named."""
    if not data.is_dir():
        raise ProductError(f"{data}: not a folder, expected one with Level-1 files. Give the folder with --data.")
    days = [day for day in module.days(data) if satellite is None or set(satellite) & set(day[1])]
    if not days:
        raise ProductError(
            f"{data}: no Level-1 file that begins an event{f' of satellite {satellite}' if satellite else ''}. "
            f"Give another folder."
        )
    return days


def _check_versions(client):
    """Raise unless all workers run this version of gravcal."""
    own = campaign_work.version()
    other = {worker: found for worker, found in client.run(campaign_work.version).items() if found != own}
    if other:
        worker, found = next(iter(other.items()))
        raise ProductError(f"{worker}: runs gravcal {found}, this is {own}. Install the same version on all workers.")
    client.get_versions(check=True)
