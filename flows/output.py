"""Output of the commands: tables, errors on one screen, and progress on a terminal."""

import contextlib
import itertools
import json
import os
import shutil
import sys
import textwrap
import traceback

from gravcal import catalog
from gravcal.errors import NoDataError, ProductError
from gravcal.store import history, location
from gravcal.store.product import foreword
from tasks.stage import lazy

joint_report, plain = lazy("gravcal.report.joint"), lazy("gravcal.report.plain")

REASONS, SHOWN = 2, 4  # of a stage that a plan shows, and stages that one of them names
WIDE = 100_000  # characters: rows are never broken
COLOURS = dict.fromkeys(("run", "may run", "questionable", "no_manoeuvre", "no_data"), "yellow")
COLOURS |= dict.fromkeys(("reuse", "delivered", "equal"), "green") | dict.fromkeys(("failed", "different"), "red")


def say(text=""):
    """Write a line to standard output, unbuffered."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def note(text):
    """Write a line of progress to standard error, unbuffered."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def to_screen(json_path):
    """True if standard output is for tables and text; with ``--json -`` it is for the document."""
    return json_path is None or str(json_path) != "-"


def write_json(document, path):
    """Write a document as JSON: nowhere (path None), to standard output ("-"), or into a file."""
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


def delivered(document, path):
    """Write a document by `write_json`; True if standard output is free for tables and text."""
    write_json(document, path)
    return to_screen(path)


def result(document, ref, json_path, truth=None):
    """Print a result: JSON document, or table (with errors against ``truth``), verdict and paths of its report."""
    if not delivered(document, json_path):
        return
    name = document.get("configuration", "operational")
    if truth:
        say(f"Simulated event {document['event']}: offset from proof mass to centre of mass, in micrometres")
    else:
        say(f"{document['event']}: {document['status']}{'' if name == 'operational' else f' (experiment {name})'}")
    true_um, variants = (truth or {}).get("offset_um"), document.get("variants") or {}
    rows = []
    for variant, one in variants.items():
        pairs = list(zip(one["offset_um"], one["sigma_um"], strict=True))
        cells = ["undetermined" if v is None else f"{v:.2f} +- {s:.2f}" for v, s in pairs]
        errors = ["" if v is None else f"{(v - t) / s:+.2f}" for (v, s), t in zip(pairs, true_um or (), strict=False)]
        rows.append([variant, *cells, *errors])
    if true_um:
        rows.append(["truth", *[f"{value:.2f}" for value in true_um], "", "", ""])
    if rows:
        errors = [f"error/sigma {axis}" for axis in plain.AXES] if true_um else []
        table(["variant", *[f"{axis} +- sigma (um)" for axis in plain.AXES], *errors], rows)
        say("sigma: noise as measured; errors of the verdict hold those of inertia and dipole per current as well")
    if document.get("method", "gravcal") != "gravcal":
        say(f"method: {document['method']}, for comparison only")
    if document.get("verdict"):
        say(document["verdict"]["text"])
    link = location.links(ref.event, name) / ref.stage
    folder = link if link.resolve() == ref.folder.resolve() else ref.folder
    for path in sorted(folder.iterdir()):
        if path.name not in ("meta.json", "product.nc"):
            say(f"{path.suffix.lstrip('.').upper():5} {path}")


def plan(steps, json_path, every=False):
    """Print a plan: JSON, or table by stage of what is made, how long it takes and why; every: one row a product."""
    if not delivered(steps, json_path):
        return
    if every:
        rows = [[s["event"], s["stage"], s["action"], took(s["seconds"]), "; ".join(s["reasons"])] for s in steps]
        table(["event", "stage", "action", "about", "why"], rows)
    groups, rows = {}, []
    for step in (one for one in steps if one["action"] != "reuse" and not every):
        groups.setdefault((".".join(step["stage"].split(".")[:2]), step["action"]), []).append(step)
    for (stage, action), own in groups.items():
        times = [step["seconds"] for step in own if step["seconds"] is not None]
        why = list(dict.fromkeys(_after(reason) for step in own for reason in step["reasons"]))
        more = f"; and {len(why) - REASONS} more" if len(why) > REASONS else ""
        said = took(sum(times) if times else None), "; ".join(why[:REASONS]) + more
        rows.append([stage, len({step["event"] for step in own}), len(own), action, *said])
    if rows:
        table(["stage", "events", "products", "action", "about", "why"], rows)
    say(_total(steps, every))


def _total(steps, every):
    """Text with the numbers of products reused and made, and the processor time of the latter."""
    counts = {action: sum(step["action"] == action for step in steps) for action in ("reuse", "run", "may run")}
    seconds = [step["seconds"] for step in steps if step["action"] != "reuse"]
    duration = took(sum(one for one in seconds if one is not None)) if set(seconds) - {None} else ""
    unknown = sum(one is None for one in seconds)
    cost = f"; about {duration} of processor time" if duration else ""
    cost += f"{',' if cost else ';'} {unknown} not known yet" if unknown else ""
    hint = "" if every or not counts["reuse"] else " (--all shows what is reused)"
    return ", ".join(f"{action}: {count}" for action, count in counts.items()) + cost + hint


def _after(reason):
    """Reason as text; "after <products>" becomes "after <stages>", at most SHOWN of them, without calibration."""
    word, _, names = reason.partition("after ")
    if word or not names:
        return reason
    stages = list(dict.fromkeys(".".join(name.split(".")[1:2]) for name in names.split(", ")))
    return f"after {', '.join(stages[:SHOWN])}{', ...' if len(stages) > SHOWN else ''}"


def took(seconds):
    """Duration as text, "12 s", "3 min" or "2.5 h"; "?" for None."""
    if seconds is None:
        return "?"
    if seconds < 99.5:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def manoeuvres(document, json_path):
    """Print the document of `command.detect`: JSON, or table of the manoeuvres found."""
    if not delivered(document, json_path):
        return
    rows = []
    for one in document["manoeuvres"]:
        ends = one["start"], one["stop"]
        rows.append([f"{one.get('satellite', '')} {one['kind']}".strip(), *(plain.gps_text(end, 3) for end in ends)])
        rows[-1] += [f"{end:.3f}" for end in ends]
    table(["kind", "start (GPS time)", "stop (GPS time)", "start (GPS s)", "stop (GPS s)"], rows)
    say(f"{foreword(document.get('origin', 'measured'))}{len(rows)} manoeuvre(s)")


def campaign(summary, first, json_path):
    """Print the summary of a campaign: JSON, or table of its rows, values or the reason of a failure.

    `first`: rows to print, and text on those left out, as of `campaign.table`.
    """
    if not delivered(summary, json_path):
        return
    names = ("event", "status", "made", "reused", "seconds")
    if summary.get("origin", "measured") != "measured":
        names = (*names[:2], "origin", *names[2:])
    shown, left_out = first
    cells = [[*(row.get(name, "") for name in names), row.get("error") or row.get("said", "")] for row in shown]
    table([*names, "values or reason"], cells)
    say(", ".join(f"{status}: {count}" for status, count in sorted(summary["counts"].items())) + left_out)
    rows = summary["events"]
    answered = sum("since" in row for row in rows)
    if answered:
        say(f"{answered} failed as before: nothing they depend on has changed (--only-failed tries again)")
    other = history.other_versions_said(reason for row in rows for reason in row.get("other_versions", ()))
    if other:
        say(other)
    if any(row.get("report") for row in rows):
        name = summary["configuration"]
        say(f"reports: gravcal report EVENT{'' if name == 'operational' else f' --as {name}'}, or gravcal browse")


def discovery(document, files, json_path):
    """Print a discovery: JSON document, or verdict, table of findings and paths of its files."""
    if not delivered(document, json_path):
        return
    say(f"{document['event']}: {document['verdict']['text']}")
    rows = []
    for one in document.get("findings", []):
        for name, parameter in one["parameters"].items():
            if parameter["value"] is not None:
                value = plain.measured(*(parameter[n] for n in ("value", "sigma", "unit")))
                rows.append([one["cause"], name, *value])
    if rows:
        table(["cause", "parameter, all free", "value", "unit"], rows)
    for path in files:
        say(str(path))


def joint(searches, json_path):
    """Print joint searches, (document, files, changes) each: JSON, or verdicts, changes, paths and shared causes."""
    documents = [document | {"changes": notes} for document, _, notes in searches]
    both = joint_report.shared(documents) if len(documents) > 1 else []
    if not delivered(documents[0] | ({"others": documents[1:], "shared": both} if documents[1:] else {}), json_path):
        return
    for document, files, notes in searches:
        say(f"{document['event']}: {document['verdict']['text']}")
        for event, reason in document["provenance"]["settings"]["left_out"].items():
            note(f"{event} left out: {reason}")
        for text in [*(f"changed: {one}" for one in notes), *map(str, files)]:
            say(text)
    for text in both:
        say(text)


def design(document, out, json_path):
    """Print a design: JSON document, or its manoeuvres, and errors and odds compared with the published session."""
    if not delivered(document, json_path):
        return
    number = lambda one: f"{one:.4g}" if isinstance(one, float) else str(one)  # noqa: E731
    cell = lambda one: ", ".join(map(number, one)) if isinstance(one, list) else number(one)  # noqa: E731
    heads = ["count", "kind", *(name for name in document["manoeuvres"][0] if name not in ("count", "kind"))]
    table(heads, [[cell(one[name]) for name in heads] for one in document["manoeuvres"]])
    new, old, achieved = document["design"], document["published"], document.get("verified")
    minutes = {"design": document["minutes"], "published": document["published_minutes"]}
    heads = ["sigma, noise alone", *(f"{whose}, {time:.3g} min" for whose, time in minutes.items())]
    digits = lambda one: "not determined" if one is None else f"{one:.3g}"  # noqa: E731
    rows = [[f"{name} ({new['unit'][name]})", *(digits(d["sigma"][name]) for d in (new, old))] for name in new["sigma"]]
    if achieved:
        heads += [f"achieved in {achieved['flights']} flights", "rms error"]
        pairs = zip(rows, achieved["sigma"], achieved["error_rms"], strict=True)
        rows = [[*row, digits(sigma), digits(error)] for row, sigma, error in pairs]
    table(heads, rows)
    if old["trace"]:  # it says something of what is asked for
        reduction = 100 * (1 - new["trace"] / old["trace"])
        said = "not less than that of" if reduction < 0.5 else f"{reduction:.0f} % below"
        say(f"trace of the covariance: {said} the published session")
    say(f"noise, of flights too: that of {document['noise']['of']}")
    rows = [
        [" and ".join(a["causes"]), f"{a['chi2']:.3g}", f"{a['odds']:.0%}", f"{b['chi2']:.3g}", f"{b['odds']:.0%}"]
        for a, b in zip(new["separated"], old["separated"], strict=True)
    ]
    if rows:
        flown = (achieved or {}).get("separated", ())
        rows = [[*row, f"{n['separated']} of {n['flights']}"] for row, n in zip(rows, flown, strict=False)] or rows
        heads = ["told apart", "chi2, design", "odds", "chi2, published", "odds"]
        table(heads + ["told apart in flights"] * bool(flown), rows)
    if out:
        known = {"date", "satellite"} & catalog.parameters(f"simulate_{document['calibration']}").entries.keys()
        words = " ".join(f"--set {name}={document[name]}" for name in sorted(known))
        flight = f"simulate {document['calibration']} --design {out / 'plan.toml'} {words} --out {out / 'data'}"
        say(f"{out / 'plan.toml'}; fly it with gravcal {flight}")


def table(heads, rows):
    """Print a table in plain columns as wide as their widest entry, numbers to the right; coloured in a terminal."""
    from rich import console, table, text

    made = table.Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    for head, *column in zip(heads, *rows, strict=True):
        right = bool(column) and all(isinstance(cell, (int, float)) for cell in column)
        made.add_column(text.Text(head), justify="right" if right else "left", no_wrap=True)
    for row in rows:
        made.add_row(*(text.Text(str(cell), COLOURS.get(str(cell), "")) for cell in row))
    screen = console.Console(width=WIDE, height=WIDE, force_terminal=False if os.environ.get("NO_COLOR") else None)
    with screen.capture() as captured:
        screen.print(made)
    for line in captured.get().splitlines():
        say(line.rstrip())


def named(rows, *names):
    """Print a table of dicts, a column for each of these keys."""
    table(names, [[row[name] for name in names] for row in rows])


def error(problem):
    """Print a GravcalError to standard error, 20 lines at most: where, found, expected, remedy, as its message says."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 110)
    word = "no data" if isinstance(problem, NoDataError) else "error"
    lines = textwrap.wrap(
        f"{word}: {problem}", width, subsequent_indent="       ", break_long_words=False, break_on_hyphens=False
    )
    sys.stderr.write("\n".join(lines[:20]) + "\n")


def unexpected(problem):
    """Print any other error in one line, its traceback goes into a file; raised where GRAVCAL_DEBUG is set."""
    if os.environ.get("GRAVCAL_DEBUG"):
        raise problem
    if isinstance(problem, OSError) and problem.filename:  # of a path that the user named
        error(f"{problem.filename}: {problem.strerror}. Check its permissions, or name another place.")
        return
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
def _bars(*columns, **options):
    """Context with rich.Progress on standard error, columns by class name or text; None if that is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich import console, progress

    made = (getattr(progress, one)() if hasattr(progress, one) else one for one in columns)
    with progress.Progress(*made, console=console.Console(stderr=True), transient=True, **options) as bars:
        yield bars


@contextlib.contextmanager
def progress(title, usual_s=None):
    """Context with a listener (call, state, ref) that shows stages done and usual time; None without a terminal."""
    title = f"{title}, about {usual_s:.0f} s" if usual_s else title
    with _bars("SpinnerColumn", "{task.description}", "{task.fields[said]}", "TimeElapsedColumn") as bars:
        counts, row = {"cached": 0, "made": 0}, bars and bars.add_task(title, total=None, said="")

        def listener(call, state, _ref):
            counts[state] += 1
            said = f"{counts['made']} made, {counts['cached']} reused, last {call.unmade.stage}"
            bars.update(row, said=said)

        yield bars and listener


@contextlib.contextmanager
def events_progress(total):
    """Context with a listener (row of a campaign) that shows events done and failed; None without a terminal."""
    shown = ("MofNCompleteColumn", "{task.description}", "BarColumn", "TimeRemainingColumn")
    with _bars(*shown, auto_refresh=False) as bars:  # forks: no thread
        row, failed = bars and bars.add_task("0 failed", total=total), itertools.count()

        def listener(event):
            said = {"description": f"{next(failed) + 1} failed"} if event["status"] == "failed" else {}
            bars.update(row, advance=1, refresh=True, **said)

        yield bars and listener


@contextlib.contextmanager
def bytes_progress():
    """Context with a listener (archive name, bytes done, total or None) that shows bars; None without a terminal."""
    shown = ("{task.description}", "BarColumn", "DownloadColumn", "TransferSpeedColumn", "TimeRemainingColumn")
    with _bars(*shown) as bars:
        rows = {}

        def listener(name, done, total):
            if name not in rows:
                rows[name] = bars.add_task(name, total=total)
            bars.update(rows[name], completed=done, total=total)

        yield bars and listener
