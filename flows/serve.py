"""A private Prefect server and the deployments it runs, for as long as this process lives."""

import asyncio
import contextlib
import functools
import os
import signal
import threading
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from flows import prefect_server, watch
from gravcal.data import location
from gravcal.errors import CatalogError, ProductError


@dataclass(frozen=True)
class Served:
    """What is run, and when; ``arguments`` are those of both flows."""

    cron: str
    watched: Path | None
    every_s: float
    data: Path | None
    arguments: dict


def serve(served, said):
    """Serve the deployments until this process is told to end.

    Parameters
    ----------
    served : Served
    said : function of text, told where the pages are

    Raises
    ------
    CatalogError : no such time of the clock
    ProductError : the server does not start
    """
    prefect_server.set_environment()
    with contextlib.suppress(OSError):  # begin() says it better
        Path(os.environ["PREFECT_HOME"]).expanduser().mkdir(parents=True, exist_ok=True)
    schedule = _schedule(served.cron)
    from prefect.settings import PREFECT_API_URL, temporary_settings

    try:
        begun = prefect_server.begin()
        with prefect_server.running(begun) as url, reports() as address:
            os.environ |= {"PREFECT_API_URL": url, "GRAVCAL_REPORTS": address}
            with temporary_settings({PREFECT_API_URL: url}), contextlib.suppress(KeyboardInterrupt):
                _run(served, schedule, url, said)
    except prefect_server.Unavailable as error:
        raise ProductError(f"Prefect's server: {error}; expected it to answer. Look into that log.") from None


def _run(served, schedule, url, said):
    """Register the deployments and wait for their runs, one at a time."""
    from prefect.runner import Runner

    runner, ended = Runner(name="gravcal", limit=1), threading.Event()
    known = {one.name: runner.add_deployment(one) for one in _deployments(served, schedule)}
    said(f"Prefect {url.removesuffix('/api')}")
    said(f"reprocess-all at {served.cron} UTC")
    if served.watched:
        said(f"new-data when {served.watched} changes, looked at every {served.every_s:g} s")
        path = f"/deployments/{known['new-data']}/create_flow_run"
        start = functools.partial(prefect_server.ask, url, path, {})
        looking = (served.watched, served.every_s, ended, start)
        threading.Thread(target=watch.loop, args=looking, daemon=True).start()
    try:
        asyncio.run(_until_told(runner))
    finally:
        ended.set()


async def _until_told(runner):
    """Let a runner work until this process is told to end: the runner's own way leaves traces of errors."""
    work, loop = asyncio.create_task(runner.start()), asyncio.get_running_loop()
    await asyncio.sleep(0)  # the runner sets its handler first
    for name in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(name, work.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await work


def _deployments(served, schedule):
    """Deployments: by the clock and, if a folder is watched, on its changes."""
    from prefect.deployments.runner import EntrypointType

    from flows import scheduled

    how = {"entrypoint_type": EntrypointType.MODULE_PATH}
    data = {"data": str(served.data.absolute())} if served.data else {}
    given = served.arguments | data
    made = [scheduled.reprocess_all.to_deployment("reprocess-all", schedule=schedule, parameters=given, **how)]
    if served.watched:
        given = served.arguments | {"data": str(served.watched.absolute())}
        made.append(scheduled.new_data.to_deployment("new-data", parameters=given, **how))
    return made


def _schedule(cron):
    """Schedule of Prefect for times of the clock."""
    from prefect.client.schemas.schedules import CronSchedule

    try:
        return CronSchedule(cron=cron, timezone="UTC")
    except ValueError:
        raise CatalogError(
            f"--cron {cron!r}: found no times of the clock, expected minute hour day month weekday such as '0 3 * * *'."
        ) from None


@contextlib.contextmanager
def reports():
    """Address under which the products of the store can be read on this machine, as long as the block lasts."""
    objects = location.folder() / "objects"
    objects.mkdir(parents=True, exist_ok=True)
    handler = functools.partial(_Quiet, directory=str(objects))
    with ThreadingHTTPServer((prefect_server.HOST, 0), handler) as pages:
        threading.Thread(target=pages.serve_forever, daemon=True).start()
        try:
            yield f"http://{prefect_server.HOST}:{pages.server_port}"
        finally:
            pages.shutdown()


class _Quiet(SimpleHTTPRequestHandler):
    """Reads files of one folder, says nothing and lists nothing."""

    def log_message(self, *_):
        """Nothing."""

    def list_directory(self, path):  # noqa: ARG002
        """Refuse."""
        self.send_error(404)
