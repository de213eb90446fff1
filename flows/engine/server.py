"""A private Prefect server for as long as a run lasts: a child process on a free port, silent and offline.

Prefect's own ephemeral mode outlives killed parents, loses records of quick tasks and may miss its time limit; this one
starts under a lock (two first starts at once would migrate one database twice), dies with its parent, and is drained.
It answers on loopback to its own names and origins, and only to who knows the authentication string of its home.
``PREFECT_API_URL``, where set, names a server to use instead; ``PREFECT_API_AUTH_STRING`` is then the string of that.
"""

import base64
import contextlib
import ctypes
import fcntl
import json
import os
import platform
import secrets
import signal
import socket
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from gravcal.store import location

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
AUTH = "PREFECT_API_AUTH_STRING"
START_LIMIT_S = 180.0  # a first start took 11 s on a quiet machine, a minute on a busy one
DRAIN_LIMIT_S = 20.0
BUSY_RETRIES = 6  # 12 s in all, longer than SQLite waits for its lock
OWN = "gravcal-process-"
LOG_LIMIT = 1_000_000  # bytes of server.log; as many again are kept in server.log.1

ENDED = ["COMPLETED", "FAILED", "CRASHED", "CANCELLED"]
BEGUN = ["RUNNING", "PENDING", "CANCELLING"]
#: Environment of Prefect and of Dask, pages that sign in, fields of a deployment that say what its runs do.
SETTINGS, DASK, PAGES, DEPLOYMENT = tomllib.loads(
    Path(__file__).with_name("settings.toml").read_text(encoding="utf-8")
).values()


class Unavailable(Exception):
    """The server did not start."""


def set_environment():
    """Settings that Prefect reads when it is imported; those the user has set stay."""
    os.environ.setdefault("PREFECT_HOME", str(location.folder() / "prefect"))
    with contextlib.suppress(OSError):  # said where it is needed; Prefect makes no parents and warns
        home()
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)


def home():
    """Folder of the server's database, log and authentication string; made for this user alone."""
    folder = Path(os.environ["PREFECT_HOME"]).expanduser()
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    return folder


def auth_string():
    """Authentication string "user:password" of the server, made at the first start in a file for this user alone.

    A file that others could read is made anew: they may know it.
    """
    path = home() / "auth"
    if path.exists() and not path.stat().st_mode & 0o077 and (known := path.read_text()):
        return known
    aside = path.with_name(f"auth.{secrets.token_hex(8)}")
    with os.fdopen(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(f"gravcal:{secrets.token_urlsafe(32)}")
    aside.replace(path)
    return path.read_text()


def page(url, name):
    """File for this user alone that opens Prefect's page signed in: no command line and no log has the key."""
    path = home() / f"open-{name}.html"
    path.unlink(missing_ok=True)
    encoded = base64.b64encode(os.environ[AUTH].encode()).decode()
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(PAGES["open"].format(where=url.removesuffix("/api") + "/enter", string=encoded))
    return path


def client(url):
    """{Prefect setting: value} of a client of the server at url: address, and authentication string where set."""
    from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL

    known = {PREFECT_API_AUTH_STRING: os.environ[AUTH]} if AUTH in os.environ else {}
    return known | {PREFECT_API_URL: url}


@dataclass(frozen=True)
class Server:
    """A server that was started, or one of the user's own (then there is no child)."""

    url: str
    child: subprocess.Popen | None = None
    gate: object = None  #: locked file that keeps others from starting a server, closed once this one answers


def begin(port=None):
    """Server (the user's, or a child on that port if free), not waited for: it starts while Prefect is imported."""
    set_environment()
    if os.environ.get("PREFECT_API_URL"):
        return Server(os.environ["PREFECT_API_URL"])
    try:
        gate = (home() / "start.lock").open("w")
        fcntl.flock(gate, fcntl.LOCK_EX)
        os.environ[AUTH] = auth_string()
        with listener(port) as listening, _log().open("ab") as log:  # handed on as it is: nobody else can take the port
            port = listening.getsockname()[1]
            extra = {
                "PREFECT_SERVER_API_AUTH_STRING": os.environ[AUTH],
                "PREFECT_SERVER_API_CORS_ALLOWED_ORIGINS": ",".join(f"http://{name}:{port}" for name in NAMES),
            }
            command = [sys.executable, "-m", "flows.engine.server", str(listening.fileno()), str(os.getpid())]
            channels = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": log}
            child = subprocess.Popen(command, **channels, env=os.environ | extra, pass_fds=[listening.fileno()])
    except OSError as error:
        raise Unavailable(str(error)) from error
    return Server(f"http://{HOST}:{port}/api", child, gate)


@contextlib.contextmanager
def running(server):
    """URL of a server that answers; a child ends with the block. One that ends before it answers is started again."""
    try:
        for last in (False, False, True):
            try:
                _wait_for(server)
                break
            except Unavailable:
                if last or server.child is None or server.child.poll() is None:
                    raise
                end(server)
                server = begin(urlsplit(server.url).port)
        yield server.url
    finally:
        end(server)


def end(server):
    """End the child process of a Server, if it has one."""
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
    """Wait until the server has recorded the end of ``expected`` tasks of a run (its id), at most DRAIN_LIMIT_S."""
    from prefect.events.worker import EventsWorker

    with ThreadPoolExecutor() as thread:  # the next run has another server, unknown to these; a notebook has a loop
        thread.submit(EventsWorker.drain_all, timeout=DRAIN_LIMIT_S, at_exit=False)
    question = {
        "flow_runs": {"id": {"any_": [str(flow_run)]}},
        "task_runs": {"state": {"type": {"any_": ENDED}}},
    }
    deadline = time.monotonic() + DRAIN_LIMIT_S
    with contextlib.suppress(OSError):
        while ask(url, "/task_runs/count", question) < expected and time.monotonic() < deadline:
            time.sleep(0.1)


def sign(url, flow_run):
    """Tag a run (id) with host and process id; not its tasks: each would ask the server for a limit."""
    with contextlib.suppress(OSError):
        ask(url, f"/flow_runs/{flow_run}", {"tags": [f"{OWN}{platform.node()}-{os.getpid()}"]}, "PATCH")


def registered(url, deployment):
    """{field: value} of a deployment (id) that say what its runs do (`DEPLOYMENT`), as the server holds them."""
    return {
        name: value for name, value in ask(url, f"/deployments/{deployment}").items() if name in DEPLOYMENT["fields"]
    }


def bury(url, deployments=()):
    """Mark runs and their tasks as crashed whose process on this machine was killed: the server cannot know.

    With deployments (ids), all their unfinished runs instead: for a caller who knows that nobody else runs them.
    """
    prefix, unfinished = f"{OWN}{platform.node()}-", {"state": {"type": {"any_": BEGUN}}}
    crashed = {"state": {"type": "CRASHED", "name": "Crashed", "message": "its process was killed"}, "force": True}
    selected = {"deployment_id": {"any_": [str(one) for one in deployments]}} if deployments else {}
    with contextlib.suppress(OSError, ValueError):
        for run in ask(url, "/flow_runs/filter", {"flow_runs": selected | unfinished}):
            pids = [tag.removeprefix(prefix) for tag in run["tags"] if tag.startswith(prefix)]
            if not deployments and (not pids or Path(f"/proc/{pids[0]}").exists()):
                continue
            wanted = {"flow_runs": {"id": {"any_": [run["id"]]}}, "task_runs": unfinished}
            for task in ask(url, "/task_runs/filter", wanted):
                ask(url, f"/task_runs/{task['id']}/set_state", crashed)
            ask(url, f"/flow_runs/{run['id']}/set_state", crashed)


def ask(url, path, question=None, method=None):
    """JSON answer of the server to a request (GET, or POST of ``question``), repeated while it answers 503, busy."""
    import requests
    from urllib3.util import Retry

    retry = Retry(BUSY_RETRIES, connect=0, read=0, backoff_factor=0.2, status_forcelist=[503], allowed_methods=None)
    with requests.Session() as session:
        session.trust_env = HOST not in url  # a proxy does not know the ports of this machine
        session.auth = tuple(os.environ[AUTH].split(":", 1)) if AUTH in os.environ else None
        session.headers["Connection"] = "close"  # a busy server closes after its answer: ask again on a new one
        for scheme in ("http://", "https://"):
            session.mount(scheme, requests.adapters.HTTPAdapter(max_retries=retry))
        verb = method or ("GET" if question is None else "POST")
        answer = session.request(verb, url + path, json=question, timeout=10)
    answer.raise_for_status()
    return json.loads(answer.content or b"null")


def _wait_for(server):
    """Wait until the server answers, then release its lock file; Unavailable if it ends or takes too long."""
    deadline = time.monotonic() + START_LIMIT_S
    while time.monotonic() < deadline and (server.child is None or server.child.poll() is None):
        with contextlib.suppress(OSError):
            ask(server.url, "/health")
            if server.gate:
                server.gate.close()
            return
        time.sleep(0.05)
    code = server.child.poll() if server.child else None
    what = f"did not answer within {START_LIMIT_S:.0f} s" if code is None else f"ended with code {code}"
    raise Unavailable(f"{server.url} {what}; see {_log()}")


def _log():
    """Path of server.log; one longer than LOG_LIMIT is renamed to server.log.1 first."""
    log = Path(os.environ["PREFECT_HOME"]).expanduser() / "server.log"
    if log.exists() and log.stat().st_size > LOG_LIMIT:
        log.replace(log.with_suffix(".log.1"))
    return log


def listener(wanted=None):
    """Socket that listens on a port of this machine, the one wanted if nobody else does."""
    for port in (wanted if wanted in range(1 << 16) else 0, 0):
        with contextlib.suppress(OSError):
            return socket.create_server((HOST, port))
    raise OSError(f"no free port on {HOST}")


def serve(door, parent):
    """Be the server on a socket (file descriptor) that listens, until the parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # when the parent dies: PR_SET_PDEATHSIG, linux/prctl.h
    if os.getppid() != parent:  # it is gone already
        os._exit(1)
    os.umask(0o077)
    door = socket.socket(fileno=door)
    os.environ |= {"PREFECT_SERVER_API_HOST": HOST, "PREFECT_SERVER_API_PORT": str(door.getsockname()[1])}
    import uvicorn
    from prefect.server.api.server import create_app
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.responses import HTMLResponse
    from starlette.routing import Route

    app = create_app()
    app.routes.insert(0, Route("/enter", lambda _: HTMLResponse(PAGES["enter"])))
    config = uvicorn.Config(TrustedHostMiddleware(app, NAMES), log_level="error", access_log=False)
    uvicorn.Server(config).run(sockets=[door])


if __name__ == "__main__":
    serve(int(sys.argv[1]), int(sys.argv[2]))
