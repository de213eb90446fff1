"""What a calibration is: one record beside its flow, found by the entry point group `gravcal.calibrations`.

A package adds a calibration by an entry point of this group, `name = "module:CALIBRATION"`. Command line, catalogue,
plan, campaign, series, browser and reports read the record; nothing else names a calibration. See
docs/adding_a_calibration.md.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

GROUP = "gravcal.calibrations"


@dataclass(frozen=True)
class Discovery:
    """How discovery gets at a calibration.

    Attributes
    ----------
    baseline : (source, chosen) -> references of the products that its observations are built from
    settings : (source, chosen) -> settings of ``observe`` beside the products
    observe : (products, **settings) -> Observations, or None where these products hold none
    again : (source, chosen, records) -> the products of ``baseline`` from records without the effects of a model
    result : (source, chosen, records) -> product with the result of the calibration from such records
    """

    baseline: Callable
    settings: Callable
    observe: Callable | None = None
    again: Callable | None = None
    result: Callable | None = None


@dataclass(frozen=True)
class Calibration:
    """Everything that the rest of the program asks about one calibration.

    Attributes
    ----------
    name : of science, stages, flow, settings file and products
    title : heading of pages
    quantity : what its result is, with the frame: heading of time lines
    begins : Level-1 products of which a day needs one to be an event
    satellites : letters, or pairs of letters, that an event may be of
    inputs : {role: Level-1 products, most wanted first}
    flow : (source, chosen) -> ProductRef of the report
    detect : (source, chosen) -> ProductRef of the manoeuvres found, None if it uses the whole record
    detected : ProductRef of `detect` -> document with the manoeuvres
    source : (event=, data=, satellite=, date=) -> Source of an event of the catalogue or of a folder
    days : folder -> [(folder, satellite, date)] of the events below it
    level_one_files : source -> Level-1 files of the event
    document : ProductRef of the report -> result document
    simulate : (out, seed=, truth=, effects=, settings=) -> truth; writes the Level-1 files of an invented event
    products : {kind: schema}
    result : document -> values that series, time lines, comparisons and campaigns show
    page : module that declares the page of the report
    printed : {section of the published values: function of a record -> rows of the time line}
    levels : {panel: published scalar, m s-2, drawn as a line: the printed order of magnitude}
    trims : True if a time line shows the mass trims of its satellite
    band : limit that a time line draws about zero, or None
    design : name of the design of an event found in data, None if it has none
    schema : JSON Schema of the result document, by default the one of the package with this name
    catalogue : folder with settings, published values and events of its own, None if they ship with gravcal
    discovery : Discovery, or None
    """

    name: str
    title: str
    quantity: str
    begins: tuple[str, ...]
    satellites: tuple[str, ...]
    inputs: Mapping[str, tuple[str, ...]]
    flow: Callable
    source: Callable
    days: Callable
    level_one_files: Callable
    document: Callable
    simulate: Callable
    products: Mapping[str, Mapping]
    result: Callable[[Mapping], Iterable]
    detect: Callable | None = None
    detected: Callable | None = None
    page: Any = None
    printed: Mapping[str, Callable] = field(default_factory=dict)
    levels: Mapping[str, str] = field(default_factory=dict)
    trims: bool = False
    band: float | None = None
    design: str | None = None
    schema: Path | None = None
    catalogue: Path | None = None
    discovery: Discovery | None = None


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
        from gravcal.catalog import files

        files.add_root(found.catalogue)
    if found.schema:
        from gravcal.store import schemas

        schemas.add(name, found.schema)
    return found


def load_all() -> dict[str, Calibration]:
    """Records of all installed calibrations by name."""
    return {name: load(name) for name in known()}


def _entry_points():
    return {point.name: point for point in metadata.entry_points(group=GROUP)}
