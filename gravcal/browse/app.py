"""Routes of the pages, access control by host and token, security headers, and the server."""

import hmac
import ipaddress
import secrets
import socket
from urllib.parse import parse_qsl, urlencode

import uvicorn
from bokeh.util.paths import bokehjs_path
from starlette.applications import Starlette
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from gravcal.browse import pages, series
from gravcal.errors import GravcalError, refuse

COOKIE = "gravcal_token_{}"  # by port: a browser sends the cookies of this machine to every port of it
OURS = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src 'self'; connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Content-Security-Policy": OURS,
}
LOCAL = ("127.0.0.1", "localhost", "::1")


def application(calibrations, token="", hosts=LOCAL):
    """ASGI application of the pages; calibrations {name: Calibration}, token and hosts as of `guarded`."""
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
        Route("/report/{key}/{name}", pages.file),
        Route("/file/{key}/{name}", pages.file),
        Mount("/static/bokeh", StaticFiles(directory=bokehjs_path() / "js")),
        Mount("/static", StaticFiles(packages=[("gravcal.browse", "static")])),
    ]
    handlers = {404: pages.not_found, 500: pages.broken, series.Missing: pages.missing}
    application = Starlette(routes=routes, exception_handlers=handlers)
    application.state.calibrations = calibrations
    return guarded(application, token, hosts)


def guarded(app, token, hosts):
    """ASGI application that answers only GET and HEAD with the token (as a cookie or query; "": none needed).

    Hosts are the names under which the server may be addressed, "*" for any: foreign pages cannot reach it by a name of
    their own that leads to this machine.
    """

    async def answer(request, call_next):  # Response, with `HEADERS`
        response = _refused(request, token, hosts) or await call_next(request)
        for name, value in HEADERS.items():
            response.headers.setdefault(name, value)
        return response

    return BaseHTTPMiddleware(app, answer)


def _refused(request, token, hosts):
    """Response to a request that is refused, or redirected to set the cookie; None if it may pass."""
    named = request.headers.get("host") and request.url.hostname
    if "*" not in hosts and named not in hosts:
        return PlainTextResponse("This server does not answer to that host name.\n", 421)
    if request.method not in ("GET", "HEAD"):
        return PlainTextResponse("These pages can only be read.\n", 405)
    cookie = COOKIE.format(request.scope["server"][1])
    if not token or hmac.compare_digest(request.cookies.get(cookie, "").encode(), token.encode()):
        return None
    if hmac.compare_digest(request.query_params.get("token", "").encode(), token.encode()):
        rest = urlencode([pair for pair in parse_qsl(request.url.query) if pair[0] != "token"])
        moved = RedirectResponse("/" + request.url.path.lstrip("/") + (f"?{rest}" if rest else ""), 303)
        moved.set_cookie(cookie, token, httponly=True, samesite="strict")
        return moved
    return PlainTextResponse("Open the address that gravcal printed or linked; it holds the token.\n", 401)


def bound(host: str, port: int) -> socket.socket:
    """Socket that listens; port 0 for any that is free. GravcalError if the address cannot be had."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host.strip("[]"), port), family=family, dualstack_ipv6=":" in host)
    except OSError as error:
        reason, remedy = error.strerror or error, "Give another --port (0 takes any that is free) or --host."
        return refuse(f"browse: {host}:{port}", reason, "an address that can be listened on", remedy, GravcalError)


def serve(calibrations, listening, host, say):
    """Answer on a socket until the process is ended; host as the user gave it, ``say`` prints a line."""
    shown = socket.gethostname() if host in ("0.0.0.0", "::") else host
    address, port, *_ = listening.getsockname()
    token = secrets.token_urlsafe(24)  # on loopback, too: other users of this machine can ask
    hosts = (*LOCAL, shown) if ipaddress.ip_address(address).is_loopback else ("*",)
    say(f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/?token={token}")
    settings = uvicorn.Config(application(calibrations, token, hosts), log_level="warning", lifespan="off", ws="none")
    uvicorn.Server(settings).run(sockets=[listening])
