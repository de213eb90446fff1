"""Discovery over many events of a satellite, and what a new event changes."""

from pathlib import Path

from flows import calibration as calibrations
from flows import campaign, command
from gravcal import catalog
from gravcal.browse import timeline
from gravcal.errors import NoDataError, refuse
from gravcal.store import location, store
from tasks import discovery
from tasks.stage import inline, lazy, using

report = lazy("gravcal.report.joint")


def joint(name, satellite, data, chosen, events=(), *, engine="inline", workers=None, listener=None):
    """(document, files, what has changed beyond its error since the last one) of a joint search, for each satellite.

    All satellites and events if none is named; data are folders with Level-1 files of one day or many, None for
    GRAVCAL_DATA; engine, workers and listener are those of a campaign.
    """
    sources = [one for folder in data or [None] for one in command.many_sources(name, satellite, folder)]
    unknown = sorted(set(events) - {source.event for source in sources})
    if unknown:
        there = ", ".join(source.event for source in sources)
        refuse(f"--events {','.join(unknown)}", "no such event", f"some of {there}", "Correct the names.", NoDataError)
    sources = [source for source in sources if not events or source.event in events]
    told = campaign.run(campaign.Campaign(name, chosen, engine, workers=workers, search="joint"), sources, listener)
    owners, left_out = {}, {row["event"]: row["error"] for row in told["events"] if "report" not in row}
    for source, row in zip(sources, told["events"], strict=True):
        if "report" in row:
            owners.setdefault(source.satellite, []).append(row)
    left_out |= {rows[0]["event"]: "the only one of its satellite" for rows in owners.values() if len(rows) < 2}
    found = [_of_one(name, one, rows, chosen, left_out) for one, rows in sorted(owners.items()) if len(rows) > 1]
    if not found:
        reasons = "; ".join(f"{event} ({reason})" for event, reason in left_out.items())
        refuse(f"{name} --joint", f"no two events of a satellite, not {reasons}", "two", "Give more data.")
    return found


def _of_one(name, satellite, rows, chosen, left_out):
    """Document, files and changes of the search over the events of one satellite, or of one pair."""
    one, letter = calibrations.load(name), satellite[0]
    settings = {"configuration": chosen.configuration, "left_out": left_out}
    about = {"event": owner(one, satellite), "satellite": satellite, "calibration": name}
    last = store.newest_record(about["event"], f"{name}.joint")
    before = (last and location.read_json(store.folder_of(last["key"]) / "joint.json")) or {}
    with using(inline):
        ref = discovery.joint(
            *(store.find(Path(row["report"]).name) for row in rows),
            events=[row["event"] for row in rows],
            history=history(one, letter),
            settings=settings,
            **one.discovery.chosen_for(chosen)[1],
            **about,
        )
    files = [path for path in sorted(ref.folder.iterdir()) if path.suffix in (".html", ".toml")]
    after = location.read_json(ref.folder / "joint.json")
    return after, files, report.changes(before, after)


def owner(one, satellite):
    """Name of what the events of a calibration are of: a satellite, or a pair."""
    return catalog.satellite(satellite).name if len(satellite) == 1 else f"{one.mission}-{satellite.lower()}"


def history(one, letter):
    """Trims and printed values of a satellite as plain records, times in GPS s."""
    seconds = lambda day: (day - timeline.EPOCH).total_seconds()  # noqa: E731
    trims = [
        {"date": str(t.date), "axis": t.axis, "size": t.trim_um, "confirmed": t.confirmed}
        for t in (timeline.trims(letter) if one.trims else ())
    ]
    printed = [
        {"time": seconds(p.date), "parameter": p.panel, "value": p.value, "sigma": p.sigma}
        for p in timeline.printed_points(one, letter)
    ]
    return {"trims": trims, "printed": printed}
