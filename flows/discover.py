"""Discovery: causes of what the model of an event leaves unexplained, extended model, gain.

Also jointly over many events of a satellite, with the changes by a new event.
"""

import contextlib
import functools
import itertools
from dataclasses import dataclass, replace
from pathlib import Path

from flows import calibration as calibrations
from flows import command
from flows.calibration import Calibration, Discovery
from flows.engine import flow
from gravcal import catalog
from gravcal.errors import NoDataError, ProductError, refuse
from gravcal.store import location, results, store
from tasks import common, discovery
from tasks.stage import inline, lazy, resolved, using

campaigns = lazy("flows.campaign")
report = lazy("gravcal.report.joint")
timeline = lazy("gravcal.browse.timeline")


@dataclass(frozen=True)
class Study:
    """Printed numbers that can be searched, in the place of both the calibration and the source of a discovery."""

    name: str
    event: str
    satellite: str
    discovery: Discovery


@functools.cache
def flow_of(name: str, shown: bool = False):
    """Flow (source, chosen) -> ProductRef of the discovery of a calibration or study; shown: with detection limits."""
    one = STUDIES.get(name) or calibrations.load(name)
    if one.discovery is None:
        raise KeyError(name)

    @flow(name=f"{name}_discovery")
    def discover(source, chosen):
        """ProductRef of the report on the causes of what a calibration leaves unexplained in one event."""
        spec, event, results, digest = one.discovery, {"event": source.event}, (), ""
        if spec.together is not None:
            return spec.together(source, chosen, shown)
        search, records, products = searched(one, source, chosen, shown)
        if spec.result is not None:
            fixed = {"observations": spec.observations, "names": list(products)}
            fixed |= {"records": records.kind, "settings": spec.settings(source, chosen)} | event
            without = discovery.extend_by(search, *products.values(), variant="discovered", tentative=False, **fixed)
            after = spec.result(source, chosen, without)
            recorded = spec.records(source, chosen)
            _, *added = spec.given(one.name, source, chosen, recorded)
            results = [spec.result(source, chosen, records), after]  # last: latest/ leads to it, or to that of a run
            results += [spec.result(source, chosen, records, *added)] if any(added) else []
            digest = resolved(recorded).digest
        elif spec.again:
            spec.baseline(source, chosen)  # last: latest/ leads to it
        values = {name: value for name, value in chosen.for_report().items() if name != "truth"}
        named = {"calibration": one.name, "observations": spec.observations, "satellite": source.satellite} | event
        return discovery.report(search, *results, **named, settings=values, records=digest)

    return discover


def as_calibration(name: str, shown: bool = False) -> Calibration:
    """Calibration, for a campaign, whose flow is its discovery and whose result holds the corrections that it found."""
    return replace(calibrations.load(name), flow=flow_of(name, shown), document=document, result=results.searched)


def searched(one: Calibration | Study, source, chosen, shown: bool = False):
    """ProductRefs of the search in one event and of its records, which a model changes; {name: ProductRef} of these."""
    spec, event = one.discovery, {"event": source.event}
    records = spec.read(source, chosen)
    products = spec.built(source, chosen, records)
    settings = spec.settings(source, chosen)
    own, limits = spec.chosen_for(chosen)
    fixed = {"observations": spec.observations, "names": list(products)}
    searched = fixed | {"calibration": one.name, "settings": settings | own} | limits | event
    extended = fixed | {"records": records.kind if records else "", "settings": settings} | event
    inputs = [*products.values()]
    *passes, last = (*("first", "second")[: spec.again], "")
    search = discovery.search(*products.values(), variant=(*passes, last)[0], **searched)
    for variant, following in itertools.pairwise((*passes, last)):
        if spec.rebuilt:
            again = spec.rebuilt(source, chosen, search, variant)
        else:
            without = discovery.extend_by(search, *products.values(), variant=variant, tentative=True, **extended)
            again = spec.built(source, chosen, without)
        search = discovery.search_again(search, *again.values(), variant=following, **searched)
        inputs += again.values()
    search = discovery.limits(search, *inputs, variant="limits", **searched) if shown else search
    return search, records, products


def evidence_of(calibration: str) -> Calibration:
    """Calibration, for a campaign, whose flow makes the product "evidence" of an event: its input to a joint search."""
    one = calibrations.load(calibration)
    spec = one.discovery

    @flow(name=f"{one.name}_evidence")
    def evidence(source, chosen):  # ProductRef
        products, housekeeping = spec.baseline(source, chosen), []
        settings = spec.settings(source, chosen) | spec.chosen_for(chosen)[0]
        about = {"calibration": one.name, "observations": spec.observations, "names": list(products)}
        for file in source.files(*spec.housekeeping) if spec.housekeeping else ():
            with contextlib.suppress(ProductError):  # what cannot be read is not followed, which the search says
                housekeeping.append(common.ingest(file, event=source.event))
        return discovery.evidence(*products.values(), *housekeeping, **about, settings=settings, event=source.event)

    return replace(one, flow=evidence, document=lambda _: {"status": "delivered"}, result=lambda _: ())


def joint(name, satellite, data, chosen, events=(), *, engine="inline", workers=None):
    """[(document, files, lines on changes beyond their error since the last one)] of a joint search, one a satellite.

    All satellites and events if none is named; data are folders with Level-1 files of one day or many, None for
    GRAVCAL_DATA; engine and workers are those of a campaign.
    """
    sources = [one for folder in data or [None] for one in command.many_sources(name, satellite, folder)]
    unknown = sorted(set(events) - {source.event for source in sources})
    if unknown:
        there = ", ".join(source.event for source in sources)
        refuse(f"--events {','.join(unknown)}", "no such event", f"some of {there}", "Correct the names.", NoDataError)
    sources = [source for source in sources if not events or source.event in events]
    summary = campaigns.run(campaigns.Campaign(name, chosen, engine, workers=workers, search="joint"), sources)
    rows_of, left_out = {}, {row["event"]: row["error"] for row in summary["events"] if "report" not in row}
    for source, row in zip(sources, summary["events"], strict=True):
        if "report" in row:
            rows_of.setdefault(source.satellite, []).append(row)
    left_out |= {rows[0]["event"]: "the only one of its satellite" for rows in rows_of.values() if len(rows) < 2}
    searches = [_of_one(name, one, rows, chosen, left_out) for one, rows in sorted(rows_of.items()) if len(rows) > 1]
    if not searches:
        reasons = "; ".join(f"{event} ({reason})" for event, reason in left_out.items())
        refuse(f"{name} --joint", f"no two events of a satellite, not {reasons}", "two", "Give more data.")
    return searches


def _of_one(name, satellite, rows, chosen, left_out):
    """(document, [Path], [line on a change]) of the joint search over the rows (events) of one satellite or pair."""
    record, letter = calibrations.load(name), satellite[0]
    settings = {"configuration": chosen.configuration, "left_out": left_out}
    about = {"event": owner(record, satellite), "satellite": satellite, "calibration": name}
    with location.configured(chosen.configuration), using(inline):
        previous = store.newest_record(about["event"], f"{name}.joint")
        before = (previous and location.read_json(store.folder_of(previous["key"]) / "joint.json")) or {}
        ref = discovery.joint(
            *(store.find(Path(row["report"]).name) for row in rows),
            events=[row["event"] for row in rows],
            history=history(record, letter),
            settings=settings,
            **record.discovery.chosen_for(chosen)[1],
            **about,
        )
    files = [path for path in sorted(ref.folder.iterdir()) if path.suffix in (".html", ".toml")]
    after = location.read_json(ref.folder / "joint.json")
    return after, files, report.changes(before, after)


def owner(one, satellite):
    """Name of a satellite ("grace-c") or pair ("grace-cd") from its letters: the event of a joint search."""
    return catalog.satellite(satellite).name if len(satellite) == 1 else f"{one.mission}-{satellite.lower()}"


def history(one, letter):
    """{"trims", "printed"}: lists of dicts of a satellite's mass trims (um) and printed values (time in GPS s)."""
    trims = [
        {"date": str(t.date), "axis": t.axis, "size": t.trim_um, "confirmed": t.confirmed}
        for t in (timeline.trims(letter) if one.trims else ())
    ]
    printed = [
        {"time": (p.date - timeline.EPOCH).total_seconds(), "parameter": p.panel, "value": p.value, "sigma": p.sigma}
        for p in timeline.printed_points(one, letter)
    ]
    return {"trims": trims, "printed": printed}


def names() -> tuple[str, ...]:
    """Names of the calibrations that have a discovery."""
    return tuple(name for name in calibrations.known() if calibrations.load(name).discovery is not None)


def document(ref):
    """Result document of a discovery (ProductRef of its report), with the keys of everything it was made from."""
    return common.document(ref, "discovery.json")


def _printed(study, chosen):
    """Keyword settings of ``observe``: printed rows of the variant chosen, inertia, full-scale torquer dipole."""
    records = [one for one in catalog.published("com_offset")["manoeuvres"] if one.labels["variant"] == chosen.variant]
    rows = [
        {"order": int(one.labels["order"]), "value": one.value, "sigma": one.sigma}
        | {name: one.labels[name] for name in ("kind", "latitude_class")}
        for one in records
    ]
    satellite = catalog.satellite(study.satellite).settings()
    known = {"rows": rows, "inertia": satellite["inertia"], "dipole": satellite["dipole_full_scale"]}
    return known | chosen.for_stage("observe")


TABLE = Discovery(_printed, "gravcal.calibrations.published_table.observations", products=lambda *_: {})
#: Printed numbers by name; they have no files, so each is the source of its event.
STUDIES = {"published_table": Study("published_table", "grace-c-2020-02-01", "C", TABLE)}
#: Other names of calibrations, as they were searched before.
ALIASES = {"attitude": "thrusters"}
