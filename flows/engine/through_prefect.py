"""The engine that submits stages as Prefect tasks, so that a run can be watched and its history kept.

The store decides what runs: Prefect's own cache stays off, and a product that is there ends its task as "Cached".
"""

import functools
import os
from dataclasses import dataclass

from flows.engine import server
from gravcal.store.store import ProductRef
from tasks import stage


@dataclass(frozen=True)
class Pending(ProductRef):
    """Reference to a product that a submitted task will give."""

    future: object = None


class Submitter:
    """Engine that turns each stage into a task of the flow that is running."""

    def __init__(self, listener):
        self.pending, self.listener = [], listener

    def __call__(self, call):
        """Reference to the product of a submitted task."""
        waits = [item.future if isinstance(item, Pending) else item for item in call.inputs]
        future = _task(call, self.listener).submit(*waits)
        self.pending.append(Pending(call.event, call.stage.writes, call.variant, future=future))
        return self.pending[-1]

    def resolve(self, ref):
        """Reference of the finished product."""
        if not isinstance(ref, Pending):
            return ref
        self.raise_first()
        return ref.future.result()

    def raise_first(self):
        """Wait for all tasks; raise what went wrong first, in the order of the flow."""
        for pending in self.pending:
            pending.future.wait()
        for pending in self.pending:
            state = pending.future.state
            if state.is_failed() or state.is_crashed():
                pending.future.result()


def run(body, arguments, listener=None, begun=None, steps=()):
    """Result of a flow whose stages are Prefect tasks; Unavailable without a server."""
    engine = Submitter(listener)

    def stages():
        _show_plan(steps)
        with stage.using(engine):
            ref = body(*arguments)
            engine.raise_first()
            return engine.resolve(ref)

    begun = begun or server.begin()
    import prefect  # noqa: F401 - takes seconds, while the server comes up

    with server.running(begun) as url:
        return flow_on(url, stages, body.flow_name, lambda: len(engine.pending))


def flow_on(url, body, name, count):
    """What a function returns as a Prefect flow on a server that answers, once the server knows of all its tasks."""
    import prefect
    from prefect.context import get_run_context
    from prefect.settings import PREFECT_FLOWS_HEARTBEAT_FREQUENCY, temporary_settings
    from prefect.task_runners import ThreadPoolTaskRunner

    known = {}

    def watched():
        known["run"] = get_run_context().flow_run.id
        server.sign(url, known["run"])
        return body()

    server.bury(url)
    # a heartbeat would make every flow last a second longer
    with temporary_settings(server.client(url) | {PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):
        runner = ThreadPoolTaskRunner(max_workers=2 * (os.cpu_count() or 1))
        wrapped = prefect.flow(watched, name=name, task_runner=runner, persist_result=False, validate_parameters=False)
        try:
            return wrapped()
        finally:
            if known:
                server.drain(url, known["run"], count())


def _show_plan(steps):
    from prefect.artifacts import create_table_artifact

    rows = [{"stage": one.stage, "action": one.action, "why": "; ".join(one.reasons)} for one in steps]
    if rows:
        create_table_artifact(table=rows, key="plan", description=f"Plan of {steps[0].event}")


def _task(call, listener):
    """Prefect task of one call; its parameters are the references of the inputs. A product that was there is Cached."""
    import prefect
    from prefect.cache_policies import NO_CACHE
    from prefect.states import Completed

    @functools.wraps(call.stage.body)
    def work(*inputs):
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
