"""How a flow runs: here (inline), only in thought (plan), or through Prefect. The flow's text is the same for all.

@flow(name="com_offset")
def calibrate(source, chosen): ...

ref = calibrate(source, chosen)                          # inline
steps, ref = plan(calibrate, source, chosen)             # what would be reused or made, and why; computes nothing
ref = run(calibrate, source, chosen, engine="prefect")   # plans first; starts Prefect only if there is work
"""

import collections
import contextlib
import functools
import math
import os
import sys
import threading
from dataclasses import dataclass

from gravcal.errors import GravcalError
from gravcal.store import history, inputs, keys, location, store
from gravcal.store.records import ProductRef
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


class FailsAgain(GravcalError):
    """A flow has come to the stage at which its last run failed, and nothing has changed."""


def flow(*, name):
    """Decorator that gives a function of stages the name under which it runs; called, it runs inline.

    Readable links are those of the configuration that the arguments name.
    """

    def decorate(body):
        @functools.wraps(body)
        def configured(*arguments):
            with location.configured(configuration_of(arguments)):
                return body(*arguments)

        configured.flow_name = name
        return configured

    return decorate


def configuration_of(arguments):
    """Configuration that the parameters among the arguments of a flow name."""
    named = (getattr(one, "configuration", None) for one in arguments)
    return next((name for name in named if name), location.OPERATIONAL)


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
    failure : record of the last run where it failed at a stage whose inputs, settings and code have not changed
    """

    ref: ProductRef | None
    found: list
    seconds: float
    failure: dict | None = None


def left(body, *arguments, again=False):
    """What a flow has left to make; nothing is computed.

    Parameters
    ----------
    body : flow
    *arguments : those of the flow
    again : whether what failed is to be tried again
    """
    with location.configured(configuration_of(arguments)):
        failure = None if again else history.failure(_event(arguments), body.flow_name)
    seeker = Seeker(failure)
    with stage.using(seeker):
        try:
            ref = body(*arguments)
        except FailsAgain:
            return Left(None, seeker.found, 0.0, failure)
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
    steps, ref = plan(body, *arguments)
    told = other_versions(reason for step in steps if step.action == "reuse" for reason in step.reasons)
    if told:
        warn(told)
    if ref is not None and all(step.action == "reuse" for step in steps):
        engine = "inline"
    planned = [step.stage for step in steps]
    noted = history.recorded(body.flow_name, _event(arguments), planned)
    with location.configured(configuration_of(arguments)), noted as note, one_thread():
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
    """Engine that makes nothing: what is there, and how long the rest took the last time.

    Parameters
    ----------
    failure : record of the last run if it failed, or None
    """

    def __init__(self, failure=None):
        self.found, self.seconds, self.failure = [], 0.0, failure

    def __call__(self, call):
        """Reference of the product, without key and digest if it is not there.

        A file of which there never was a product ends the search, unless the last run failed: who makes one reads it.
        """
        new = any(inputs.is_file(item) for item in call.inputs) and store.last_seconds(call.unmade) == math.inf
        if new and not self.failure:
            raise Unknown(f"{call.unmade.stage} was never made", event=call.event)
        key = None if _unknown(call) else keys.key(stage.recipe(call)[0])
        ref = key and stage.usable(key)
        if key and not ref and self.failure and key == self.failure["failed_key"]:
            raise FailsAgain(f"{call.unmade.stage} fails as before", event=call.event)
        if not ref:
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
        other = tuple(history.other_versions(found)) if found else ()
        if found and not (other and history.remakes_versions()):
            self._note(call, "reuse", other, found)
            return found
        reasons = other or history.why(recipe, modules)
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


def remake_versions(wanted):
    """Let products that other versions of numpy, scipy or numba made be made again from now on, or not; also below."""
    os.environ[history.REMAKE] = "1" if wanted else "0"


def other_versions(reasons):
    """Sentence on the products of other versions that are reused, "" where there are none."""
    counts = collections.Counter(reasons)
    said = "; ".join(f"{count} {reason}" for reason, count in counts.items())
    return f"products reused: {said}. --remake-versions makes them again." if said else ""


def warn(message):
    """One line on standard error."""
    sys.stderr.write(f"gravcal: {message}\n")
