"""A private Prefect server for as long as a run lasts: a child process on a free port, silent and offline.

Prefect's own ephemeral mode outlives killed parents, loses records of quick tasks and may miss its time limit; this one
starts under a lock (two first starts at once would migrate one database twice), dies with its parent, and is drained.
``PREFECT_API_URL``, where set, names a server to use instead.
"""

import contextlib
import fcntl
import json
import os
import platform
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from flows import allocation
from flows.children import die_with
from gravcal.data import location

HOST = "127.0.0.1"
START_LIMIT_S = 180.0  # a first start took 11 s on a quiet machine, a minute on a busy one
DRAIN_LIMIT_S = 20.0
BUSY_RETRIES = 6  # 12 s in all, longer than SQLite waits for its lock
OWN = "gravcal-process-"
ENDED = ["COMPLETED", "FAILED", "CRASHED", "CANCELLED"]
BEGUN = ["RUNNING", "PENDING", "CANCELLING"]
SETTINGS = {
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_READ_BATCH_SIZE": "50",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_BATCH_SIZE": "50",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_FLUSH_INTERVAL": "1",
    "PREFECT_LOGGING_LEVEL": "CRITICAL",
    "PREFECT_LOGGING_INTERNAL_LEVEL": "CRITICAL",
    "PREFECT_LOGGING_TO_API_ENABLED": "false",
    "PREFECT_SERVER_LOGGING_LEVEL": "ERROR",
    "DASK_LOGGING__DISTRIBUTED": "error",
    "HDF5_USE_FILE_LOCKING": "BEST_EFFORT",
}


class Unavailable(Exception):
    """The server did not start."""


def set_environment():
    """Settings that Prefect reads when it is imported; those the user has set stay."""
    os.environ.setdefault("PREFECT_HOME", str(location.folder() / "prefect"))
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)


@dataclass(frozen=True)
class Server:
    """A server that was started, or one of the user's own (then there is no child)."""

    url: str
    child: subprocess.Popen | None = None
    gate: object = None


def begin(port=None):
    """Start a server without waiting for it, so that it comes up beside other work.

    Parameters
    ----------
    port : int or None, wanted if nobody listens there

    Returns
    -------
    server : Server, to be given to ``running``
    """
    set_environment()
    if os.environ.get("PREFECT_API_URL"):
        return Server(os.environ["PREFECT_API_URL"])
    home = Path(os.environ["PREFECT_HOME"]).expanduser()
    try:
        home.mkdir(parents=True, exist_ok=True)
        gate = (home / "start.lock").open("w")
        fcntl.flock(gate, fcntl.LOCK_EX)
        port = free_port(port)
        command = [sys.executable, "-m", "flows.prefect_server", str(port), str(os.getpid())]
        with (home / "server.log").open("ab") as log:
            child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    except OSError as error:
        raise Unavailable(str(error)) from error
    return Server(f"http://{HOST}:{port}/api", child, gate)


@contextlib.contextmanager
def early(wanted):
    """Server that comes up beside other work, ended with the block; None if none is wanted or it cannot start."""
    server = None
    if wanted:
        with contextlib.suppress(Unavailable):
            server = begin()
    try:
        yield server
    finally:
        if server:
            end(server)


@contextlib.contextmanager
def running(server):
    """URL of a server that answers; a child ends with the block."""
    try:
        _wait_for(server)
        yield server.url
    finally:
        end(server)


def end(server):
    """End a child that was started."""
    if server.child is None:
        return
    server.gate.close()
    server.child.terminate()
    try:
        server.child.wait(timeout=10)
    except subprocess.TimeoutExpired:
        server.child.kill()
        server.child.wait()


def drain(url, flow_run, expected):
    """Wait until the server has recorded the end of every task of a run, or the time limit is over."""
    question = {
        "flow_runs": {"id": {"any_": [str(flow_run)]}},
        "task_runs": {"state": {"type": {"any_": ENDED}}},
    }
    limit = time.monotonic() + DRAIN_LIMIT_S
    with contextlib.suppress(OSError):
        while ask(url, "/task_runs/count", question) < expected and time.monotonic() < limit:
            time.sleep(0.1)


def sign(url, flow_run):
    """Tag a run with this process; tasks are not tagged, for each would ask the server whether the tag has a limit."""
    with contextlib.suppress(OSError):
        ask(url, f"/flow_runs/{flow_run}", {"tags": [f"{OWN}{platform.node()}-{os.getpid()}"]}, "PATCH")


def bury(url):
    """Mark runs as crashed whose process on this machine was killed: the server cannot know."""
    here = f"{OWN}{platform.node()}-"
    with contextlib.suppress(OSError, ValueError):
        for run in _unfinished(url, {}):
            pids = [tag.removeprefix(here) for tag in run["tags"] if tag.startswith(here)]
            if pids and not Path(f"/proc/{pids[0]}").exists():
                _crash(url, run)


def bury_all(url, deployments):
    """Mark all unfinished runs of deployments as crashed; for one who knows that nobody else runs them.

    Parameters
    ----------
    url : str
    deployments : list of their ids
    """
    with contextlib.suppress(OSError, ValueError):
        for run in _unfinished(url, {"deployment_id": {"any_": [str(one) for one in deployments]}}):
            _crash(url, run)


def _unfinished(url, which):
    """Flow runs that a process has begun, of those named."""
    question = {"flow_runs": which | {"state": {"type": {"any_": BEGUN}}}}
    return ask(url, "/flow_runs/filter", question)


def _crash(url, run):
    """Mark a flow run and its tasks as crashed."""
    crashed = {"state": {"type": "CRASHED", "name": "Crashed", "message": "its process was killed"}, "force": True}
    wanted = {"flow_runs": {"id": {"any_": [run["id"]]}}, "task_runs": {"state": {"type": {"any_": BEGUN}}}}
    for task in ask(url, "/task_runs/filter", wanted):
        ask(url, f"/task_runs/{task['id']}/set_state", crashed)
    ask(url, f"/flow_runs/{run['id']}/set_state", crashed)


def ask(url, path, question=None, method=None):
    """Answer of the server to a question, both JSON; asked again while it says that its database is busy."""
    import requests
    from urllib3.util import Retry

    again = Retry(BUSY_RETRIES, connect=0, read=0, backoff_factor=0.2, status_forcelist=[503], allowed_methods=None)
    with requests.Session() as session:
        session.trust_env = HOST not in url  # a proxy does not know the ports of this machine
        for scheme in ("http://", "https://"):
            session.mount(scheme, requests.adapters.HTTPAdapter(max_retries=again))
        chosen = method or ("GET" if question is None else "POST")
        answer = session.request(chosen, url + path, json=question, timeout=10)
    answer.raise_for_status()
    return json.loads(answer.content or b"null")


def _wait_for(server):
    """Wait until the server answers; then others may start theirs."""
    limit = time.monotonic() + START_LIMIT_S
    while time.monotonic() < limit and (server.child is None or server.child.poll() is None):
        with contextlib.suppress(OSError):
            ask(server.url, "/health")
            if server.gate:
                server.gate.close()
            return
        time.sleep(0.05)
    log = Path(os.environ["PREFECT_HOME"]).expanduser() / "server.log"
    raise Unavailable(f"{server.url} did not answer within {START_LIMIT_S:.0f} s; see {log}")


def free_port(wanted=None):
    """A port nobody listens on, the one wanted if possible."""
    for port in (wanted or 0, 0):
        with socket.socket() as probe, contextlib.suppress(OSError, OverflowError):
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
            return probe.getsockname()[1]
    raise OSError(f"no free port on {HOST}")


def serve(port, parent):
    """Be the server, until the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with(parent)
    allocation.collect_seldom()
    os.environ |= {"PREFECT_SERVER_API_HOST": HOST, "PREFECT_SERVER_API_PORT": str(port)}
    with allocation.without_search():
        import uvicorn
        from prefect.server.api.server import create_app

        app = create_app()
    uvicorn.run(app, host=HOST, port=port, log_level="error", access_log=False)


if __name__ == "__main__":
    serve(int(sys.argv[1]), int(sys.argv[2]))
