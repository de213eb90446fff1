"""What a calibration is: one record beside its flow, found by the entry point group `gravcal.calibrations`.

A package adds a calibration by an entry point of this group, `name = "module:CALIBRATION"`. Command line, catalogue,
plan, campaign, series, browser and reports read the record; nothing else names a calibration. See
docs/adding_a_calibration.md.
"""

import functools
import importlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from flows.engine import models
from gravcal import catalog
from gravcal.store import origin, schemas
from tasks import common, discovery
from tasks.stage import read

GROUP = "gravcal.calibrations"
EPOCH = datetime(2000, 1, 1, 12)  # of GPS seconds


@dataclass(frozen=True)
class Discovery:
    """How discovery gets at a calibration."""

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
    #: (source, chosen, records) -> product with the result of the calibration from such records
    result: Callable | None = None
    #: (source, chosen, with limits or not) -> report of a discovery that is made of those of others; None: of its own
    together: Callable | None = None
    masses: tuple[str, ...] = ()  #: Level-1 products with the fuel, which causes and parameters may follow

    @staticmethod
    def chosen_for(chosen) -> tuple[dict, dict]:
        """Settings of the stage "discovery": those of ``observe``, and those of the search itself."""
        limits = chosen.for_stage("discovery")
        limits["segment_s"] = limits.pop("heldout_s", None) or limits["segment_s"]
        return {name: limits.pop(name) for name in set(limits) - set(discovery.LIMITS)}, limits

    def read(self, source, chosen):
        """Product that a model changes, without the effects of the model that is given."""
        found = self.records and self.records(source, chosen)
        model = models.of_event(chosen.model, source) if "model" in chosen.entries else ""
        return self.without(source, chosen, found, model) if found and model else found

    def built(self, source, chosen, records):
        """Products of records that the observations are built from, by name."""
        if self.products is None:
            return {records.kind.rpartition(".")[2]: records}
        return self.products(source, chosen, records)

    def baseline(self, source, chosen):
        """Products that the observations are built from, by name."""
        return self.built(source, chosen, self.read(source, chosen))

    def without(self, source, chosen, records, model, variant="extended", products=None):
        """Records without the effects of a model; ``products`` are theirs by name, where they are known."""
        products = products or self.built(source, chosen, records)
        return discovery.extend(
            *products.values(),
            names=list(products),
            observations=self.observations,
            records=records.kind,
            settings=self.settings(source, chosen),
            model=model,
            variant=variant,
        )

    def taken_out(self, source, chosen, records, solved=None, products=None, *, alone=False):
        """Records without the effects of the given model; not alone: results (of ``solved``) for each of its errors."""
        model = models.of_event(chosen.model, source)
        if not model:
            return records, []
        products = products or self.built(source, chosen, records)
        moved = enumerate([] if alone else models.moved(model), start=1)
        others = [self.without(source, chosen, records, one, f"moved_{number}", products) for number, one in moved]
        results = [solved(one) if solved else self.result(source, chosen, one) for one in others]
        return self.without(source, chosen, records, model, products=products), results  # latest/ leads to it


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
    library: Callable | None = None  #: limits of a design -> manoeuvres to choose from, as tables of one
    information: Callable | None = None  #: products of `Discovery` -> (k, p, p) SI of each manoeuvre, beside `library`
    #: in place of `library` where manoeuvres are not chosen one by one: limits, s -> whole sessions, as lists of tables
    sessions: Callable | None = None
    limits: Mapping[str, tuple] = field(default_factory=dict)  #: {limit of a design: usual value, what it is}
    foretold: Callable | None = None  #: document -> values whose errors a design makes small
    truth: Callable | None = None  #: truth of a simulation -> true values of these
    schema: Path | None = None  #: JSON Schema of the result document, None if it ships with gravcal under the name
    catalogue: Path | None = None  #: folder with settings, published values and events, None if they ship with gravcal
    discovery: Discovery | None = None

    def __post_init__(self):
        """Where nothing else is said, sources and files are found in the common way."""
        ways = {"source": common.source_of, "level_one_files": _level_one_files}
        for name, common_way in ways.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, functools.partial(common_way, self))

    def days(self, data) -> list[tuple[Path, str, str | None]]:
        """Folders, satellites and dates of the events below a folder."""
        return common.days_of(self, data)

    def simulate(self, out, *, seed, truth=None, effects=None, settings=None) -> dict:
        """Write the Level-1 files of an invented event into a folder; its truth, also in the file ``truth`` if given.

        Effects are {"slug.parameter": value}, settings {parameter of the simulation: text or value}.
        """
        from gravcal.simulation import by_slug

        origin.check_own(out)
        chosen = catalog.parameters(f"simulate_{self.name}").with_settings(settings or {})
        day = (datetime.fromisoformat(chosen.date) - EPOCH).total_seconds()
        Path(out).mkdir(parents=True, exist_ok=True)
        if truth is not None:
            Path(truth).parent.mkdir(parents=True, exist_ok=True)
        invented = self.simulation(Path(out), chosen, day, seed, by_slug(effects or {}), truth) | {"date": chosen.date}
        if truth is not None:
            Path(truth).write_text(json.dumps(invented, indent=1) + "\n")
        return invented

    def detected(self, ref) -> dict:
        """Document with the manoeuvres of a product of `detect`."""
        found = read(ref)
        return {"event": ref.event, "origin": found.attrs["origin"], "manoeuvres": list(self.manoeuvres(found))}


def of_one_satellite(module: str) -> Callable:
    """Simulation that writes the Level-1 files of one satellite, for a record.

    The module has ``simulate(numbers of the satellite, chosen, day, seed, effects)`` -> columns by product, truth.
    """

    def simulation(out, chosen, day, seed, effects, _truth):
        from gravcal.io import writers

        numbers = catalog.satellite(chosen.satellite).settings()
        columns, invented = importlib.import_module(module).simulate(numbers, chosen, day, seed, effects)
        for product, values in columns.items():
            writers.write(values, out / writers.file_name(product, chosen.date, chosen.satellite))
        return invented | {"satellite": chosen.satellite}

    return simulation


def _level_one_files(calibration, source):
    """Level-1 files of a source, one for each role."""
    return [file for names in calibration.inputs.values() for file in source.files(*names) or [source.file(*names)]]


def known() -> tuple[str, ...]:
    """Names of the installed calibrations, sorted; none of them is imported."""
    return tuple(sorted(_entry_points()))


@functools.cache
def load(name: str) -> Calibration:
    """Record of a calibration.

    Raises
    ------
    KeyError : no calibration of this name is installed
    TypeError : the entry point of this name is no Calibration, or one of another name
    """
    found = _entry_points()[name].load()
    if not isinstance(found, Calibration) or found.name != name:
        raise TypeError(f"entry point {name} of {GROUP}: found {found!r:.80}, expected the Calibration {name!r}")
    if found.catalogue:
        catalog.add_root(found.catalogue)
    if found.schema:
        schemas.add(name, found.schema)
    return found


def load_all() -> dict[str, Calibration]:
    """Records of all installed calibrations by name."""
    return {name: load(name) for name in known()}


def _entry_points():
    return {point.name: point for point in metadata.entry_points(group=GROUP)}
