"""The record `Calibration` of a calibration, next to its flow, found by the entry point group `gravcal.calibrations`.

A package adds a calibration by an entry point of this group, `name = "module:CALIBRATION"`. Command line, catalogue,
plan, campaign, series, browser and reports read the record; nothing else names a calibration. See
docs/adding_a_calibration.md.
"""

import functools
import importlib
import json
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from gravcal import catalog
from gravcal.errors import CatalogError, refuse
from gravcal.io import archive
from gravcal.store import results, schemas
from tasks import common, discovery
from tasks.stage import lazy, read, resolved

GROUP = "gravcal.calibrations"
EPOCH = datetime(2000, 1, 1, 12)  # of GPS seconds
RESULT = ((1, "correction"), (2, "covariance"))  # of the result of a model: power of its unit, name
WRITTEN = "Write it with gravcal discover."

effect_catalogue = lazy("gravcal.effects")
simulations = lazy("gravcal.simulation")
writers = lazy("gravcal.io.writers")


@dataclass(frozen=True)
class Discovery:
    """How a discovery gets records, observations and results of a calibration; arguments: `Source`, `Parameters`."""

    #: (source, chosen) -> settings of ``observe`` beside the products and those of the stage "discovery"
    settings: Callable
    observations: str  #: module with ``observe(products, **settings) -> Observations``, or None where these hold none
    #: (source, chosen) -> the product that a model changes; None if `products` sees to models
    records: Callable | None = None
    #: (source, chosen, records) -> {name: product} that the observations are built from; None: the records alone
    products: Callable | None = None
    again: int = 0  #: how many times the search is repeated in records without what it has found
    #: (source, chosen, search, variant) -> products by name without what a search found; None: by `records`
    rebuilt: Callable | None = None
    #: (source, chosen, records, *what a model adds, as of `given`) -> product with the result from such records
    result: Callable | None = None
    #: (source, chosen, with limits or not) -> report of a discovery that is made of those of others; None: of its own
    together: Callable | None = None
    #: (chosen) -> causes that it estimates itself: a model takes them out of a run's records only if minutes off
    estimated: Callable = lambda _chosen: ()
    housekeeping: tuple[str, ...] = ()  #: Level-1 products with fuel and temperatures, which causes may follow

    @staticmethod
    def chosen_for(chosen) -> tuple[dict, dict]:
        """Settings of the stage "discovery" in two dicts: of ``observe``, and of the search (`discovery.LIMITS`)."""
        limits = chosen.for_stage("discovery")
        limits["segment_s"] = limits.pop("heldout_s", None) or limits["segment_s"]
        return {name: limits.pop(name) for name in set(limits) - set(discovery.LIMITS)}, limits

    def read(self, source, chosen):
        """ProductRef of `records` less the effects of ``chosen.model`` on that day; None without `records`."""
        records = self.records and self.records(source, chosen)
        model = model_of_event(chosen.model, source) if "model" in chosen.entries else ""
        return self.without(source, chosen, records, model) if records and model else records

    def built(self, source, chosen, records):
        """{name: ProductRef} that the observations are built from, made of ``records`` (ProductRef)."""
        if self.products is None:
            return {records.kind.rpartition(".")[2]: records}
        return self.products(source, chosen, records)

    def baseline(self, source, chosen):
        """{name: ProductRef} that the observations are built from, made of the records as `read` returns them."""
        return self.built(source, chosen, self.read(source, chosen))

    def without(self, source, chosen, records, model, variant="extended", products=None, estimated=()):
        """ProductRef of records less the effects of a model (JSON); ``products``, if known, are `built` of these."""
        products = products or self.built(source, chosen, records)
        return discovery.extend(
            *products.values(),
            names=list(products),
            observations=self.observations,
            records=records.kind,
            settings=self.settings(source, chosen) | self.chosen_for(chosen)[0],
            model=model,
            variant=variant,
            estimated=estimated,
        )

    def taken_out(self, source, chosen, records, solved=None, products=None, *, alone=False):
        """(records less the effects of ``chosen.model``, [``solved(records)`` for `moved_models`, none if alone])."""
        model = model_of_event(chosen.model, source)
        if not model:
            return records, []
        known = {"products": products or self.built(source, chosen, records), "estimated": self.estimated(chosen)}
        moved = enumerate([] if alone else moved_models(model), start=1)
        others = [self.without(source, chosen, records, one, f"moved_{number}", **known) for number, one in moved]
        results = [solved(one) if solved else self.result(source, chosen, one) for one in others]
        return self.without(source, chosen, records, model, **known), results  # latest/ leads to it

    def given(self, name, source, chosen, recorded, solved=None):
        """(records, results, `model_result`): as `taken_out`, results only if that text is "" or with ``solved``."""
        added = model_result(chosen.model, name, resolved(recorded).digest)
        return *self.taken_out(source, chosen, recorded, solved, alone=bool(added and not solved)), added


@dataclass(frozen=True)
class Calibration:
    """Everything that the rest of the program asks about one calibration."""

    name: str  #: of science, stages, flow, settings file and products
    title: str  #: heading of pages
    quantity: str  #: what its result is, with the frame: heading of time lines
    begins: tuple[str, ...]  #: Level-1 products of which a day needs one to be an event
    satellites: tuple[str, ...]  #: letters, or pairs of letters, that an event may be of
    inputs: Mapping[str, tuple[str, ...]]  #: {role: Level-1 products, most wanted first}
    flow: Callable  #: (source, chosen) -> ProductRef of the report
    products: Mapping[str, Mapping]  #: {kind: schema}
    result: Callable[[Mapping], Iterable]  #: document -> values that series, time lines, comparisons and campaigns show
    #: (out, chosen, day, seed, effects, truth) -> truth, a dict with "satellite"; writes the Level-1 files of an
    #: invented event of the day that begins at ``day``, GPS seconds; ``truth`` is the file for it, or None
    simulation: Callable
    #: (source, chosen) -> ProductRef of the manoeuvres found, None if it uses the whole record
    detect: Callable | None = None
    manoeuvres: Callable | None = None  #: Dataset of `detect` -> list of {"kind", "start", "stop"}
    document: Callable = common.document  #: ProductRef of the report -> result document
    files: Any = common.archive  #: module with ``inventory(folder)``, the Level-1 files of a folder
    mission: str = "grace"  #: first word of the names of its events
    pairs: Mapping[str, str] = field(default_factory=dict)  #: {letter of the files of a pair: letters of the pair}
    span_days: int = 1  #: an event without date has all days of its folder if they span less
    source: Callable | None = None  #: (event=, data=, satellite=, date=) -> Source; None: by ``begins``
    level_one_files: Callable | None = None  #: source -> Level-1 files of the event; None: one for each of ``inputs``
    #: {section of the published values: function of a record -> rows of the time line}
    printed: Mapping[str, Callable] = field(default_factory=dict)
    #: (document, section, published record, "as_printed" | "corrected") -> values and sigmas as printed, or None
    recomputed: Callable | None = None
    #: {panel: published scalar, m s-2, drawn as a line: the printed order of magnitude}
    levels: Mapping[str, str] = field(default_factory=dict)
    trims: bool = False  #: True if a time line shows the mass trims of its satellite
    band: float | None = None  #: limit that a time line draws about zero, or None
    design: str | None = None  #: name of the design of an event found in data, None if it has none
    #: module that plans a design, None if there is none: ``library(limits, causes)`` -> manoeuvres to choose from, with
    #: ``room(numbers of the satellite, chosen, day)``; or ``sessions(limits, s)`` -> whole sessions; and
    #: ``measured_noise(settings of the simulation, of the calibration, products of `noise`)`` -> settings that hold it
    planning: Any = None
    information: Callable | None = None  #: products of `Discovery` -> (k, p, p) SI of each manoeuvre, beside `library`
    noise: tuple[str, ...] = ()  #: products of an event from which its noise is known
    foretold: Callable | None = None  #: document -> values whose errors a design makes small
    truth: Callable | None = None  #: truth of a simulation -> true values of these
    schema: Path | None = None  #: JSON Schema of the result document, None if it ships with gravcal under the name
    catalogue: Path | None = None  #: folder with settings, published values and events, None if they ship with gravcal
    discovery: Discovery | None = None

    def __post_init__(self):
        """Set `source` and `level_one_files` to the functions of `tasks.common` where they are None."""
        for name, common_way in {"source": common.source_of, "level_one_files": common.level_one_files}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, functools.partial(common_way, self))

    def days(self, data) -> list[tuple[Path, str, str | None]]:
        """(folder, letters, date YYYY-MM-DD or None if of several days) of each event with files below a folder."""
        return common.days_of(self, data)

    def simulate(self, out, *, seed, truth=None, effects=None, settings=None) -> dict:
        """Write the Level-1 files of an invented event into a folder; its truth, also in the file ``truth`` if given.

        Effects are {"slug.parameter": value}, settings {parameter of the simulation: text or value}.
        """
        archive.check_own(out)
        chosen = catalog.parameters(f"simulate_{self.name}").with_settings(settings or {})
        try:
            day = (datetime.strptime(chosen.date, "%Y-%m-%d") - EPOCH).total_seconds()
        except ValueError:
            refuse(f"date {chosen.date}", "no day of the calendar", "YYYY-MM-DD", "Correct it.", CatalogError)
        Path(out).mkdir(parents=True, exist_ok=True)
        if truth is not None:
            Path(truth).parent.mkdir(parents=True, exist_ok=True)
        invented = self.simulation(Path(out), chosen, day, seed, simulations.by_slug(effects or {}), truth) | {
            "date": chosen.date
        }
        if truth is not None:
            Path(truth).write_text(json.dumps(invented, indent=1) + "\n")
        return invented

    def detected(self, ref) -> dict:
        """{"event", "origin", "manoeuvres": [{"kind", "start", "stop"} in GPS s]} of a ProductRef of `detect`."""
        detected = read(ref)
        return {"event": ref.event, "origin": detected.attrs["origin"], "manoeuvres": list(self.manoeuvres(detected))}


def stated(file: str) -> dict:
    """Fields of a `Calibration` {name: value}: those of the TOML file next to its module ``file``, lists as tuples."""
    content = tomllib.loads(Path(file).with_suffix(".toml").read_text(encoding="utf-8"))
    plain = lambda value: tuple(value) if isinstance(value, list) else value  # noqa: E731
    tables = {n: {k: plain(v) for k, v in one.items()} for n, one in content.items() if isinstance(one, dict)}
    return {"name": Path(file).stem} | {name: plain(one) for name, one in content.items()} | tables


def of_columns(module: str) -> Callable:
    """`Calibration.simulation` that writes the columns of a module as the Level-1 files of the satellites set.

    The module has ``simulate(satellite, chosen, day, seed, effects)`` as `gravcal.simulation` says; its columns are by
    product, or by product and letter.
    """

    def simulation(out, chosen, day, seed, effects, _truth):  # as of `Calibration.simulation`
        letters = chosen.satellites if "satellites" in chosen.entries else chosen.satellite
        flown = letters if letters[1:] else catalog.satellite(letters).settings()
        columns, invented = importlib.import_module(module).simulate(flown, chosen, day, seed, effects)
        for name, values in columns.items():
            product, letter = (name, letters) if isinstance(name, str) else name
            writers.write(values, out / writers.file_name(product, chosen.date, letter))
        return invented | {"satellite": letters}

    return simulation


def known() -> tuple[str, ...]:
    """Names of the installed calibrations, sorted; none of them is imported."""
    return tuple(sorted(_entry_points(*sys.path)))


@functools.cache
def load(name: str) -> Calibration:
    """`Calibration` of an installed calibration by name; its schema and its catalogue folder are registered."""
    record = _entry_points(*sys.path)[name].load()
    if not isinstance(record, Calibration) or record.name != name:
        raise TypeError(f"entry point {name} of {GROUP}: found {record!r:.80}, expected the Calibration {name!r}")
    if record.catalogue:
        catalog.add_root(record.catalogue)
    if record.schema:
        schemas.add(name, record.schema)
    return record


def load_all() -> dict[str, Calibration]:
    """Records of all installed calibrations by name."""
    return {name: load(name) for name in known()}


@functools.cache  # they are read from all that is installed, once for a search path
def _entry_points(*_places):  # {name: EntryPoint}; the places, sys.path, are the key of the cache only
    return {point.name: point for point in metadata.entry_points(group=GROUP)}


def model_text(path: Path) -> str:
    """Model file (TOML) as the JSON list of `_entry` that stages take, names sorted; "" without effects.

    The TOML file holds a list of [[effect]]: cause, form, parameters.<name> = {value, sigma, unit}; and [result] if it
    says what the search adds to the result of the records that it was made in. An effect of the model of a satellite
    may hold `from` a day on and `to` before another.
    """
    content = catalog.read_file(Path(path), "model")[1]
    if "effect" not in content:  # of a satellite whose events share no cause
        return ""
    entries = [_entry(one, path) for one in content["effect"]]
    if "result" in content:
        one = content["result"]
        try:
            shift, added = (results.METRES[one["unit"]] ** n * np.array(one[name], dtype=float) for n, name in RESULT)
        except ValueError:
            shift, added = np.zeros(0), np.zeros(1)
        if added.shape != (shift.size, shift.size):
            fault = "[result] whose correction and covariance do not belong together"
            refuse(path, fault, "p and p x p numbers", WRITTEN, CatalogError)
        about = {name: one[name] for name in ("calibration", "records")}
        entries[0]["result"] = about | {"correction": shift.tolist(), "covariance": added.tolist()}
    return json.dumps(entries, sort_keys=True, allow_nan=False)


def model_result(text: str, calibration: str, records: str | None) -> str:
    """JSON {"correction": (p,), "covariance": (p, p)}, SI, of a model's [result]; "" if of other records.

    The records are known by their digest; None, in a plan, are taken for those of the search.
    """
    added = json.loads(text)[0].get("result", {}) if text else {}
    same = added.get("calibration") == calibration and records in (None, added["records"])
    return json.dumps({name: added[name] for name in ("correction", "covariance")}, sort_keys=True) if same else ""


def _entry(effect, path):
    """Entry of a model for a stage: {"cause", "form", "parameters": {name: {"value", ...}}, ...}, names checked."""
    cause, values = effect["cause"], {}
    listed = not cause.startswith("unknown:")
    units = {p.name: p.unit for p in effect_catalogue.effect(cause).parameters} if listed else {}
    for name, parameter in effect["parameters"].items():
        unit = units.get(name, units.get(name.removesuffix("_1").removesuffix("_2")))
        if listed and unit is None:
            refuse(path, f"{cause}.{name}", f"one of {', '.join(units)}", WRITTEN, CatalogError)
        if listed and parameter.get("unit", unit) != unit:
            refuse(path, f"{cause}.{name} in {parameter['unit']}", f"it in {unit}", "Convert it.", CatalogError)
        values[name] = {n: float(parameter[n]) for n in ("value", "sigma") if n in parameter}
        values[name] |= {"unit": parameter["unit"]} if "unit" in parameter else {}
        if "sigma" in parameter and "correlation" in parameter:
            values[name]["correlation"] = {other: float(r) for other, r in parameter["correlation"].items()}
    lists = {name: effect[name] for name in ("waves", "leads") if name in effect}
    days = {name: str(effect[name]) for name in ("from", "to") if name in effect}
    return {"cause": cause, "form": effect.get("form", ""), "parameters": values} | lists | days


def model_of_event(text: str, source) -> str:
    """Model (JSON) with the entries that hold on the day of a source, from <= day < to; "" where none does."""
    entries = json.loads(text) if text else []
    if not any("from" in one or "to" in one for one in entries):
        return text
    day = getattr(source, "date", None) or source.event[-10:]
    entries = [one for one in entries if one.pop("from", "") <= day < one.pop("to", "~")]
    return json.dumps(entries, sort_keys=True, allow_nan=False) if entries else ""


def moved_models(text: str) -> list[str]:
    """Models (JSON), each with one effect's parameters moved by a column of the square root of their covariance."""
    entries, models = json.loads(text), []
    for number, entry in enumerate(entries):
        known = entry["parameters"]
        sigma = {name: one["sigma"] for name, one in known.items() if one.get("sigma")}
        if not sigma:
            continue
        listed = {name: known[name].get("correlation", {}) for name in sigma}
        correlation = [[1.0 if n == m else listed[n].get(m, listed[m].get(n, 0.0)) for m in sigma] for n in sigma]
        eigenvalues, eigenvectors = np.linalg.eigh(np.array(correlation))
        steps = np.array([*sigma.values()])[:, None] * eigenvectors * np.sqrt(np.clip(eigenvalues, 0.0, None))
        for step in steps.T[steps.any(axis=0)].tolist():  # squares add up to the covariance of the parameters
            move = dict(zip(sigma, step, strict=True))
            values = {n: p | {"value": p["value"] + move.get(n, 0.0)} for n, p in known.items()}
            moved = [*entries[:number], entry | {"parameters": values}, *entries[number + 1 :]]
            models.append(json.dumps(moved, sort_keys=True, allow_nan=False))
    return models
