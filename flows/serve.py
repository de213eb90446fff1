"""A private Prefect server and the deployments it runs, for as long as this process lives.

Runs are started from the flows of this process, never from what the server says of a deployment; each compares first
(``scheduled.refusal``) what the server holds with what was registered here.
"""

import asyncio
import contextlib
import fcntl
import functools
import hashlib
import hmac
import json
import os
import signal
import threading
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from flows.engine import server
from gravcal.errors import CatalogError, ProductError, refuse
from gravcal.io import archive
from gravcal.store import location


@dataclass(frozen=True)
class Served:
    """Flows to serve and their times; ``arguments`` are of both flows, ``pruning`` of reprocess-all alone."""

    cron: str  #: times of reprocess-all, UTC
    watched: Path | None  #: folder of new-data
    every_s: float  #: between looks at it
    data: Path | None  #: folder of reprocess-all, None for the catalogue
    arguments: dict
    pruning: dict = field(default_factory=dict)


def serve(served, said):
    """Serve the deployments of a `Served` until this process is ended; ``said`` prints a line."""
    server.set_environment()
    calibration = served.arguments["calibration"]
    from prefect.client.schemas.schedules import CronSchedule
    from prefect.settings import temporary_settings

    try:
        schedule = CronSchedule(cron=served.cron, timezone="UTC")
    except ValueError:
        expected = "minute hour day month weekday such as '0 3 * * *'"
        refuse("--cron", repr(served.cron), expected, "Give times of the clock.", CatalogError)
    try:
        with _alone(calibration):
            names = [f"port-{what}-{calibration}" for what in ("pages", "reports")]
            last = [port if isinstance(port := location.recall(name), int) else None for name in names]
            started = server.begin(last[0])
            with server.running(started) as url, reports(last[1]) as address:
                for name, one in zip(names, (url, address), strict=True):  # so that links and bookmarks stay good
                    if started.child is not None or one is address:  # a server of the user's own keeps its port
                        location.remember(name, urlsplit(one).port)
                os.environ["PREFECT_API_URL"] = url
                os.environ.setdefault("GRAVCAL_REPORTS", address)
                with temporary_settings(server.client(url)), contextlib.suppress(KeyboardInterrupt):
                    _run(served, schedule, (url, started.child is not None), said)
    except server.Unavailable as error:
        raise ProductError(f"Prefect's server: {error}; expected it to answer. Look into that log.") from None


@contextlib.contextmanager
def _alone(name):
    """Context with a lock: refused if another process serves the same calibration on the same server."""
    home = Path(os.environ["PREFECT_HOME"]).expanduser()
    try:
        with (server.home() / f"serve-{name}.lock").open("w") as held:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
    except BlockingIOError:
        refuse(home, f"another gravcal serve of {name}", "none", "End it, or name another GRAVCAL_PRODUCTS.")
    except PermissionError as error:
        refuse(home, error.strerror, "a folder of your own", "Name one in PREFECT_HOME.")


def _run(served, schedule, where, said):
    """Register deployments and run them one at a time; where: (server URL, True if it, with what it ran, is ours)."""
    from prefect.deployments.runner import EntrypointType
    from prefect.runner import Runner

    from flows import scheduled

    (url, is_own), ended, name = where, threading.Event(), served.arguments["calibration"]
    runner = Runner(name=f"gravcal {name}", limit=1)
    options = {"name": name, "entrypoint_type": EntrypointType.MODULE_PATH}
    parameters = served.arguments | ({"data": str(served.data.absolute())} if served.data else {})
    arguments_of = {scheduled.reprocess_all: {"schedule": schedule, "parameters": parameters | served.pruning}}
    if served.watched:
        arguments_of[scheduled.new_data] = {"parameters": served.arguments | {"data": str(served.watched.absolute())}}
    deployments = {flow.name: runner.add_flow(flow, **options, **more) for flow, more in arguments_of.items()}
    registered = {str(one): server.registered(url, one) for one in deployments.values()}
    os.environ["GRAVCAL_REGISTERED"] = json.dumps(registered)
    if is_own:
        server.bury(url, list(deployments.values()))
    said(f"Prefect {url.removesuffix('/api')}")
    if is_own:
        said(f"signed in by {server.page(url, name).as_uri()}")
    said(f"reprocess-all at {served.cron} UTC")
    if served.watched:
        said(f"new-data when {served.watched} changes, looked at every {served.every_s:g} s")
        path = f"/deployments/{deployments['new-data']}/create_flow_run"
        start = functools.partial(server.ask, url, path, {})
        watching = (served.watched, served.every_s, ended, start)
        threading.Thread(target=watch, args=watching, daemon=True).start()
    try:
        asyncio.run(_until_told(runner))
    finally:
        ended.set()


async def _until_told(runner):
    """Let a Prefect runner work until SIGTERM or SIGINT: the runner's own handling of signals prints tracebacks."""
    work, loop = asyncio.create_task(runner.start()), asyncio.get_running_loop()
    await asyncio.sleep(0)  # the runner sets its handler first
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, work.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await work


@contextlib.contextmanager
def reports(port=None):
    """Context with a server of the store's files: its URL template "http://.../{}?token=...", {}: path."""
    import uvicorn
    from starlette.applications import Starlette
    from starlette.routing import Mount
    from starlette.staticfiles import StaticFiles

    from gravcal.browse.app import guarded

    objects = location.folder() / "objects"
    objects.mkdir(parents=True, exist_ok=True)
    token = hmac.digest(server.auth_string().encode(), b"reports", hashlib.sha256).hex()
    files = Starlette(routes=[Mount("/", StaticFiles(directory=objects))])
    app = guarded(files, token, server.NAMES)
    pages = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off", ws="none"))
    with server.listener(port) as heard:
        thread = threading.Thread(target=pages.run, kwargs={"sockets": [heard]}, daemon=True)
        thread.start()
        try:
            yield f"http://{server.HOST}:{heard.getsockname()[1]}/{{}}?token={token}"
        finally:
            pages.should_exit = True
            thread.join(10)


def watch(folder, every_s, ended, changed):
    """Call ``changed()`` each time a folder has a new state, equal in two looks, until the Event ``ended`` is set."""
    known = last = None
    while not ended.wait(every_s):
        now = archive.state_of(folder)
        if now is not None and now == last and now != known:
            with contextlib.suppress(OSError):
                changed()
                known = now
        last = now
