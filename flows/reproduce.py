"""A source paper again: its days fetched, processed as printed and as corrected, and both beside what is printed.

What a paper consists of stands in `catalog/published/papers.toml`, what is compared in the record of its calibration.
"""

import csv
import datetime
import re
import shutil

from flows import command, output
from flows.engine import other_store
from gravcal import catalog
from gravcal.errors import ProductError
from gravcal.io import archive, fetch
from gravcal.report import pages
from gravcal.store import configurations, schemas

RUNS = ("as_printed", "corrected")
HEADS = ("printed", "as printed, recomputed", "corrected")


def papers():
    """What is known of each paper, by the name of its calibration."""
    return catalog.read("published", "papers")[1]


def reproduce(name, out, *, place="isdc", data=None, simulated=False, listener=None, tell=None):
    """Document of a paper reproduced in a folder: data, a store of its own, both reports, page and tables.

    Days come from an archive (``place``), lie in the folder ``data``, or are simulated with the printed values as
    truth, which a paper without public data always is.
    """
    paper, one = papers()[name], command.record(name)
    made = simulated or not (paper["public"] or data)
    out.mkdir(parents=True, exist_ok=True)
    folder = data or out / "data"
    if made:
        archive.check_own(folder)
        for seed, day in enumerate(paper["days"], 1):
            one.simulate(folder, seed=seed, truth=out / f"truth_{day}.json", settings=paper["simulate"] | {"date": day})
    elif data is None:
        days = [datetime.date.fromisoformat(day) for day in paper["days"]]
        archives = [archive for day in days for archive in fetch.of_day(paper["letters"], day)]
        fetch.fetch(archives, folder, place, listener, fetch.Patience(tell=tell))
    documents = {}
    with other_store(str(out / "store")):  # simulated days bear the names of measured ones
        for run in RUNS:
            documents[run] = _run(one, paper, folder, run, out / run)
    items = [_compared(one, item, documents) for item in paper["tables"]]
    items += [item | {"rows": []} for item in paper["figures"]]
    kinds = {run: document["origin"] for run, document in documents.items()}
    document = {
        "schema_version": schemas.VERSION,
        "status": documents["corrected"]["status"],
        "calibration": name,
        "title": paper["title"],
        "doi": paper["doi"],
        "days": paper["days"],
        "origin": kinds["corrected"],
        "runs": {run: {"status": d["status"], "verdict": d["verdict"]["text"]} for run, d in documents.items()},
        "items": items,
    }
    output.write_json(document, out / "reproduction.json")
    _write(out, document)
    return document


def _run(one, paper, folder, run, out):
    settings = [f"{key}={value}" for key, value in paper["as_printed"].items()] if run == "as_printed" else []
    truth = out.parent / f"truth_{paper['days'][0]}.nc"
    settings += [f"truth={truth}"] if truth.is_file() else []  # series of a simulated day
    name = run if run == "as_printed" and paper["as_printed"] else None
    chosen = configurations.record(command.configured(one.name, settings, None, name))
    date = paper["days"][0] if paper["public"] and len(paper["days"]) == 1 else None
    source = command.source(one.name, None, folder, paper["satellite"], date)
    document, ref = command.calibrate(one.name, source, chosen, "inline")
    out.mkdir(exist_ok=True)
    for path in ref.folder.iterdir():
        if path.name not in ("meta.json", "product.nc"):
            shutil.copy(path, out / path.name)
    if document["status"] not in ("delivered", "questionable"):
        wanted = "a result. See its report, and try another archive."
        raise ProductError(f"{paper['title']}: found {document['status']} in {folder}, expected {wanted}")
    return document


def _compared(one, item, documents):
    """Item with its rows: each printed number beside those of both runs, where they have one."""
    if "section" not in item:
        return item | {"rows": []}
    rows = []
    for record in catalog.published(one.name)[item["section"]]:
        found = {run: one.recomputed(d, item["section"], record, run) for run, d in documents.items()}
        if not any(found.values()):
            continue
        none = ([None] * len(record.value),) * 2
        names = item.get("components") or ("xyz" if len(record.value) == 3 else [""] * len(record.value))
        label = " ".join(value for value in record.labels.values() if value)
        for k, component in enumerate(names):
            sigma = record.sigma[k] if k < len(record.sigma) else None
            row = {"row": f"{label} {component}".strip(), "printed": [record.value[k], sigma]}
            row |= {run: [part[k] for part in found[run] or none] for run in RUNS}
            if any(value is not None for value, _ in (row[name] for name in ("printed", *RUNS))):
                rows.append(row)
    return item | {"rows": rows}


def _text(pair):
    value, sigma = pair
    if value is None:
        return "-"
    text = value if isinstance(value, str) else f"{value:.5g}"
    return text if sigma is None else f"{text} +- {sigma:.2g}"


def _write(out, document):
    """Tables as CSV, gallery as Markdown and as a page with the figures of both runs."""
    with (out / "comparison.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["item", "row", "unit", *(f"{n}{s}" for n in ("printed", *RUNS) for s in ("", "_sigma"))])
        for item in document["items"]:
            for row in item["rows"]:
                numbers = [x for n in ("printed", *RUNS) for x in row[n]]
                writer.writerow([item["name"], row["row"], item["unit"], *numbers])
    lines, parts = [], []
    for item in document["items"]:
        said = item.get("reason") or item["difference"]
        lines += [f"**{item['name']}** {'not made: ' if 'reason' in item else ''}{said}", ""]
        rows = [[row["row"], *(_text(row[n]) for n in ("printed", *RUNS))] for row in item["rows"]]
        if rows:
            lines += [f"| {item['unit']} | {' | '.join(HEADS)} |", "| --- | --- | --- | --- |"]
            lines += [f"| {' | '.join(row)} |" for row in rows] + [""]
        drawn = {run: _figures(out / run / "report.html", item["report"]) for run in RUNS} if "report" in item else {}
        parts.append({"item": item, "said": said, "rows": rows, "drawn": drawn})
    (out / "gallery.md").write_text("\n".join(lines))
    (out / "index.html").write_text(pages.render("reproduction.html", paper=document, parts_of=parts, heads=HEADS))


def _figures(path, section):
    parts = re.split(r"<h2[^>]*>", path.read_text(encoding="utf-8"))[1:]
    own = next((part for part in parts if part.startswith(section)), "")
    return re.findall(r"<figure.*?</figure>", own, re.DOTALL)
