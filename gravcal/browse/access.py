"""Who may ask and what an answer may contain: known hosts, who holds the token, no scripts but our own."""

import hmac
import ipaddress
from urllib.parse import parse_qsl, urlencode

from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse

COOKIE = "gravcal_token_{}"  # by port: a browser sends the cookies of this machine to every port of it
OURS = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src 'self'; connect-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
REPORT = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def is_loopback(host):
    """Whether an address can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def guarded(app, token, hosts):
    """ASGI application that answers only those who may ask; an empty token is not asked for.

    Hosts are the names under which the server may be addressed, "*" for any: foreign pages cannot reach it by a name of
    their own that leads to this machine.
    """

    async def answer(scope, receive, send):
        if scope["type"] != "http":
            return await app(scope, receive, send)
        refused = _refused(Request(scope), token, hosts)
        return await (refused or app)(scope, receive, _with_headers(send))

    return answer


def _refused(request, token, hosts):
    """Answer to a request that is not let through, or None."""
    if "*" not in hosts and _host(request) not in hosts:
        return PlainTextResponse("This server does not answer to that host name.\n", 421)
    if request.method not in ("GET", "HEAD"):
        return PlainTextResponse("These pages can only be read.\n", 405)
    cookie = COOKIE.format(request.scope["server"][1])
    if not token or _same(request.cookies.get(cookie, ""), token):
        return None
    if _same(request.query_params.get("token", ""), token):
        rest = urlencode([pair for pair in parse_qsl(request.url.query) if pair[0] != "token"])
        moved = RedirectResponse("/" + request.url.path.lstrip("/") + (f"?{rest}" if rest else ""), 303)
        moved.set_cookie(cookie, token, httponly=True, samesite="strict")
        return moved
    return PlainTextResponse("Open the address that gravcal printed or linked; it holds the token.\n", 401)


def _host(request):
    """Host name of a request without its port."""
    host = request.headers.get("host", "")
    return host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() and not host.endswith("]") else host


def _same(given, token):
    """Comparison that takes as long whatever was given."""
    return hmac.compare_digest(given.encode(), token.encode())


def _with_headers(send):
    """Sender that adds the headers of every answer."""

    async def sender(message):
        if message["type"] == "http.response.start":
            known = {name.lower() for name, _ in message["headers"]}
            added = HEADERS | {"Content-Security-Policy": OURS}
            extra = [(k.lower().encode(), v.encode()) for k, v in added.items() if k.lower().encode() not in known]
            message = message | {"headers": [*message["headers"], *extra]}
        await send(message)

    return sender
