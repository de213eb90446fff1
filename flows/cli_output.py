"""What the commands print: tables, progress on a terminal, and errors on one screen."""

import contextlib
import json
import os
import shutil
import sys
import textwrap
import traceback

from gravcal.errors import NoDataError

AXES = "xyz"
COLOURS = {
    "run": "yellow",
    "may run": "yellow",
    "reuse": "green",
    "delivered": "green",
    "questionable": "yellow",
    "no_manoeuvre": "yellow",
    "no_data": "yellow",
    "failed": "red",
    "equal": "green",
    "different": "red",
}


def say(text=""):
    """One line on standard output."""
    sys.stdout.write(text + "\n")


def note(text):
    """One line on standard error, for those who wait."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def to_screen(json_path):
    """Whether standard output is for people; with ``--json -`` it is for the document."""
    return json_path is None or str(json_path) != "-"


def write_json(document, path):
    """Write a document where it is wanted: nowhere, into a file, or to standard output."""
    from gravcal.errors import ProductError

    if path is None:
        return
    text = json.dumps(document, indent=1, allow_nan=False)
    if str(path) == "-":
        say(text)
    else:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text + "\n")
        except OSError as error:
            raise ProductError(f"{path}: the document cannot be written ({error.strerror}). Free its place.") from error


def result(document, ref, json_path):
    """Table of a result and where its report is."""
    if not to_screen(json_path):
        return
    name = document.get("configuration", "operational")
    say(f"{document['event']}: {document['status']}{'' if name == 'operational' else f' (experiment {name})'}")
    _offsets(document, None)
    _verdict(document)
    _where(ref, name)


def comparison(document, truth, ref, json_path):
    """Table of estimates beside the truth."""
    if not to_screen(json_path):
        return
    say(f"Simulated event {document['event']}: offset from proof mass to centre of mass, in micrometres")
    _offsets(document, truth.get("offset_um"))
    _verdict(document)
    _where(ref, document["configuration"])


def plan(steps, json_path):
    """Table of a plan: what is reused, what runs, and why."""
    document = [
        {"event": step.event, "stage": step.stage, "action": step.action, "reasons": list(step.reasons)}
        for step in steps
    ]
    write_json(document, json_path)
    if to_screen(json_path):
        table(["event", "stage", "action", "why"], [[s.event, s.stage, s.action, "; ".join(s.reasons)] for s in steps])
        counts = {action: sum(step.action == action for step in steps) for action in ("reuse", "run", "may run")}
        say(", ".join(f"{action}: {count}" for action, count in counts.items()))


def manoeuvres(document, json_path):
    """Table of the manoeuvres found."""
    from gravcal.report.documents import foreword

    if not to_screen(json_path):
        return
    rows = [
        [f"{one.get('satellite', '')} {one['kind']}".strip(), f"{one['start']:.3f}", f"{one['stop']:.3f}"]
        for one in document["manoeuvres"]
    ]
    table(["kind", "start (GPS s)", "stop (GPS s)"], rows)
    say(f"{foreword(document.get('origin', 'measured'))}{len(rows)} manoeuvre(s)")


def campaign(summary, json_path):
    """Table of a campaign: what was delivered, what failed and why."""
    from flows import engine

    if not to_screen(json_path):
        return
    names = ("event", "status", "made", "reused", "seconds")
    if summary.get("origin", "measured") != "measured":
        names = (*names[:2], "origin", *names[2:])
    order = ("failed", "questionable", "no_data", "no_manoeuvre", "delivered")  # failed first
    rows = sorted(summary["events"], key=lambda row: order.index(row["status"]))
    told = [[*(row.get(name, "") for name in names), row.get("error") or row.get("said", "")] for row in rows]
    table([*names, "values or reason"], told)
    say(", ".join(f"{status}: {count}" for status, count in sorted(summary["counts"].items())))
    answered = sum("since" in row for row in rows)
    if answered:
        say(f"{answered} failed as before: nothing they depend on has changed (--only-failed tries again)")
    other = engine.other_versions(reason for row in rows for reason in row.get("other_versions", ()))
    if other:
        say(other)
    if any(row.get("report") for row in rows):
        say(f"reports: gravcal report EVENT{_as(summary)}, or gravcal browse")


def _as(summary):
    """Option that names the configuration of a campaign where it is an experiment."""
    name = summary["configuration"]
    return "" if name == "operational" else f" --as {name}"


def table(heads, rows):
    """Table in plain columns, each as wide as its widest entry, numbers to the right; in colour on a terminal."""
    cells = [heads, *[[str(cell) for cell in row] for row in rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(heads))]
    numbers = [
        bool(rows) and all(isinstance(row[column], (int, float)) for row in rows) for column in range(len(heads))
    ]
    for count, row in enumerate(cells):
        texts = [
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(row, widths, numbers, strict=True)
        ]
        texts[-1] = texts[-1].rstrip()
        say("  ".join(_painted(text, "bold" if count == 0 else "") for text in texts).rstrip())


def coloured():
    """Whether standard output is a terminal that shows colours and its user wants them (NO_COLOR)."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _painted(text, style):
    """Text in bold, or in the colour of its word."""
    colour = COLOURS.get(text.strip())
    if not (style or colour) or not coloured():
        return text
    import typer

    return typer.style(text, fg=colour, bold=style == "bold")


def error(problem):
    """GravcalError on one screen: where, found, expected, remedy, as its message says."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 110)
    word = "no data" if isinstance(problem, NoDataError) else "error"
    lines = textwrap.wrap(
        f"{word}: {problem}", width, subsequent_indent="       ", break_long_words=False, break_on_hyphens=False
    )
    sys.stderr.write("\n".join(lines[:20]) + "\n")


def unexpected(problem):
    """An error that gravcal did not foresee: one line, the trace in a file."""
    from gravcal.store import location

    if os.environ.get("GRAVCAL_DEBUG"):
        raise problem
    where = location.folder() / "last-error.txt"
    try:
        where.parent.mkdir(parents=True, exist_ok=True)
        where.write_text("".join(traceback.format_exception(problem)))
        hint = f"The trace is in {where}; please report it."
    except OSError:
        hint = "Set GRAVCAL_DEBUG=1 to see the trace."
    first = (str(problem).splitlines() or [""])[0]
    sys.stderr.write(f"error: {type(problem).__name__}: {first}\n       {hint}\n")


@contextlib.contextmanager
def failures(calibration, source, json_path, configuration):
    """Write a document with status "failed" before an error goes on."""
    from flows import command
    from gravcal.errors import GravcalError

    try:
        yield
    except GravcalError as problem:
        write_json(command.failed(calibration, source, problem, configuration), json_path)
        raise


def _offsets(document, truth):
    """Rows of estimate, sigma and, if known, truth for each variant of an offset."""
    rows = []
    for name, variant in (document.get("variants") or {}).items():
        value, sigma = variant["offset_um"], variant["sigma_um"]
        cells = [_value(value[axis], sigma[axis]) for axis in range(3)]
        errors = [_error(value[axis], sigma[axis], truth[axis]) for axis in range(3)] if truth else []
        rows.append([name, *cells, *errors])
    if truth:
        rows.append(["truth", *[f"{value:.2f}" for value in truth], "", "", ""])
    if rows:
        errors = [f"error/sigma {axis}" for axis in AXES] if truth else []
        table(["variant", *[f"{axis} +- sigma (um)" for axis in AXES], *errors], rows)


def _verdict(document):
    """What the errors hold, the verdict, and a warning where the processing is the published one."""
    name = (document.get("adopted") or {}).get("variant")
    block = (document.get("variants") or {}).get(name, {})
    total = block.get("sigma_total_um") or []
    if total and None not in total:
        parts = ", ".join(f"{axis} {sigma:.1f}" for axis, sigma in zip(AXES, total, strict=True))
        say(f"sigma: noise as measured; with inertia and dipole per current of the catalogue {parts} um ({name})")
    if document.get("method", "gravcal") != "gravcal":
        say(f"method: {document['method']}, for comparison only")
    verdict = document.get("verdict")
    text = verdict.get("text") if isinstance(verdict, dict) else verdict
    if text:
        say(text)


def _value(value, sigma):
    """Value with its sigma, or that it is not determined."""
    return "undetermined" if value is None else f"{value:.2f} +- {sigma:.2f}"


def _error(value, sigma, truth):
    """Error in sigmas."""
    return "" if value is None else f"{(value - truth) / sigma:+.2f}"


def _where(ref, configuration):
    """Paths of the files beside a report product."""
    from gravcal.store import location

    link = location.links(ref.event, configuration) / ref.stage
    folder = link if link.resolve() == ref.folder.resolve() else ref.folder
    for path in sorted(folder.iterdir()):
        if path.name not in ("meta.json", "product.nc"):
            say(f"{path.suffix.lstrip('.').upper():5} {path}")
