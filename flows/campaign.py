"""All events of a satellite: one Prefect flow, one task per event, the work in Dask worker processes.

Events whose products are all there are answered from the store; if that is true of all, neither Prefect nor Dask
starts.
"""

import collections
import contextlib
import functools
import itertools
import os
from dataclasses import dataclass, field

from flows import campaign_here, campaign_work, command, engine
from gravcal.errors import GravcalError, ProductError
from gravcal.store import history, location, origin, schemas

#: Status of a campaign: the first of these that any event has.
ORDER = ("failed", "questionable", "delivered", "no_manoeuvre", "no_data")
AHEAD = 4  # events handed out for each that is being worked on
#: Dask looks at itself all the time, a sixth of a core with two workers; here nobody looks at what it finds.
WORKERS = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "false",
    "DASK_DISTRIBUTED__WORKER__MEMORY__MONITOR_INTERVAL": "1s",  # of 100 ms; an event does not fill the memory in that
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",  # of 20 ms
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "5s",  # of 500 ms
}


@dataclass(frozen=True)
class Campaign:
    """How the events are processed.

    Attributes
    ----------
    calibration : str
    chosen : Parameters
    engine : "prefect", "inline", or "flow": as tasks of the Prefect flow that is running
    scheduler : address of a Dask cluster, or None for processes of this machine
    workers : how many of these; None for one for each processor, 0 for none but this
    again : whether what failed is tried again though nothing that it depends on has changed
    remake_versions : products that other versions of numpy, scipy or numba made are made again
    """

    calibration: str
    chosen: object
    engine: str = "prefect"
    scheduler: str | None = None
    workers: int | None = None
    again: bool = False
    remake_versions: bool = field(default_factory=history.remakes_versions)


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
    known = command.record(calibration)
    letters = [*known.satellites, "".join(known.satellites)]
    command.check_satellite(calibration, satellite, letters)
    if data is not None:
        days = _days(known, data, satellite)
        return [_source(known, None, data=folder, satellite=one, date=date) for folder, one, date in days]
    from gravcal import catalog

    own = catalog.events(calibration=calibration)
    names = [event.name for event in own if satellite is None or set(satellite) & set(event.letters)]
    return [_source(known, name, data=None, satellite=None, date=None) for name in names]


def run(campaign, sources, listener=None):
    """Process all events; a failed one stops no other.

    Parameters
    ----------
    campaign : Campaign
    sources : list
    listener : function of one row, called as each event ends; or None

    Returns
    -------
    summary : dict: "schema_version", "status", "calibration", "configuration", "counts", "events": list of rows in the
    order of the sources
    """
    engine.single_threaded()
    rows = {}
    waiting = _waiting(campaign, sources, rows, listener)
    head = []
    if campaign.engine != "flow" and not campaign.scheduler:
        work = functools.partial(_made, campaign, folder=str(location.folder()))
        made, head = campaign_here.run(waiting, work, _processes(campaign), listener)
        rows |= made
    rest = ((number, source) for number, source, _ in waiting)
    head += itertools.islice(rest, 2 * AHEAD * _processes(campaign))
    if head:
        rows |= _run_waiting(campaign, head, itertools.chain(head, rest), listener)
    events = [rows[number] for number in range(len(sources))]
    counts = collections.Counter(row["status"] for row in events)
    told = origin.together(row.get("origin", "") for row in events) or origin.MEASURED
    return {
        "schema_version": schemas.VERSION,
        "status": next((status for status in ORDER if counts[status]), "no_data"),
        "calibration": campaign.calibration,
        "configuration": campaign.chosen.configuration,
        "origin": told,
        "counts": dict(counts),
        "events": events,
    }


def exit_code(summary):
    """1 when an event failed, else 4 when one is questionable, else 0: having no data or manoeuvre is no failure."""
    return command.EXIT[summary["status"]] if summary["status"] in ("failed", "questionable") else 0


def failed_last(campaign, sources):
    """Sources of the events whose last run in this configuration failed, and of those that are refused."""
    flow_name = command.record(campaign.calibration).flow.flow_name
    with location.configured(campaign.chosen.configuration):
        return [
            source
            for source in sources
            if (isinstance(source, campaign_work.Refused) and source.status == "failed")
            or history.failure(command.name_of(source), flow_name)
        ]


@contextlib.contextmanager
def cluster(campaign, count):
    """Client of the cluster named, or of so many worker processes of this machine, one thread each."""
    for name, value in WORKERS.items():
        os.environ.setdefault(name, value)
    from distributed import Client, LocalCluster

    if campaign.scheduler:
        with Client(campaign.scheduler, timeout="20s") as client:
            _check_versions(client)
            yield client
        return
    here = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "scheduler_kwargs": {"dashboard": False}}
    here["security"] = True  # TLS with keys of this cluster alone: Dask executes what it is sent, by any user
    local = LocalCluster(n_workers=count, threads_per_worker=1, processes=True, silence_logs=50, **here)
    with local, Client(local) as client:
        yield client


def windowed(waiting, submit, settle, width):
    """Rows by number; never more than ``width`` events are handed out, so that memory does not grow with their number.

    Parameters
    ----------
    waiting : iterable of (number, source)
    submit : function of a source that returns a future
    settle : function of a future that waits for its row
    width : int
    """
    rows, under_way = {}, collections.deque()
    for number, source in waiting:
        under_way.append((number, submit(source)))
        if len(under_way) >= width:
            number, future = under_way.popleft()
            rows[number] = settle(future)
    return rows | {number: settle(future) for number, future in under_way}


def in_threads(waiting, calibrate, slots):
    """Rows by number; threads only wait for the workers. An interrupt leaves at once: closing the cluster ends them."""
    from concurrent.futures import Future, ThreadPoolExecutor

    pool = ThreadPoolExecutor(slots)
    try:
        return windowed(waiting, functools.partial(pool.submit, calibrate), Future.result, AHEAD * slots)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _waiting(campaign, sources, rows, listener):
    """Number, source and seconds left of the events that have something to make; rows of the others join ``rows``."""
    for number, source in enumerate(sources):
        row, seconds = _answer(campaign, source)
        if row is None:
            yield number, source, seconds
            continue
        rows[number] = row
        if listener:
            listener(row)


def _answer(campaign, source):
    """Row of an event that needs no worker: refused, made here, or all in the store; and the seconds left to do."""
    here = campaign.workers == 0 and campaign.engine != "flow"
    if here or isinstance(source, campaign_work.Refused):
        return _made(campaign, source, str(location.folder())), 0.0
    return campaign_work.reuse(campaign.calibration, source, campaign.chosen, campaign.again)


def _processes(campaign):
    """Worker processes of this machine that are wanted at most."""
    return campaign.workers or os.cpu_count() or 1


def _run_waiting(campaign, head, waiting, listener):
    """Rows of the events that have something to make, by number; the workers begin while a server still starts."""
    from flows import prefect_server

    folder = str(location.folder())
    if campaign.workers == 0:
        return _hand_out(campaign, waiting, lambda source: _made(campaign, source, folder), 1)
    early = prefect_server.early(campaign.engine == "prefect")
    with early as server, cluster(campaign, min(_processes(campaign), len(head))) as client:
        slots = 2 * max(sum(client.nthreads().values()), 1)  # a worker finds its next event waiting

        def submit(source):
            return client.submit(_made, campaign, source, folder, pure=False, retries=2)

        begun = {id(source): submit(source) for _, source in head[: AHEAD * slots]}
        told = None if campaign.engine == "flow" else listener
        return _hand_out(campaign, waiting, functools.partial(_on_a_worker, submit, begun, told), slots, server)


def _hand_out(campaign, waiting, calibrate, slots, server=None):
    """Rows by number, through the engine of the campaign."""
    if campaign.engine == "inline":
        return in_threads(waiting, calibrate, slots)
    from flows import campaign_prefect

    work = campaign_prefect.in_flow if campaign.engine == "flow" else campaign_prefect.run
    return work(campaign, waiting, calibrate, slots, server)


def _made(campaign, source, folder):
    """Row of one event, made in this process."""
    engine.remake_versions(campaign.remake_versions)
    return campaign_work.calibrate(campaign.calibration, source, campaign.chosen, folder)


def _on_a_worker(submit, begun, listener, source):
    """Row of one event, made by a worker; one that dies is replaced twice."""
    future = begun.pop(id(source), None) or submit(source)
    try:
        row = future.result()
    except Exception as error:  # noqa: BLE001 - a worker that died too often, a lost scheduler
        text = f"{type(error).__name__}: {error}"
        row = {"event": command.name_of(source), "status": "failed", "error": text}
    if listener:
        listener(row)
    return row


def _source(calibration, event, **where):
    """Source of one event; where there is none, its reason, to be tabulated like any other failure."""
    try:
        return calibration.source(event=event, **where)
    except GravcalError as error:
        name = event or "-".join(str(where[part]) for part in ("satellite", "date") if where[part])
        return campaign_work.Refused(name, str(error), command.status_of(error))


def _days(calibration, data, satellite):
    """Folders, satellites and dates of the events below a folder, of one satellite if it is named."""
    if not data.is_dir():
        raise ProductError(f"{data}: not a folder, expected one with Level-1 files. Give the folder with --data.")
    days = [day for day in calibration.days(data) if satellite is None or set(satellite) & set(day[1])]
    if not days:
        command.check_folder(calibration.name, data)
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
