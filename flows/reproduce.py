"""Reproduction of a source paper: its days processed as printed and as corrected, both compared with the print.

Days, tables and figures of a paper are in `catalog/published/papers.toml`, the comparison in `Calibration.recomputed`.
"""

import base64
import datetime
import html
import re
import shutil

from flows import command, engine, output
from flows.engine import other_store
from gravcal import catalog
from gravcal.browse import timeline
from gravcal.errors import GravcalError, ProductError
from gravcal.io import archive, fetch
from gravcal.report import history, pages, plain
from gravcal.store import configurations, schemas

RUNS = ("as_printed", "corrected")
HEADS = ("printed", "as printed, recomputed", "corrected")
FIGURE = re.compile(r"<figure.*?</figure>", re.DOTALL)


def papers():
    """{calibration: table of papers.toml} of each source paper: title, DOI, days, settings, tables and figures."""
    return catalog.read("published", "papers")[1]


def reproduce(name, out, *, place="isdc", data=None, simulated=False, listener=None, tell=None):
    """Document of a paper reproduced in a folder: data, a store of its own, both reports, page and tables.

    Days come from an archive (``place``), lie in the folder ``data``, or are simulated with the printed values as
    truth, which a paper without public data always is. A table of many dates has those that are there.
    """
    paper, one = papers()[name], command.record(name)
    is_simulated = simulated or not (paper["public"] or data)
    out.mkdir(parents=True, exist_ok=True)
    folder = out / "data" if is_simulated or not data else data
    if is_simulated:
        invent(name, folder, out / "dates", out)
    elif data is None:  # the days, without which it cannot be made, and those dates of its tables that there are
        days, dates = [(paper["letters"], day) for day in paper["days"]], [row[:2] for row in _dates(one, paper)]
        for bundle in (days, dates):
            of_days = [fetch.of_day(letters, datetime.date.fromisoformat(day)) for letters, day in bundle]
            try:
                archives = list(dict.fromkeys(sum(of_days, [])))
                fetch.fetch(archives, folder, place, listener, fetch.Patience(tell=tell))
            except GravcalError as error:
                if bundle is days:
                    raise
                engine.warn(f"dates left out: {error}")
    date = paper["days"][0] if paper["public"] and len(paper["days"]) == 1 else None
    with other_store(str(out / "store")):  # simulated days bear the names of measured ones
        all_documents = {run: [_run(one, paper, run, folder, paper["satellite"], date, out / run)] for run in RUNS}
        at_hand = {days[1:]: days[0] for days in (() if is_simulated else one.days(folder))}
        for letter, day, *_ in _dates(one, paper):
            where = out / "dates" / f"{letter}-{day}" if is_simulated else at_hand.get((letter, day))
            try:
                documents = {run: _run(one, paper, run, where, letter, day) for run in RUNS if where}
            except GravcalError as error:
                engine.warn(f"{letter} {day} left out: {error}")
                continue
            for run, document in documents.items():
                all_documents[run].append(document)
    documents = {run: own for run, (own, *_) in all_documents.items()}
    items = [_compared(one, item, all_documents) for item in paper["tables"]]
    items += [item | {"rows": []} for item in paper["figures"]]
    origins = {run: document["origin"] for run, document in documents.items()}
    document = {
        "schema_version": schemas.VERSION,
        "status": documents["corrected"]["status"],
        "calibration": name,
        "title": paper["title"],
        "doi": paper["doi"],
        "days": paper["days"],
        "origin": origins["corrected"],
        "runs": {run: {"status": d["status"], "verdict": d["verdict"]["text"]} for run, d in documents.items()},
        "items": items,
    }
    output.write_json(document, out / "reproduction.json")
    _write(out, document)
    return document


def _run(one, paper, run, folder, satellite, date, out=None):
    """Result document of one day by a run ("as_printed" or "corrected"); its report is copied into ``out`` if any."""
    settings = [f"{key}={value}" for key, value in paper["as_printed"].items()] if run == "as_printed" else []
    truth = out and out.parent / f"truth_{paper['days'][0]}.nc"
    settings += [f"truth={truth}"] if truth and truth.is_file() else []  # series of a simulated day
    name = run if run == "as_printed" and paper["as_printed"] else None
    chosen = configurations.record(command.configured(one.name, settings, None, name))
    ref = command.made(one.flow, command.source(one.name, None, folder, satellite, date), chosen, "inline")
    document = one.document(ref)
    if document["status"] not in ("delivered", "questionable"):
        wanted = "a result. See its report, and try another archive."
        raise ProductError(f"{paper['title']}: found {document['status']} in {folder}, expected {wanted}")
    if out:
        out.mkdir(exist_ok=True)
        for path in ref.folder.iterdir():
            if path.name not in ("meta.json", "product.nc"):
                shutil.copy(path, out / path.name)
    return document


def invent(name, folder, dates, truth):
    """Simulate the days of a paper into ``folder`` and dates of its tables below ``dates``; truth into ``truth``."""
    paper, one = papers()[name], command.record(name)
    archive.check_own(folder)
    for seed, day in enumerate(paper["days"], 1):
        one.simulate(folder, seed=seed, truth=truth / f"truth_{day}.json", settings=paper["simulate"] | {"date": day})
    for letter, day, seed, settings in _dates(one, paper):
        one.simulate(dates / f"{letter}-{day}", seed=seed, settings=settings)


def _dates(one, paper):
    """(letter, date, seed, settings with the printed values as truth) of each table date but the paper's days."""
    dates = {(paper["satellite"], day) for day in paper["days"]}
    for item in (item for item in paper["tables"] if "truth" in item):
        for seed, record in enumerate(catalog.published(one.name)[item["section"]], 101):
            letter, day = catalog.event(record.events[0]).letters, record.date
            if (letter, day) not in dates:
                dates.add((letter, day))
                truth = {item["truth"]: ",".join(map(str, record.value)), "satellite": letter, "date": day}
                yield letter, day, seed, paper["simulate"] | item["simulate"] | truth


def _compared(one, item, documents):
    """Item (table of a paper) with "rows": {"row", "printed", "as_printed", "corrected"}, [value, sigma] each."""
    if "section" not in item:
        return item | {"rows": []}
    rows = []
    for record in catalog.published(one.name)[item["section"]]:
        blocks = {}
        for run in RUNS:
            results_of = (one.recomputed(document, item["section"], record, run) for document in documents[run])
            blocks[run] = next(filter(None, results_of), None)
        if not any(blocks.values()):
            continue
        blank = ([None] * len(record.value),) * 2
        names = item.get("components") or ("xyz" if len(record.value) == 3 else [""] * len(record.value))
        label = " ".join(value for value in record.labels.values() if value)
        for k, component in enumerate(names):
            sigma = record.sigma[k] if k < len(record.sigma) else None
            row = {"row": f"{label} {component}".strip(), "printed": [record.value[k], sigma]}
            row |= {run: [part[k] for part in blocks[run] or blank] for run in RUNS}
            if any(value is not None for value, _ in (row[name] for name in ("printed", *RUNS))):
                rows.append(row)
    missing = {} if rows else {"reason": "no day of its dates is at hand (--data FOLDER)"}
    return item | {"rows": rows} | missing


def _text(pair):  # "value +- sigma" of [value, sigma]; "-" without a value
    value, sigma = pair
    if value is None:
        return "-"
    text = value if isinstance(value, str) else f"{value:.5g}"
    return text if sigma is None else f"{text} +- {sigma:.2g}"


def _write(out, document):
    """Write comparison.csv, and the tables and figures of both runs as gallery.md and index.html, into ``out``."""
    heads = ["item", "row", "unit", *(f"{n}{s}" for n in ("printed", *RUNS) for s in ("", "_sigma"))]
    every = (
        [item["name"], row["row"], item["unit"], *(x for n in ("printed", *RUNS) for x in row[n])]
        for item in document["items"]
        for row in item["rows"]
    )
    (out / "comparison.csv").write_text(plain.csv_text(heads, every))
    lines, parts = [], []
    for item in document["items"]:
        said = item.get("reason") or item["difference"]
        lines += [f"**{item['name']}** {'not made: ' if 'reason' in item else ''}{said}", ""]
        rows = [[row["row"], *(_text(row[n]) for n in ("printed", *RUNS))] for row in item["rows"]]
        if rows:
            lines += [f"| {item['unit']} | {' | '.join(HEADS)} |", "| --- | --- | --- | --- |"]
            lines += [f"| {' | '.join(row)} |" for row in rows] + [""]
        drawn = {run: _drawn(out, document, item, run) for run in RUNS} if {"report", "series"} & set(item) else {}
        lines += _pictures(out, document["calibration"], item, drawn)
        parts.append({"item": item, "said": said, "rows": rows, "drawn": drawn})
    (out / "gallery.md").write_text("\n".join(lines))
    (out / "index.html").write_text(pages.render("reproduction.html", paper=document, parts_of=parts, heads=HEADS))


def _drawn(out, document, item, run):
    """[<figure> HTML] of a run: of the section of its report, or of the table over the years, that an item names."""
    if "series" in item:  # table over the years: printed values, those of a run, and the mass trims
        one, points = command.record(document["calibration"]), []
        letter = papers()[one.name]["satellite"]
        table = next(other for other in document["items"] if other["name"] == item["series"])
        unit = table["unit"].replace("um", "µm")
        for name, mood in (("printed", "printed"), (run, document["origin"])):
            for row in (row for row in table["rows"] if row[name][0] is not None):
                date, axis = re.search(r"(\d{4}-\d\d-\d\d).* (\w)$", row["row"]).groups()
                said = datetime.datetime.fromisoformat(date), *row[name], "", mood, document["doi"]
                points.append(timeline.Point(letter, axis, unit, *said))
        trims = [(letter, trim) for trim in timeline.trims(letter)]
        return FIGURE.findall(history.history(one.quantity, points, trims, one.band)[1])
    parts = re.split(r"<h2[^>]*>", (out / run / "report.html").read_text(encoding="utf-8"))[1:]
    return FIGURE.findall(next((part for part in parts if part.startswith(item["report"])), ""))


def _pictures(out, name, item, drawn):
    """Markdown lines of an item's first figure (or all) of each run, once if equal in both; writes the SVG files."""
    lines, runs_of = [], {}
    for run, figures in drawn.items():
        for number, one in enumerate(figures[: None if item.get("all") else 1], 1):
            for address, title in re.findall(r'base64,([^"]*)" alt="([^"]*)"', one):
                runs_of.setdefault((number, title, address), []).append(run)
    for (number, title, address), runs in sorted(runs_of.items(), key=lambda one: one[0][0]):
        suffix, said = ("", "Both runs") if len(runs) > 1 else (runs[0], HEADS[1 + RUNS.index(runs[0])].capitalize())
        words = f"{name} {item['name']} {number if number > 1 else ''} {suffix}".strip().lower()
        path = "images/papers/" + re.sub(r"\W+", "_", words) + ".svg"
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        (out / path).write_bytes(base64.b64decode(address))
        lines += [f"*{said}: {html.unescape(title)}.*", "", f"![{html.unescape(title)}]({path})", ""]
    return lines
