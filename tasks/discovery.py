"""Stages of discovery, the same for every calibration.

Keywords: the calibration or kind of product written, the module ``observations`` whose ``observe`` makes Observations,
``names`` of the products there, ``settings`` of ``observe``.
"""

import importlib
import json
import sys

from gravcal.discovery import DISCOVERY
from gravcal.estimation.outcome import outcome_of
from gravcal.estimation.records import Reported, entries
from gravcal.store import product
from tasks.stage import lazy, stage

driver = lazy("gravcal.discovery.driver")
evidence_science = lazy("gravcal.discovery.evidence")
joint_science = lazy("gravcal.discovery.joint")
report_science = lazy("gravcal.report.discovery")
joint_report = lazy("gravcal.report.joint")

product.register("*.discovery", DISCOVERY)
product.register("*.discovery_report", product.ANY)
product.register("*.evidence", product.ANY)
product.register("*.joint", product.ANY)
ANY_PRODUCT, RESULTS = ["*"], ["*.discovery", "*.combine|*.drag"]
#: Settings of a search, in the order of `Limits`.
LIMITS = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed")


@stage(reads=ANY_PRODUCT, writes="{calibration}.discovery", version=37, also=["{observations}"])
def search(*products, calibration, observations, names, settings, **limits):  # noqa: ARG001 - it names the product
    """Causes of what the model of an event leaves unexplained."""
    return driver.discover(observations_of(products, observations, names, settings), _limits(limits))


@stage(reads=ANY_PRODUCT, writes="{calibration}.discovery", version=37, also=["{observations}"])
def search_again(first, *products, calibration, observations, names, settings, **limits):  # noqa: ARG001 - names it
    """Search repeated in records less the findings of a ``first`` one, where their effects are large."""
    observed = observations_of(products, observations, names, settings)
    return driver.discover_again(observed, _limits(limits), first, _model(first))


def _limits(settings):  # driver.Limits of the settings `LIMITS`
    return driver.Limits(*(settings[name] for name in LIMITS))


@stage(reads=ANY_PRODUCT, writes="{calibration}.discovery", version=4, also=["{observations}"])
def limits(searched, *products, calibration, observations, names, settings, **limits):  # noqa: ARG001 - names it
    """Search with detection limits: the size from which each effect of the catalogue would have been named.

    After the products of the first search come those of each that followed.
    """
    latest = products[int(searched.attrs.get("rebuilt", 0)) * len(names) :][: len(names)]
    say = lambda text: sys.stderr.write(f"{text}\n")  # noqa: E731
    return driver.with_limits(searched, observations_of(latest, observations, names, settings), _limits(limits), say)


@stage(reads=ANY_PRODUCT, writes="{records}", version=6, also=["{observations}"])
def extend(*products, records, observations, names, model, settings, estimated):
    """Records, product of the kind ``records``, less the effects of an extended model (JSON) that are not estimated."""
    observed, effects = observations_of(products, observations, names, settings), entries(json.loads(model))
    driver.check_causes(observed, effects)
    effects = [one for one in effects if one.cause not in estimated or (observed and one.cause in observed.delays)]
    return _without(observed, products, records, names, effects)


@stage(reads=ANY_PRODUCT, writes="{records}", version=6, also=["{observations}"])
def extend_by(searched, *products, records, observations, names, settings, tentative):
    """Records less the findings of a search; findings not adopted only if ``tentative``."""
    model = _model(searched, tentative)
    return _without(observations_of(products, observations, names, settings), products, records, names, model)


@stage(reads=RESULTS, writes="{calibration}.discovery_report", version=13, also=["{observations}"])
def report(searched, *combined, calibration, observations, event, satellite, settings, records):
    """Document, page and extended model of a search; combined: results before, after, before with the initial model."""
    named = {"calibration": calibration, "event": event, "satellite": satellite, "records": records}
    reported = getattr(importlib.import_module(observations), "REPORT", Reported())
    return report_science.report(searched, *combined, settings=settings, reported=reported, **named)


@stage(reads=ANY_PRODUCT, writes="{calibration}.evidence", version=8, also=["{observations}"])
def evidence(*products, calibration, observations, names, settings):  # noqa: ARG001 - it names the product
    """Gram matrix of an event (whitened residual, parameters, listed causes) for a joint search; housekeeping last."""
    observed = observations_of(products[: len(names)], observations, names, settings)
    return evidence_science.evidence(observed, *products[len(names) :])


@stage(reads=["*.evidence"], writes="{calibration}.joint", version=5)
def joint(*products, calibration, event, satellite, events, history, settings, **limits):
    """Joint search: causes that events share, the calibration's values in each and their motion; page and model."""
    pooled = joint_science.Search(evidence_science.events_of(products, events), *(limits[name] for name in LIMITS[:3]))
    named = {"calibration": calibration, "event": event, "satellite": satellite}
    by_event = dict(zip(events, products, strict=True))
    return joint_report.report(pooled, by_event, history=history, settings=settings, **named)


def observations_of(products, observations, names, settings):
    """Observations of Datasets (products, in the order of their names); None where they hold none."""
    return importlib.import_module(observations).observe(dict(zip(names, products, strict=True)), **settings)


def _model(searched, tentative=True):  # [Entry] of the findings of a search, or of those adopted
    outcome = outcome_of(searched)
    findings = outcome.findings if outcome else []
    if tentative and "believed" in searched.attrs:  # of several that describe the record worse, taken out together
        findings = findings[:1]
    return [entry for one in findings if tentative or one.adopted for entry in one.entries]


def _without(observed, products, records, names, model):
    """Dataset of the kind ``records`` less the effects of a model ([Entry]); a copy if there are no Observations."""
    if observed is None:
        return dict(zip(names, products, strict=True))[records.rpartition(".")[2]].copy()
    return observed.without(model)
