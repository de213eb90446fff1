"""Addresses of the pages, and the server."""

import secrets
import socket
from importlib import resources
from pathlib import Path

import uvicorn
from bokeh.util.paths import bokehjs_path
from starlette.applications import Starlette
from starlette.responses import FileResponse
from starlette.routing import Route

from gravcal.browse import access, pages, plots
from gravcal.errors import GravcalError

LOCAL = ("127.0.0.1", "localhost", "[::1]")
STATIC = {"browse.css": "text/css", "browse.js": "text/javascript"}
LONG = {"Cache-Control": "public, max-age=31536000, immutable"}


def application(calibrations, token="", hosts=LOCAL):
    """The pages of calibrations {name: record} as an ASGI application; token and hosts as of `access.guarded`."""
    routes = [
        Route("/", pages.home),
        Route("/timeline/{calibration}", pages.timeline),
        Route("/timeline/{calibration}/{satellite}.json", pages.timeline_figure),
        Route("/event/{event}", pages.event),
        Route("/event/{event}/discovery", pages.search),
        Route("/compare/{calibration}", pages.compare),
        Route("/designs", pages.designs),
        Route("/results.csv", pages.results),
        Route("/products", pages.products),
        Route("/product/{key}", pages.product),
        Route("/figure/{key}/{variable}", pages.figure),
        Route("/data/{key}/{variable}", pages.data),
        Route("/csv/{key}/{variable}", pages.samples),
        Route("/report/{key}/{name}", pages.report),
        Route("/file/{key}/{name}", pages.download),
        Route("/static/{name}", static),
    ]
    handlers = {404: pages.not_found, 500: pages.broken}
    application = Starlette(routes=routes, exception_handlers=handlers)
    application.state.calibrations = calibrations
    return access.guarded(application, token, hosts)


def static(request):
    """Style, script and Bokeh's script, all from this machine."""
    name = request.path_params["name"]
    if name == "bokeh.min.js":
        return FileResponse(bokehjs_path() / "js" / name, media_type="text/javascript", headers=LONG)
    if name not in STATIC:
        return pages.not_found(request, None)
    path = Path(str(resources.files("gravcal.browse"))) / "static" / name
    return FileResponse(path, media_type=STATIC[name], headers={"Cache-Control": "no-cache"})


def bound(host: str, port: int) -> socket.socket:
    """Socket that listens; port 0 for any that is free. GravcalError if the address cannot be had."""
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(kind, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host.strip("[]"), port))
        listening.listen(128)  # who asks before the server has started waits
    except OSError as error:
        listening.close()
        raise GravcalError(
            f"browse: {host}:{port} cannot be listened on ({error.strerror or error}). Give another --port; 0 takes "
            f"any that is free."
        ) from error
    return listening


def serve(calibrations, listening, host, say):
    """Answer on a socket until the process is ended; host as the user gave it, ``say`` prints a line."""
    plots.ready()
    shown = socket.gethostname() if host in ("0.0.0.0", "::") else host
    shown = f"[{shown}]" if ":" in shown else shown
    port = listening.getsockname()[1]
    token = secrets.token_urlsafe(24)  # on loopback, too: other users of this machine can ask
    hosts = (*LOCAL, shown) if access.is_loopback(host) else ("*",)
    say(f"http://{shown}:{port}/?token={token}")
    settings = uvicorn.Config(application(calibrations, token, hosts), log_level="warning", lifespan="off", ws="none")
    uvicorn.Server(settings).run(sockets=[listening])
