"""The command line on a terminal: aligned tables, colour, completion, progress; and JSON from every command."""

import io
import json
import re
import sys
from types import SimpleNamespace

import pytest
from commands import gravcal
from typer.main import get_command
from typer.testing import CliRunner

from flows import campaign, cli, engine, output
from gravcal.store import results

WITHOUT_DOCUMENT = {"browse", "serve"}  # they go on until they are ended
COLOUR = "\x1b["


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    encoding = "utf-8"

    def isatty(self):
        """Yes."""
        return True


def commands(group, name=()):
    """Every command with its words."""
    for word, one in group.commands.items():
        if hasattr(one, "commands"):
            yield from commands(one, (*name, word))
        else:
            yield " ".join((*name, word)), one


def test_colour_is_for_terminals_that_want_it_and_tables_are_aligned(pipeline, monkeypatch):
    """Contract: bold heads on a terminal; none in a pipe, with NO_COLOR or on a dumb terminal; the same text.

    Every column of products and history begins where its head does; verify and prune have documents.
    """
    pipeline.run()
    plain, name = said_here("products"), f"fake-1/{pipeline.name}.join"
    for wanted in ({"TERM": "xterm"}, {"TERM": "xterm", "NO_COLOR": "1"}, {"TERM": "dumb"}):
        with monkeypatch.context() as patched:
            patched.delenv("NO_COLOR", raising=False)
            patched.setattr(sys, "stdout", Terminal())
            for variable, value in wanted.items():
                patched.setenv(variable, value)
            assert gravcal("products") == 0
            said = sys.stdout.getvalue()
        assert (COLOUR in said) == (wanted == {"TERM": "xterm"})
        assert re.sub(r"\x1b\[[0-9;]*m", "", said).splitlines() == plain.splitlines()
    history = said_here("history", name)
    for lines in (plain.splitlines(), history.splitlines()):
        starts = [found.start() for found in re.finditer(r"(?<=  )\S", lines[0])]
        assert starts
        for line in lines[1:]:
            assert all(line[at - 2 : at] in ("  ", "") for at in starts[-1:])
    assert "  . gain = 3.0" in said_here("history", name, "--settings")
    assert json.loads(said_here("products", "verify", "--json", "-"))["problems"] == []
    assert json.loads(said_here("products", "prune", "--json", "-")) == []


def said_here(*words):
    """What a command prints, in this process."""
    return CliRunner().invoke(cli.app, list(words)).stdout


def test_completion_offers_what_exists_and_every_command_gives_json(pipeline):
    """Contract: events, effects, settings of the calibration that was typed; --json on all that end by themselves."""
    pipeline.run()
    assert {"fake-1", "grace-c-2020-02-01"} <= set(cli.complete_events())
    assert "torque.saturation.limit=" in cli.complete_effects()
    typed = SimpleNamespace(params={}, args=["com_offset", "noise_order", "=", "3"], info_name="run")
    assert "lowpass_hz=" in cli.complete_settings(typed)
    known = dict(commands(get_command(cli.app)))
    without = {name for name, one in known.items() if "--json" not in {o for p in one.params for o in p.opts}}
    assert without == WITHOUT_DOCUMENT


def test_progress_counts_what_was_made_and_is_silent_in_a_pipe(pipeline, monkeypatch, capsys):
    """Contract: on a terminal every listener takes what it is told; elsewhere there is none."""
    with output.progress("fake") as listener, output.progress("work"), output.bytes_progress() as archives:
        assert listener is archives is None
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys, "stderr", Terminal())
    with output.progress("fake") as listener:
        flow = pipeline.module("flow").calibrate
        engine.run(flow, pipeline.file(), pipeline.chosen, engine="inline", listener=listener)
    assert "4 made, 0 reused, last " in sys.stderr.getvalue()
    with output.progress("work", 30.0), output.events_progress(2) as events, output.bytes_progress() as archives:
        events({"status": "failed"})
        archives("one.tgz", 10, 20)
    assert "work, about 30 s" in sys.stderr.getvalue()
    assert "one.tgz" in sys.stderr.getvalue()


def test_manoeuvres_and_campaigns_are_tables(capsys):
    """Contract: manoeuvres in calendar time beside GPS seconds, to a millisecond; what failed of a campaign first."""
    found = {"satellite": "C", "kind": "pitch", "start": 633830400.0, "stop": 633830580.5}
    output.manoeuvres({"event": "grace-c-2020-02-01", "manoeuvres": [found]}, None)
    heads, row, _ = capsys.readouterr().out.splitlines()
    assert "start (GPS time)" in heads
    assert row.split() == ["C", "pitch", "2020-02-01", "12:00:00.000", "2020-02-01", "12:03:00.500",
                           "633830400.000", "633830580.500"]  # fmt: skip
    effort = {"made": 3, "reused": 1, "seconds": 2.0}
    values = [results.Value("", axis, "um", 10.04, 2.2, 8.1) for axis in "xy"]
    rows = [{"event": "a", "status": "delivered", "said": results.text(values)} | effort,
            {"event": "b", "status": "failed", "error": "no clock"} | effort]  # fmt: skip
    summary = {"events": rows, "counts": {"delivered": 1, "failed": 1}, "configuration": "operational"}
    assert campaign.table(rows[:1] * 1003)[1] == "; 3 of 1003 events are not shown"  # a thousand at most
    output.campaign(summary, campaign.table(rows), None)
    heads, first, second = capsys.readouterr().out.splitlines()[:3]
    assert heads.endswith("values or reason")
    assert first.endswith("no clock")
    assert second.endswith("x 10.0 +- 8.1, y 10.0 +- 8.1 um")


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (-5.4321, 2.1049, "-5.4 +- 2.1"),
        (-87.7012, 0.4849, "-87.70 +- 0.48"),
        (0.0119721, 2.4e-5, "0.011972 +- 0.000024"),
        (1.7246e-7, 3.9e-10, "(172.46 +- 0.39)e-9"),
        (2.5e7, 3e4, "(25.000 +- 0.030)e6"),
        (0.0, 1e-12, "(0.0 +- 1.0)e-12"),
        (3.14159, None, "3.14"),
    ],
)
def test_a_value_has_two_digits_of_its_error(value, sigma, said):
    """Contract: in campaigns, comparisons and pages alike."""
    assert results.rounded(value, sigma) == said
