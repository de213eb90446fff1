"""How a flow runs: here (inline), only in thought (plan), or through Prefect. The flow's text is the same for all.

@flow(name="com_offset")
def calibrate(source, chosen): ...

ref = calibrate(source, chosen)                          # inline
steps, ref = plan(calibrate, source, chosen)             # what would be reused or made, and why; computes nothing
ref = run(calibrate, source, chosen, engine="prefect")   # plans first; starts Prefect only if there is work
"""

import contextlib
import math
import os
import sys
import threading
from dataclasses import dataclass

from flows import allocation
from gravcal.data import explain, inputs, journal, keys, store
from gravcal.data.references import ProductRef
from gravcal.errors import GravcalError
from tasks import stage

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
ENGINES = ("prefect", "inline")


@dataclass(frozen=True)
class Step:
    """One stage in a plan: reuse, run or may run, and why."""

    event: str
    stage: str
    action: str
    reasons: tuple[str, ...]
    ref: ProductRef


class Unknown(GravcalError):
    """A flow asked for the content of a product that a plan does not make."""


def flow(*, name):
    """Decorator that gives a function of stages the name under which it runs; called, it runs inline."""

    def decorate(body):
        body.flow_name = name
        return body

    return decorate


def single_threaded():
    """Let libraries loaded from now on use one thread: results do not depend on cores, workers do not multiply."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")


@contextlib.contextmanager
def one_thread():
    """Context in which also libraries that were loaded before use one thread; sums are then always the same.

    The number of threads is one of the whole process: where contexts of several threads overlap, the last one to end
    gives the old number back.
    """
    _limit.begin()
    try:
        yield
    finally:
        _limit.end()


class _Limit:
    """The limit of a process, held while anyone asks for it."""

    def __init__(self):
        self._guard, self._holders, self._limits = threading.Lock(), 0, []

    def begin(self):
        """Hold; libraries that were loaded since the last call are limited too."""
        with self._guard:
            self._holders += 1
            if "numpy" in sys.modules:
                import threadpoolctl

                self._limits.append(threadpoolctl.threadpool_limits(1))

    def end(self):
        """Let go."""
        with self._guard:
            self._holders -= 1
            while not self._holders and self._limits:
                self._limits.pop().restore_original_limits()


_limit = _Limit()


def plan(body, *arguments):
    """What a flow would do.

    Parameters
    ----------
    body : flow
    *arguments : those of the flow

    Returns
    -------
    steps : list of Step, in the order of the flow
    ref : ProductRef of the result, None where the flow needs a content that is not there yet
    """
    planner = Planner()
    with stage.using(planner):
        try:
            ref = body(*arguments)
        except Unknown as stop:
            return [*planner.steps, Step(stop.facts["event"], "(the rest)", "may run", (str(stop),), None)], None
    return planner.steps, ref


@dataclass(frozen=True)
class Left:
    """What a flow has left to make.

    Attributes
    ----------
    ref : ProductRef of the result, None where something is missing
    found : list of (call, ProductRef) of what is there
    seconds : that what is missing took the last time, infinite where that is not known
    """

    ref: ProductRef | None
    found: list
    seconds: float


def left(body, *arguments):
    """What a flow has left to make; nothing is computed.

    Parameters
    ----------
    body : flow
    *arguments : those of the flow
    """
    seeker = Seeker()
    with stage.using(seeker):
        try:
            ref = body(*arguments)
        except Unknown:
            return Left(None, seeker.found, math.inf)
    return Left(None if ref.digest is None else ref, seeker.found, seeker.seconds)


def run(body, *arguments, engine="prefect", listener=None, server=None):
    """Result of a flow; Prefect is started only when something has to be made.

    Parameters
    ----------
    body : flow
    *arguments : those of the flow
    engine : "prefect" or "inline"
    listener : function of (call, state, ref), hears of each stage done; state is "cached" or "made"
    server : prefect_server.Server already begun, or None

    Returns
    -------
    ref : ProductRef of the result
    """
    single_threaded()
    allocation.keep_freed()
    steps, ref = plan(body, *arguments)
    if ref is not None and all(step.action == "reuse" for step in steps):
        engine = "inline"
    with journal.recorded(body.flow_name, _event(arguments), [step.stage for step in steps]) as note, one_thread():
        heard = _both(note, listener)
        if engine == "prefect":
            from flows import prefect_engine

            return prefect_engine.run(body, arguments, heard, server, steps)
        with stage.using(stage.inline, heard):
            return body(*arguments)


def _event(arguments):
    """Event that the first argument of a flow names, or None."""
    return getattr(arguments[0], "event", None) if arguments else None


def _both(first, second):
    """Listener that tells two; the second may be None."""

    def listener(*heard):
        first(*heard)
        if second:
            second(*heard)

    return listener


class Seeker:
    """Engine that makes nothing: what is there, and how long the rest took the last time."""

    def __init__(self):
        self.found, self.seconds = [], 0.0

    def __call__(self, call):
        """Reference of the product, without key and digest if it is not there.

        A file of which there never was a product ends the search: it is read by who makes one.
        """
        if any(inputs.is_file(item) for item in call.inputs) and store.last_seconds(call.unmade) == math.inf:
            raise Unknown(f"{call.unmade.stage} was never made", event=call.event)
        ref = None if _unknown(call) else store.find(keys.key(stage.recipe(call)[0]))
        if ref is None:
            self.seconds += store.last_seconds(call.unmade)
            return call.unmade
        store.point(ref)
        self.found.append((call, ref))
        return ref

    def resolve(self, ref):
        """The reference itself if its product is there; nobody knows what follows from its content otherwise."""
        return _known(ref)


class Planner:
    """Engine that makes nothing and notes what would be made."""

    def __init__(self):
        self.steps = []

    def __call__(self, call):
        """Reference of the product: complete if it is there, without key and digest if it would be made."""
        recipe, modules = stage.recipe(call)
        unknown = _unknown(call)
        found = None if unknown else store.find(keys.key(recipe))
        if found:
            self._note(call, "reuse", (), found)
            return found
        reasons = explain.why(recipe, modules)
        if unknown and not reasons:
            self._note(call, "may run", (f"after {', '.join(dict.fromkeys(unknown))}",), call.unmade)
        else:
            self._note(call, "run", tuple(reasons) or ("made before with another result",), call.unmade)
        return call.unmade

    def resolve(self, ref):
        """The reference itself if its product is there; otherwise the plan ends here."""
        return _known(ref)

    def _note(self, call, action, reasons, ref):
        """Add a step."""
        self.steps.append(Step(call.event, call.unmade.stage, action, reasons, ref))


def _unknown(call):
    """Stages of the inputs of a call that are not made yet."""
    return [item.stage for item in call.inputs if isinstance(item, ProductRef) and item.digest is None]


def _known(ref):
    """Reference of a product that is there."""
    if ref.digest is None:
        raise Unknown(f"after {ref.stage}", event=ref.event)
    return ref


def warn(message):
    """One line on standard error."""
    sys.stderr.write(f"gravcal: {message}\n")
