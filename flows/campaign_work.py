"""One event of a campaign, as it runs in a worker process; knows nothing of Prefect."""

import importlib
import os
import time
import traceback
from dataclasses import dataclass

from flows.engine import one_thread, single_threaded
from gravcal.data import journal
from gravcal.errors import GravcalError
from tasks import stage


@dataclass(frozen=True)
class Refused:
    """Stands for the source of an event that has none, and why."""

    event: str
    error: str


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
    row : dict of "event", "status", "made", "reused", "seconds", "report" or "error", and "document"
    """
    single_threaded()
    os.environ["GRAVCAL_PRODUCTS"] = store
    counts = {"made": 0, "cached": 0}

    def count(call, state, ref):  # noqa: ARG001
        counts[state] += 1

    started = time.perf_counter()
    with one_thread(), stage.using(stage.inline, count):
        row = _attempt(calibration, source, chosen)
    return row | {
        "made": counts["made"],
        "reused": counts["cached"],
        "seconds": round(time.perf_counter() - started, 3),
    }


def version():
    """Version of gravcal in this process."""
    import gravcal

    return gravcal.__version__


def _attempt(calibration, source, chosen):
    """Result of one event; an error becomes a row of its own kind."""
    from flows import command

    event = command.name_of(source)
    if isinstance(source, Refused):
        return {"event": event, "status": "failed", "error": source.error, "document": None}
    try:
        module = importlib.import_module(f"flows.{calibration}")
        with journal.recorded(module.calibrate.flow_name, event) as note, stage.using(stage.inline, note):
            ref = module.calibrate(source, chosen)
        document = module.document(ref)
        return {"event": event, "status": document["status"], "report": str(ref.folder), "document": document}
    except GravcalError as error:
        return {"event": event, "status": "failed", "error": str(error), "document": None}
    except Exception as error:  # noqa: BLE001 - one event must not stop the others
        where = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({where.filename}:{where.lineno})"
        return {"event": event, "status": "failed", "error": text, "document": None}
