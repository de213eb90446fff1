"""The command that shows the store in a web browser."""

import sys
from typing import Annotated

import typer

from flows import cli_output as output
from flows.calibration import load_all

HOST = "address to listen on; the token in the address printed is asked for everywhere"


def browse(
    port: Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="0: any that is free")] = 8765,
    host: Annotated[str, typer.Option("--host", metavar="ADDRESS", help=HOST)] = "127.0.0.1",
) -> None:
    """Show products, plots, comparisons and reports in a web browser; reads only, until it is ended with Ctrl-C."""
    try:
        from gravcal.browse import app
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            f"browse needs {error.name}, which is not installed; pip install 'gravcal[browse]'"
        ) from error
    app.serve(load_all(), app.bound(host, port), host, _said)


def _said(text):
    """One line, at once: the process goes on."""
    output.say(text)
    sys.stdout.flush()
