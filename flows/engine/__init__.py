"""Engines of a flow: in this process (inline), without computing (plan), or through Prefect; its code is the same.

@flow(name="com_offset")
def calibrate(source, chosen): ...

ref = calibrate(source, chosen)                          # inline
steps, ref = plan(calibrate, source, chosen)             # what would be reused or made, and why; computes nothing
ref = run(calibrate, source, chosen, engine="prefect")   # plans first; starts Prefect only if there is work
"""

import contextlib
import functools
import importlib
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import threadpoolctl

from flows.engine import server as servers
from gravcal.errors import GravcalError, refuse
from gravcal.io import archive
from gravcal.store import history, housekeeping, keys, location, store
from gravcal.store.store import ProductRef
from tasks import stage

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
ENGINES = ("prefect", "inline")


@dataclass(frozen=True)
class Step:
    """One stage in a plan: reuse, run or may run, and why."""

    event: str
    stage: str
    action: str  #: "reuse", "run" or "may run"
    reasons: tuple[str, ...]
    ref: ProductRef
    key: str | None = None  #: of the product, None where an input is not there yet


class Unknown(GravcalError):
    """A flow asked for the content of a product that a plan does not make."""


def flow(*, name):
    """Decorator that gives a function of stages the name under which it runs; called, it runs inline.

    Links under readable names, latest/<event>/<stage>, are those of the configuration that the parameters are of.
    """

    def decorate(body):  # body: (source, chosen) -> ProductRef
        @functools.wraps(body)
        def configured(source, chosen):
            with location.configured(getattr(chosen, "configuration", location.OPERATIONAL)):
                return body(source, chosen)

        configured.flow_name = name
        return configured

    return decorate


def single_threaded():
    """Let libraries loaded from now on use one thread: results do not depend on cores, workers do not multiply."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")


def one_thread():
    """Context in which also libraries that were loaded before use one thread; sums are then always the same."""
    return threadpoolctl.threadpool_limits(1)


def plan(body, source, chosen):
    """([Step] of a flow in order, ProductRef of its result or None if that needs a missing product); makes nothing."""
    planner = Planner()
    with stage.using(planner):
        try:
            ref = body(source, chosen)
        except Unknown as stop:
            return [*planner.steps, Step(stop.facts["event"], "(the rest)", "may run", (str(stop),), None)], None
    return planner.steps, ref


def run(body, source, chosen, engine="prefect", listener=None):
    """ProductRef of the result of a flow; Prefect is started only when something has to be made.

    The listener (call, state, ref) hears of each stage done, "cached" or "made".
    """
    single_threaded()
    steps, ref = plan(body, source, chosen)
    notice = history.other_versions_said(reason for step in steps if step.action == "reuse" for reason in step.reasons)
    if notice:
        warn(notice)
    if ref is not None and all(step.action == "reuse" for step in steps):
        engine = "inline"
    planned = [step.stage for step in steps]
    noted = history.recorded(body.flow_name, getattr(source, "event", None), planned)
    configured = location.configured(getattr(chosen, "configuration", location.OPERATIONAL))
    with configured, noted as note, one_thread():

        def heard(*stage_done):  # (call, state, ref)
            note(*stage_done)
            if listener:
                listener(*stage_done)

        if engine == "prefect":
            try:
                return _through_prefect(functools.partial(body, source, chosen), body.flow_name, heard, steps)
            except servers.Unavailable as error:
                warn(f"Prefect's server is not available ({error}); running without it.")
        with stage.using(stage.inline, heard):
            return body(source, chosen)


def attempt(part):
    """Result of ``part()``, or the GravcalError that it raises; its stages run in this process, whatever the engine.

    In a plan only errors that need no computation are returned, such as a missing file.
    """
    computes = getattr(stage.current(), "computes", True)
    try:
        with stage.using(stage.inline) if computes else contextlib.nullcontext():
            return part()
    except Unknown:
        raise
    except GravcalError as error:
        return error


class Planner:
    """Engine of a plan: makes nothing and lists the steps (`Step`) of a flow."""

    computes = False

    def __init__(self):
        self.steps = []

    def __call__(self, call):
        """Reference of the product: complete if it is there, without key and digest if it would be made."""
        recipe, modules = stage.recipe(call)
        unknown = [item.stage for item in call.inputs if isinstance(item, ProductRef) and item.digest is None]
        key = None if unknown else keys.key(recipe)
        stored = key and store.find(key)
        other = tuple(history.other_versions(stored)) if stored else ()
        ref = call.unmade
        if stored and not (other and history.remakes_versions()):
            action, reasons, ref = "reuse", other, stored
        else:
            action, reasons = "run", tuple(other or history.why(recipe, modules))
            if unknown and not reasons:
                action, reasons = "may run", (f"after {', '.join(dict.fromkeys(unknown))}",)
        reasons = reasons or (("made before with another result",) if action == "run" else ())
        self.steps.append(Step(call.event, call.unmade.stage, action, reasons, ref, key))
        return ref

    def resolve(self, ref):
        """The reference itself if its product is there; otherwise the plan ends here."""
        if ref.digest is None:
            raise Unknown(f"after {ref.stage}", event=ref.event)
        return ref


def warn(message):
    """Write "gravcal: message" to standard error."""
    sys.stderr.write(f"gravcal: {message}\n")


def remake(entry):
    """Make a product (Entry) again in an empty store: {"product", "equal": bool, "stages": [dict of `_remade`]}."""
    stages = []
    housekeeping.content(entry)  # refused if it is not what its record says
    single_threaded()
    with tempfile.TemporaryDirectory(prefix="gravcal-rebuild-") as folder:
        original = location.folder()
        with other_store(folder), one_thread():
            made = _remade(entry.ref.key, original, stages, {})
    return {"product": entry.ref.name, "equal": made.digest == entry.record["digest"], "stages": stages}


def _remade(key, original, stages, done):
    """ProductRef of a key, made again once (`done`) by its record in the store `original`; its verdict to `stages`."""
    if key in done:
        return done[key]
    record = store.read_record(original / "objects" / key[:2] / key)
    if record is None:
        refuse(f"product {key[:12]}", f"that its record is no longer in {original}", "it", "Run its event again.")
    inputs = [
        _raw_file(part, label) if "path" in part else _remade(part["key"], original, stages, done)
        for part, label in store.inputs(record)
    ]
    recipe, (module, _, name) = record["recipe"], record["stage"].partition(":")
    settings = dict(recipe["settings"]) | {"event": recipe["event"], "variant": recipe["variant"]}
    try:
        body = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        missing, remedy = f"no stage {record['stage']} ({error})", f"Install gravcal {record['versions']['gravcal']}."
        refuse(recipe["kind"], missing, "the stage that made it", remedy, stage=record["stage"])
    made = done[key] = body(*inputs, **settings)
    new_record = store.read_record(made.folder)
    changed, version = history.changed(record, new_record), new_record["recipe"]["version"]
    if recipe["version"] != version:
        changed.append(f"version {recipe['version']} -> {version}")
    verdict = "equal" if made.digest == record["digest"] else "different"
    stages.append({"stage": made.stage, "verdict": verdict, "why": "; ".join(changed)})
    return made


def _raw_file(part, label):
    """LevelOneFile of a recorded input (place; label in the recipe), refused if it is gone or its SHA-256 differs."""
    path = Path(part["path"])
    where = f"{path}:{part['member']}" if part["member"] else str(path)
    if not path.is_file():
        refuse(where, "that the raw file is not there any more", "it", "Put it back to make the product again.")
    names = ("product", "satellite", "date", "release")
    file = archive.LevelOneFile(path, part["member"], *(label[name] for name in names))
    digest = keys.labelled(file)["digest"]
    if digest != label["digest"]:
        remedy = "The raw file changed; run its event again."
        refuse(where, f"SHA-256 {digest[:12]}", f"{label['digest'][:12]}, from which the product was made", remedy)
    return file


@contextlib.contextmanager
def other_store(folder):
    """Context in which the store is another folder (str), by GRAVCAL_PRODUCTS."""
    before = dict(os.environ)
    os.environ["GRAVCAL_PRODUCTS"] = folder
    try:
        yield
    finally:
        del os.environ["GRAVCAL_PRODUCTS"]
        os.environ.update(before)


@dataclass(frozen=True)
class Pending(ProductRef):
    """Reference to a product that a submitted task will give."""

    future: object = None


class Submitter:
    """Engine that turns each stage into a task of the flow that is running."""

    def __init__(self, listener):
        self.pending, self.listener = [], listener

    def __call__(self, call):
        """Pending reference to the product of a Call, submitted as a Prefect task."""
        waits = [item.future if isinstance(item, Pending) else item for item in call.inputs]
        future = _task(call, self.listener).submit(*waits)
        self.pending.append(Pending(call.event, call.stage.writes, call.variant, future=future))
        return self.pending[-1]

    def resolve(self, ref):
        """ProductRef of the finished product of a Pending, after all tasks; others are returned as they are."""
        if not isinstance(ref, Pending):
            return ref
        self.raise_first()
        return ref.future.result()

    def raise_first(self):
        """Wait for all tasks; raise the error of the first that failed, in the order of the flow."""
        for pending in self.pending:
            pending.future.wait()
        for pending in self.pending:
            state = pending.future.state
            if state.is_failed() or state.is_crashed():
                pending.future.result()


def _through_prefect(body, name, listener, steps):
    """ProductRef that ``body()`` returns, its stages Prefect tasks, after a plan of steps; Unavailable if no server."""
    engine = Submitter(listener)

    def stages():  # ProductRef of the result, as body of the Prefect flow
        from prefect.artifacts import create_table_artifact

        rows = [{"stage": one.stage, "action": one.action, "why": "; ".join(one.reasons)} for one in steps]
        if rows:
            create_table_artifact(table=rows, key="plan", description=f"Plan of {steps[0].event}")
        with stage.using(engine):
            ref = body()
            engine.raise_first()
            return engine.resolve(ref)

    begun = servers.begin()
    import dask.base  # noqa: F401 - before there are threads: two that import it at once fail
    import prefect  # noqa: F401 - takes seconds, while the server comes up

    with servers.running(begun) as url:
        return flow_on(url, stages, name, lambda: len(engine.pending))


def flow_on(url, body, name, count):
    """Result of ``body()`` run as a Prefect flow on the server at url, once that recorded ``count()`` ended tasks."""
    import prefect
    from prefect.context import get_run_context
    from prefect.settings import PREFECT_FLOWS_HEARTBEAT_FREQUENCY, temporary_settings
    from prefect.task_runners import ThreadPoolTaskRunner

    known = {}

    def watched():  # `body` after tagging its run
        known["run"] = get_run_context().flow_run.id
        servers.sign(url, known["run"])
        return body()

    servers.bury(url)
    # a heartbeat would make every flow last a second longer
    with temporary_settings(servers.client(url) | {PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):
        runner = ThreadPoolTaskRunner(max_workers=2 * (os.cpu_count() or 1))
        wrapped = prefect.flow(watched, name=name, task_runner=runner, persist_result=False, validate_parameters=False)
        try:
            return wrapped()
        finally:
            if known:
                servers.drain(url, known["run"], count())


def _task(call, listener):
    """Prefect task of one call; its parameters are the references of the inputs. A product that was there is Cached."""
    import prefect
    from prefect.cache_policies import NO_CACHE
    from prefect.states import Completed

    @functools.wraps(call.stage.body)
    def work(*inputs):  # ProductRef, or Completed with it
        known = stage.Call(call.stage, inputs, call.settings, call.event, call.variant)
        with stage.using(stage.inline):
            ref, state = stage.perform(known)
        if listener:
            listener(known, state, ref)
        if state == "cached":
            return Completed(name="Cached", message=f"product {ref.key[:12]}", data=ref)
        return ref

    del work.__wrapped__
    return prefect.task(work, name=call.unmade.stage, cache_policy=NO_CACHE, persist_result=False)
