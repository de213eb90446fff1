"""Discovery: what the simulation of an event gets wrong, the cause, the extended model, the gain."""

import contextlib
import functools
import itertools
from dataclasses import dataclass, replace

from flows import calibration as calibrations
from flows.calibration import Calibration, Discovery
from flows.engine import flow
from gravcal import catalog
from gravcal.errors import ProductError
from gravcal.store import results
from tasks import common, discovery


@dataclass(frozen=True)
class Study:
    """Printed numbers that can be searched: what a discovery asks of a calibration, and of the source of an event."""

    name: str
    event: str
    satellite: str
    discovery: Discovery


@functools.cache
def flow_of(name: str, shown: bool = False):
    """Flow of the discovery of a calibration, or of a study; `shown` if with the detection limits of the event."""
    one = STUDIES.get(name) or calibrations.load(name)
    if one.discovery is None:
        raise KeyError(name)
    return flow(name=f"{name}_discovery")(functools.partial(_discover, one, shown))


def as_calibration(name: str, shown: bool = False) -> Calibration:
    """Calibration whose flow is its discovery, as a campaign runs it; its result is that with what was found."""
    return replace(calibrations.load(name), flow=flow_of(name, shown), document=document, result=results.searched)


def searched(one: Calibration | Study, source, chosen, shown: bool = False, read=None):
    """Product of the search in one event; ``read`` are its records and what is built from them, if they are known."""
    looked, event = one.discovery, {"event": source.event}
    records, products = read or _read(looked, source, chosen)
    settings = looked.settings(source, chosen)
    own, limits = looked.chosen_for(chosen)
    fixed = {"observations": looked.observations, "names": list(products)}
    searched = fixed | {"calibration": one.name, "settings": settings | own} | limits | event
    extended = fixed | {"records": records.kind if records else "", "settings": settings} | event
    seen = [*products.values()]
    *passes, last = (*("first", "second")[: looked.again], "")
    found = discovery.search(*products.values(), variant=(*passes, last)[0], **searched)
    for variant, following in itertools.pairwise((*passes, last)):
        if looked.rebuilt:
            again = looked.rebuilt(source, chosen, found, variant)
        else:
            without = discovery.extend_by(found, *products.values(), variant=variant, tentative=True, **extended)
            again = looked.built(source, chosen, without)
        found = discovery.search_again(found, *again.values(), variant=following, **searched)
    seen += again.values() if looked.again else ()
    return discovery.limits(found, *seen, variant="limits", **searched) if shown else found


def _read(looked, source, chosen):
    """Records that a model changes, and the products that the observations are built from, by name."""
    records = looked.read(source, chosen)
    return records, looked.built(source, chosen, records)


def _discover(one: Calibration | Study, shown: bool, source, chosen):
    """Causes of what a calibration leaves unexplained in one event."""
    looked, event, results = one.discovery, {"event": source.event}, ()
    if looked.together is not None:
        return looked.together(source, chosen, shown)
    records, products = _read(looked, source, chosen)
    found = searched(one, source, chosen, shown, (records, products))
    if looked.result is not None:
        fixed = {"observations": looked.observations, "names": list(products)}
        fixed |= {"records": records.kind, "settings": looked.settings(source, chosen)} | event
        without = discovery.extend_by(found, *products.values(), variant="discovered", tentative=False, **fixed)
        after = looked.result(source, chosen, without)
        before = looked.result(source, chosen, records)  # last: latest/ leads to it
        results = before, after
    elif looked.again:
        looked.baseline(source, chosen)  # last: latest/ leads to it
    values = {name: value for name, value in chosen.for_report().items() if name != "truth"}
    named = {"calibration": one.name, "observations": looked.observations, "satellite": source.satellite} | event
    return discovery.report(found, *results, **named, settings=values)


def evidence_of(calibration: str) -> Calibration:
    """Calibration whose flow gives what an event tells a search over many events, as a campaign runs it."""
    one = calibrations.load(calibration)
    told = functools.partial(_evidence, one)
    status = {"status": "delivered"}
    return replace(one, flow=flow(name=f"{one.name}_evidence")(told), document=lambda _: status, result=lambda _: ())


def _evidence(one: Calibration, source, chosen):
    looked = one.discovery
    products = looked.baseline(source, chosen)
    settings = looked.settings(source, chosen) | looked.chosen_for(chosen)[0]
    about = {"calibration": one.name, "observations": looked.observations, "names": list(products)}
    told = []
    for file in source.files(*looked.housekeeping) if looked.housekeeping else ():
        with contextlib.suppress(ProductError):  # what cannot be read is not followed, which the search says
            told.append(common.ingest(file, event=source.event))
    return discovery.evidence(*products.values(), *told, **about, settings=settings, event=source.event)


def names() -> tuple[str, ...]:
    """Calibrations that can be searched."""
    return tuple(name for name in calibrations.known() if calibrations.load(name).discovery is not None)


def document(ref):
    """Result document of a discovery, with the keys of everything it was made from."""
    return common.document(ref, "discovery.json")


def _printed(study, chosen):
    """Rows of the chosen variant, and what the torquers did to the satellite."""
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
