"""The @stage decorator: a function of datasets becomes a cached, checked, written product.

    ref = solve(field_ref, variant="mtq", lowpass_hz=0.5)   # ProductRef in, ProductRef out: made only if not there
    dataset = solve(field_dataset, lowpass_hz=0.5)          # datasets in, dataset out: the bare body, for tests
    dataset = read(ref)                                     # what a product holds; docs/adding_a_calibration.md

What `stage` takes and a body may return: docs/adding_a_calibration.md. What a call does is up to the engine
(``using``): compute here, say what would be computed, or submit it to Prefect.
"""

import contextlib
import contextvars
import copy
import functools
import importlib
import inspect
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gravcal import catalog
from gravcal.errors import EstimationError, GravcalError, ProductError, refuse
from gravcal.io import archive
from gravcal.store import history, keys, product, store
from gravcal.store.store import ProductRef

_engine = contextvars.ContextVar("gravcal_engine", default=None)
_listeners = contextvars.ContextVar("gravcal_listeners", default=())
_calls = {}  # key -> Call of this process, by which `read` makes a damaged product again


@dataclass(frozen=True)
class Stage:
    """A function of Datasets with kinds and version; called with ProductRefs it returns a ProductRef."""

    body: Callable
    reads: tuple[str, ...]  #: kind of each input
    writes: str  #: kind of the product
    version: int
    also: tuple[str, ...] = ()  #: modules that the body reaches without an import statement

    def __call__(self, *items, **settings):
        """ProductRef of these inputs and settings, by the engine in force; with Datasets, what the body returns."""
        known = getattr(sys.modules.get("xarray"), "Dataset", None)  # not imported: another thread may be about to
        if items and known and all(isinstance(item, known) for item in items):
            return self.body(*items, **settings)
        return (_engine.get() or inline)(call_of(self, items, settings))

    @property
    def name(self):
        """Module and name of the body: "tasks.com_offset:solve"."""
        return f"{self.body.__module__}:{self.body.__name__}"


@dataclass(frozen=True)
class Call:
    """One stage with its inputs and settings, ready to be looked up or made."""

    stage: Stage
    inputs: tuple  #: of ProductRef or LevelOneFile
    settings: Mapping = field(hash=False)
    event: str
    variant: str

    @property
    def unmade(self):
        """ProductRef without key and digest of the product that this call would make."""
        return ProductRef(self.event, self.stage.writes, self.variant)


def stage(*, reads, writes, version, also=()):
    """Decorator that makes a stage of a function: kinds read, kind written, version; also: modules in its key."""

    def decorate(body):  # Stage
        decorated = Stage(body, tuple(reads), writes, version, tuple(also))
        for name in functools.WRAPPER_ASSIGNMENTS:
            object.__setattr__(decorated, name, getattr(body, name, None))
        return decorated

    return decorate


class lazy:
    """Stand-in for a module, imported at its first use, so that plans and cached runs stay quick."""

    def __init__(self, name):  # "gravcal.x"
        self._name = name

    def __getattr__(self, attribute):
        """Attribute of the module."""
        return getattr(importlib.import_module(self._name), attribute)


@contextlib.contextmanager
def using(engine, listener=None):
    """Context whose stages run by an engine, Call -> ProductRef; the listener (call, state, ref) hears of each done."""
    before, heard = _engine.set(engine), _listeners.set((*_listeners.get(), *([listener] if listener else [])))
    try:
        yield
    finally:
        _engine.reset(before)
        _listeners.reset(heard)


def read(ref):
    """Dataset of a ProductRef, verified; made again if it is damaged. In a plan one not made yet raises Unknown."""
    engine = _engine.get()
    if getattr(engine, "resolve", None):
        ref = engine.resolve(ref)
    dataset = store.load(ref)
    if dataset is None and ref.key in _calls:
        remade, _ = perform(_calls[ref.key])
        if remade.digest != ref.digest:
            raise ProductError(f"{ref.name}: made again, its content differs from before. Run again.", key=ref.key)
        dataset = store.load(remade)
    if dataset is None:
        raise ProductError(
            f"{ref.name} ({ref.path}): the file was damaged and is set aside. Run its event again.", key=ref.key
        )
    return dataset


def resolved(ref):
    """ProductRef with key and digest, after the task that is to give it; in a plan as it is, without where not made."""
    engine = _engine.get()
    waits = getattr(engine, "computes", True) and getattr(engine, "resolve", None)
    return waits(ref) if waits else ref


def current():
    """Engine that runs stages here, None for one that computes at once."""
    return _engine.get()


def forget():
    """Forget the calls of this process, so that one that lives long does not grow."""
    _calls.clear()


def inline(call):
    """Engine that looks up or computes the product of a Call at once, in this process; its ProductRef."""
    ref, state = perform(call)
    for listener in _listeners.get():
        listener(call, state, ref)
    return ref


def perform(call):
    """(ProductRef, "cached" or "made"): the product of a Call, looked up or made under a lock of its key."""
    product_recipe, modules = recipe(call)
    key = keys.key(product_recipe)
    _calls[key] = call
    ref, state = usable(key), "cached"
    if ref is None:
        with store.lock(key):
            ref = usable(key)
            if ref is None:
                ref, state = _make(call, key, product_recipe, modules), "made"
    store.point(ref)
    return ref, state


def usable(key):
    """ProductRef with this key, or None; also None if other versions made it and such products are to be remade."""
    ref = store.find(key)
    return None if ref and history.remakes_versions() and history.other_versions(ref) else ref


def recipe(call):
    """(recipe: dict of all that the product of a Call depends on; {part of the code: digest}).

    The digest of an input that is not known yet is None.
    """
    modules = keys.fingerprint(call.stage.body, call.stage.also)
    wanted = {
        "event": call.event,
        "kind": call.stage.writes,
        "variant": call.variant,
        "version": call.stage.version,
        "settings": dict(call.settings),
        "inputs": [keys.labelled(item) for item in call.inputs],
        "code": keys.total(modules),
    }
    if any(keys.is_file(item) for item in call.inputs):
        wanted["origin"] = catalog.event_origin(call.event)  # "" where it says nothing or knows no such event
    return wanted, modules


def call_of(called, items, settings):
    """Call of a Stage with checked inputs and settings in canonical form, and its event and variant."""
    keys.check_inputs(called.name, items, called.reads)
    known = inspect.signature(called.body).parameters
    keywords = dict(settings)
    event = keywords["event"] if "event" in keywords else keys.event_of(called.name, items)
    files = [f"{item.product}_{item.satellite}" for item in items if keys.is_file(item)]
    variant = keywords["variant"] if "variant" in keywords else files[0] if files and len(items) == 1 else ""
    for name in ("event", "variant"):
        if name in keywords and name not in known:
            del keywords[name]
    wanted = {name for name, parameter in known.items() if parameter.kind is inspect.Parameter.KEYWORD_ONLY}
    takes_all = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in known.values())
    missing, unknown = wanted - set(keywords), set() if takes_all else set(keywords) - wanted
    if missing or unknown:
        raise TypeError(f"{called.name}: settings missing {sorted(missing)}, unknown {sorted(unknown)}")
    if "{" in called.writes:
        also = tuple(name.format_map(keywords) for name in called.also)
        called = Stage(called.body, called.reads, called.writes.format_map(keywords), called.version, also)
    where = f"{called.writes}, setting"
    canonical = {name: keys.canonical(value, f"{where} {name}") for name, value in keywords.items()}
    canonical = {
        name: keys.typed(value, known[name].annotation if name in known else None, f"{where} {name}")
        for name, value in sorted(canonical.items())
    }
    return Call(called, tuple(items), canonical, event, variant or "")


def _make(call, key, wanted, modules):  # ProductRef of the body's result; wanted, modules: as of `recipe`
    contents = [item if keys.is_file(item) else read(item) for item in call.inputs]
    settings = copy.deepcopy(dict(call.settings))
    started = time.perf_counter()
    try:
        returned = call.stage.body(*contents, **settings)
    except Exception as raised:
        error = _of_input(raised, call)
        if isinstance(error, GravcalError):
            error.facts.setdefault("event", call.event)
            error.facts.setdefault("stage", call.unmade.stage)
        if not isinstance(error, (OSError, MemoryError)):  # these may go otherwise the next time
            error.failed_key = key
        if error is raised:
            raise
        raise error from raised
    for item, label in zip(call.inputs, wanted["inputs"], strict=True):
        if keys.is_file(item) and keys.digest_of(item) != label["digest"]:
            refuse(item.path, "that it changed while it was read", "a file that stays as it is", "Run again.")
    dataset, files = returned if isinstance(returned, tuple) else (returned, {})
    facts = {
        "stage": call.stage.name,
        "seconds": round(time.perf_counter() - started, 3),
        "modules": modules,
        "from": [keys.traced(item) for item in call.inputs],
        "versions": keys.versions(),
    }
    origin = _origin(call, contents, wanted.get("origin"), dataset.attrs.get("origin", ""))
    inherited = {"origin": origin, "cut": "; ".join(product.listed("cut", (*contents, dataset)))}  # of all inputs
    dataset = product.check(dataset, call.stage.writes).assign_attrs({n: one for n, one in inherited.items() if one})
    if store.find(key) and not usable(key):
        store.set_aside(store.folder_of(key), "made again, for other versions had made it")
    return store.put(key, wanted, (dataset, files), facts)


def _origin(call, contents, stated, own):
    """Origin of a product: common to its inputs; of a file as the event (stated), the body (own) or its header says.

    An origin set by the body may turn measured into simulated, never the reverse.
    """
    inputs_of = zip(call.inputs, contents, strict=True)
    origins = [
        (stated or own or archive.origin_of(item)) if keys.is_file(item) else content.attrs.get("origin", "")
        for item, content in inputs_of
    ]
    return max(product.origins_together(origins), own, key=("", *product.ORIGINS).index)


def _of_input(error, call):
    """Error itself, or for singular equations and not finite input an EstimationError that names event and stage."""
    of_scipy = isinstance(error, ValueError) and "infs or NaNs" in str(error)  # asarray_chkfinite
    if not isinstance(error, np.linalg.LinAlgError) and not of_scipy:
        return error
    return EstimationError(
        f"{call.event}: {call.unmade.stage} found equations that cannot be solved ({error}), expected finite records "
        f"of plausible size. Check the input files, or fetch them again."
    )
