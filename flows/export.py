"""One event in one folder or zip, for an archive or for somebody without gravcal.

report/      pages, documents and models, by stage       provenance.json   what everything was made of, to the raw files
products/    netCDF files, by stage                      CITATION.cff      this result, its data and its papers
"""

import contextlib
import json
import zipfile
from datetime import date
from pathlib import Path

import yaml

from gravcal import __version__, catalog
from gravcal.errors import CatalogError, refuse
from gravcal.report import discovery
from gravcal.store import history, housekeeping, location

#: DOI of Level-1 data of a mission, by level and release.
DATA = {
    ("GRACE", "1B", "03"): "10.5067/GRJPL-L1B03",
    ("GRACE-FO", "1A", "04"): "10.5067/GFJPL-L1A04",
    ("GRACE-FO", "1B", "04"): "10.5067/GFJPL-L1B04",
}
MISSIONS = {letter: mission for mission, own in catalog.PAIRS.items() for letter in "".join(own)}


def export(event: str, out: Path, name: str | None = None) -> tuple[list[str], list[str]]:
    """Files written into a folder, or a zip where the path ends so, and stages left out; of an experiment if named.

    Left out is what was made from other files of the same days than the newest report: an archive is of one origin.

    Raises
    ------
    ProductError : no report of the event in this configuration, or the folder or file is there already
    """
    configuration = name or location.OPERATIONAL
    every = housekeeping.entries(event=event, configuration=configuration)
    entries = _of_one_origin(every)
    left_out = sorted({one.ref.stage for one in every} - {one.ref.stage for one in entries})
    reports = [one for one in entries if one.ref.stage.endswith("report")]
    if not reports:
        missing = f"no report of the configuration {configuration} in {location.folder()}"
        refuse(event, missing, "one", "Make it with gravcal run, or name an experiment with --as.")
    if out.exists() and (out.is_file() or any(out.iterdir())):
        refuse(str(out), "that it is there already", "a new folder or file", "Give another --out.")
    files = {f"report/{e.ref.stage}/{n}": (e.ref.folder / n).read_bytes() for e in entries for n in e.record["files"]}
    for one in reports:
        text = discovery.model_text((), event, history.model_of(one.record)).encode()
        if text:  # that of a search has its own
            files.setdefault(f"report/{one.ref.stage}/model.toml", text)
    files |= {f"products/{one.ref.stage}.nc": one.ref.path.read_bytes() for one in entries}
    written = set()
    trees = {one.ref.stage: _told_once(history.tree(one), written) for one in reports}
    files["provenance.json"] = json.dumps(trees, indent=1).encode()
    files["CITATION.cff"] = citation(event, configuration, reports).encode()
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.suffix == ".zip":
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            for path, content in files.items():
                archive.writestr(f"{event}/{path}", content)
        return sorted(files), left_out
    for path, content in files.items():
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        (out / path).write_bytes(content)
    return sorted(files), left_out


def _of_one_origin(entries):
    """Entries made from the Level-1 files of the newest report, as far as it has files of the same days."""
    used, kept = {}, []
    for one in sorted(entries, key=lambda entry: (entry.ref.stage.endswith("report"), entry.record["made"]))[::-1]:
        raw = [raw for raw in history.raw_files(one.ref.key) if raw["product"] not in history.AUXILIARY]
        files = [((raw["product"], raw["satellite"], raw["date"]), raw["digest"]) for raw in raw]
        if all(digest in used.get(day, (digest,)) for day, digest in files):
            kept.insert(0, one)
            for day, digest in files:
                used.setdefault(day, set()).add(digest)
    return kept


def _told_once(node, written):
    """Node of a provenance tree, in full where its product is met first, later by key; ``written``: keys so far."""
    key = node["record"]["key"] if node["record"] else None
    if key in written:
        return {"name": node["name"], "key": key, "record": None, "inputs": []}
    written |= {key} if key else set()
    return node | {"inputs": [_told_once(one, written) for one in node["inputs"]]}


def citation(event: str, configuration: str, reports: list) -> str:
    """Citation File Format 1.2.0 of the results of an event: the measured data and the papers they rest on."""
    raw = [one for report in reports for one in history.raw_files(report.ref.key)]
    raw = [one for one in raw if one["satellite"] in MISSIONS and one["product"][-2:] in ("1A", "1B")]
    cited = sorted({(MISSIONS[one["satellite"]], one["product"][-2:], one["release"]) for one in raw})
    simulated = any(housekeeping.content(one).attrs.get("origin", "measured") != "measured" for one in reports)
    references = [
        {"type": "data", "title": f"{mission} Level-{level}, release {release}", "authors": [{"name": "JPL, PO.DAAC"}]}
        | ({"doi": DATA[mission, level, release]} if (mission, level, release) in DATA else {})
        for mission, level, release in ([] if simulated else cited)
    ]
    dois = set()
    for calibration in {report.ref.kind.partition(".")[0] for report in reports}:
        with contextlib.suppress(CatalogError):  # nothing of it was printed
            printed = (one for records in catalog.published(calibration).values() for one in records)
            dois |= {one.source.partition(",")[0] for one in printed}
    references += [
        {"type": "article", "title": f"doi:{doi}", "authors": [{"name": "as the DOI says"}], "doi": doi}
        for doi in sorted(dois)
        if doi.startswith("10.")
    ]
    fields = {
        "cff-version": "1.2.0",
        "message": "Cite this result together with its references.",
        "type": "dataset",
        "title": f"Calibration {event} ({configuration}), gravcal {__version__}",
        "authors": [{"name": "The gravcal developers"}],
        "date-released": date.fromisoformat(max(one.record["made"] for one in reports)[:10]),
        "identifiers": [
            {"type": "other", "value": one.ref.digest, "description": f"SHA-256 of {one.ref.stage}"} for one in reports
        ],
    }
    text = yaml.safe_dump(fields | ({"references": references} if references else {}), sort_keys=False, width=1000)
    return text + ("# The data are simulated: there is none to cite.\n" if simulated else "")
