"""Credentials for archives: read when needed, sent to the host they belong to, never printed and never stored."""

import base64
import ipaddress
import netrc
import os
from pathlib import Path
from urllib.parse import urlsplit

from gravcal.errors import CatalogError

EARTHDATA = ("https", "urs.earthdata.nasa.gov", 443)
PROTECTED = ("https", "archive.podaac.earthdata.nasa.gov", 443)
PORTS = {"http": 80, "https": 443}
REMEDY = (
    "Put 'machine HOST login NAME password PASSWORD' into ~/.netrc (HOST is urs.earthdata.nasa.gov for PO.DAAC, which "
    "also takes EARTHDATA_USERNAME and EARTHDATA_PASSWORD, or EARTHDATA_TOKEN; other servers take "
    "GRAVCAL_FETCH_USERNAME and GRAVCAL_FETCH_PASSWORD), or use --from isdc, which asks for none."
)


def origin(url):
    """Scheme, host and port of an address: what credentials belong to."""
    parts = urlsplit(url)
    return parts.scheme, parts.hostname or "", parts.port or PORTS.get(parts.scheme, 0)


def authorization(url, start):
    """Value of the Authorization header for one address.

    Credentials travel encrypted, or stay on this machine. An entry of netrc without a port holds for the server that
    was asked for and for the usual port of https; a redirect to another port of a host gets nothing.

    Parameters
    ----------
    url : str, address about to be asked
    start : str, address the user named, from which redirects may have led here

    Returns
    -------
    value : str, or None
    """
    here, asked = origin(url), origin(start)
    if here[0] != "https" and not is_loopback(here[1]):
        return None
    token = os.environ.get("EARTHDATA_TOKEN")
    if token and here == PROTECTED:
        return f"Bearer {token}"
    pair = _from_environment(here, asked) or _from_netrc(here, asked)
    return pair and "Basic " + base64.b64encode(":".join(pair).encode()).decode()


def is_loopback(host):
    """Whether a host is this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _from_environment(here, asked):
    """Name and password from the environment: one pair for Earthdata, one for the server asked for."""
    prefix = "EARTHDATA" if here == EARTHDATA else "GRAVCAL_FETCH" if here == asked and here != PROTECTED else None
    pair = tuple(os.environ.get(f"{prefix}_{name}") for name in ("USERNAME", "PASSWORD"))
    return pair if prefix and all(pair) else None


def _from_netrc(here, asked):
    """Name and password from the netrc file; its default entry belongs to no host and is not used."""
    named = os.environ.get("NETRC")
    path = Path(named).expanduser() if named else Path.home() / ".netrc"
    try:
        hosts = netrc.netrc(path).hosts
    except FileNotFoundError:
        return None
    except (netrc.NetrcParseError, OSError, ValueError) as error:
        line = f", line {error.lineno}" if getattr(error, "lineno", None) else ""
        raise CatalogError(
            f"{path}{line}: cannot be read, expected entries 'machine HOST login NAME password PASSWORD'. Correct it."
        ) from None  # the message of netrc quotes the word it stumbled over
    scheme, host, port = here
    usual = here == asked or (scheme, port) == ("https", PORTS["https"])
    entry = hosts.get(f"{host}:{port}") or (hosts.get(host) if usual else None)
    return entry and (entry[0], entry[2])
