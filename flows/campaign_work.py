"""One event of a campaign, as it runs in a worker process; knows nothing of Prefect."""

import contextlib
import math
import os
import time
import traceback
from dataclasses import dataclass

from flows.calibration import load
from flows.engine import left, one_thread, single_threaded
from gravcal.errors import GravcalError
from gravcal.store import history, location, results
from tasks import stage

SHOWN = 6  # values of an event that a table shows; all of them are in the summary
READING = "POLARS_MAX_THREADS"  # a run of its own reads with all cores; here each worker has one


@dataclass(frozen=True)
class Refused:
    """Stands for the source of an event that has none, and why."""

    event: str
    error: str
    status: str = "failed"


def calibrate(calibration, source, chosen, store):
    """Calibrate one event with its stages in this process.

    Parameters
    ----------
    calibration : str
    source : record of where the event's files are
    chosen : Parameters
    store : str, folder of the store

    Returns
    -------
    row : dict of "event", "status", "made", "reused", "seconds", "report" or "error", "verdict", "values", "said"; of a
        failure that was not tried again "since"
    """
    single_threaded()
    os.environ.setdefault(READING, "1")
    os.environ["GRAVCAL_PRODUCTS"] = store
    counts = {"made": 0, "cached": 0}

    def count(call, state, ref):  # noqa: ARG001
        counts[state] += 1

    started = time.perf_counter()
    try:
        with location.configured(chosen.configuration), one_thread(), stage.using(stage.inline, count):
            row = _attempt(calibration, source, chosen)
    finally:
        stage.forget()  # events do not share products; a worker lives for thousands
    return row | _effort(counts["made"], counts["cached"], started)


def reuse(calibration, source, chosen, again=False):
    """Row of an event whose products are all in the store or that fails as before, or how much it has left to do.

    Parameters
    ----------
    calibration, source, chosen : as for ``calibrate``
    again : whether what failed is tried again though neither inputs, settings nor code have changed

    Returns
    -------
    row : dict or None
    seconds : that the rest took the last time, infinite where that is not known
    """
    from flows import command

    known, started = load(calibration), time.perf_counter()
    try:
        rest = left(known.flow, source, chosen, again=again)
        if rest.failure:
            told = {"event": command.name_of(source), "status": "failed", "error": rest.failure["reason"]}
            return told | {"since": rest.failure["started"]} | _effort(0, len(rest.found), started), 0.0
        if rest.ref is None:
            return None, rest.seconds
        noted = history.recorded(known.flow.flow_name, rest.ref.event)
        with location.configured(chosen.configuration), noted as note:
            for call, one in rest.found:
                note(call, "cached", one)
        return _row(known, rest.ref, note) | _effort(0, len(rest.found), started), 0.0
    except GravcalError as error:  # such as a file that is missing: nothing had to be computed to see it
        event = command.name_of(source)
        noted = history.recorded(known.flow.flow_name, event)
        with contextlib.suppress(GravcalError), location.configured(chosen.configuration), noted:
            raise error
        return {"event": event, "status": command.status_of(error), "error": str(error)} | _effort(0, 0, started), 0.0
    except Exception:  # noqa: BLE001 - what goes wrong goes wrong again in its worker, which says it
        return None, math.inf


def version():
    """Version of gravcal in this process."""
    import gravcal

    return gravcal.__version__


def _attempt(calibration, source, chosen):
    """Result of one event; an error becomes a row of its own kind."""
    from flows import command

    event = command.name_of(source)
    if isinstance(source, Refused):
        return {"event": event, "status": source.status, "error": source.error}
    try:
        known = load(calibration)
        with history.recorded(known.flow.flow_name, event) as note, stage.using(stage.inline, note):
            ref = known.flow(source, chosen)
        return _row(known, ref, note)
    except GravcalError as error:
        return {"event": event, "status": command.status_of(error), "error": str(error)}
    except Exception as error:  # noqa: BLE001 - one event must not stop the others
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"
        return {"event": event, "status": "failed", "error": text}


def _row(known, ref, note):
    """Row of an event that has its report; the document stays in the store."""
    document = known.document(ref)
    row = {
        "event": ref.event,
        "status": document["status"],
        "origin": document.get("origin", "measured"),
        "report": str(ref.folder),
    }
    verdict = document.get("verdict")
    row["verdict"] = verdict.get("text", "") if isinstance(verdict, dict) else verdict or ""
    values = list(known.result(document))
    parts = ("value", "sigma", "sigma_total", "unit")
    row["values"] = {one.label: {part: getattr(one, part) for part in parts} for one in values}
    row["said"] = results.text(values[:SHOWN])
    if document["status"] == "failed":
        row["error"] = row["verdict"]
    other = [reason for one in note.stages.values() for reason in one.get("other_versions", ())]
    return row | ({"other_versions": other} if other else {})


def _effort(made, reused, started):
    """Columns of the row that say what was done."""
    return {"made": made, "reused": reused, "seconds": round(time.perf_counter() - started, 3)}
