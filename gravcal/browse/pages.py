"""One function for each page: request to response. Names in a URL are looked up in the store, never joined to paths."""

import graphlib
import re

from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse

from gravcal import __version__, catalog
from gravcal.browse import plots, series, store_index
from gravcal.browse import timeline as years
from gravcal.report import comparison
from gravcal.report.documents import WITH_RESULT
from gravcal.report.pages import environment, true_units
from gravcal.report.plain import gps_text, quantity
from gravcal.store import configurations, history, location
from gravcal.store import product as contents
from gravcal.store.results import rounded

KINDS = {".html": "text/html; charset=utf-8", ".json": "application/json", ".nc": "application/x-netcdf"}
#: What a report may do: show itself, without scripts.
REPORT = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
WIDTH, HEIGHT = 138, 50  # of a box, px
ACROSS, DOWN = 158, 60  # from one box to the next, px
MARGIN = 6


def home(request):
    """Calibrations with their state, and all events."""
    rows = store_index.results()
    counts = {name: [row for row in rows if row["calibration"] == name] for name in request.app.state.calibrations}
    return _filled("home.html", request, rows=rows, counts=counts, waiting=store_index.waiting(rows))


def timeline(request):
    """Page with the results of a calibration over the years."""
    calibration = _calibration(request)
    points = years.points(calibration)
    letters = sorted({point.satellite for point in points})
    return _filled("timeline.html", request, calibration=calibration, letters=letters, points=points)


def timeline_figure(request):
    """JSON figure of the results of one satellite over the years."""
    return JSONResponse(_there(plots.over_years(_calibration(request), request.path_params["satellite"])))


def event(request):
    """Chain of stages of an event after its last run, products that a changed setting remakes, results, reports."""
    name, configuration = _event(request)
    plain = [row for row in store_index.results() if row["event"] == name]
    flows = store_index.flows(name, configuration)
    flow = request.query_params.get("flow", flows[0] if flows else "")
    nodes = store_index.chain(name, configuration, flow if flow in flows else None)
    _there(nodes or (plain if configuration == location.OPERATIONAL else None))
    rows = [row for row in store_index.results(configuration) if row["event"] == name]
    experiments = sorted({one for row in plain for one in row["experiments"]})
    tried = {one: [row for row in store_index.results(one) if row["event"] == name] for one in experiments}
    made = [node.entry for node in nodes if node.entry]
    changes = sorted({key for one in made for key in _settings(one.record["recipe"]["settings"])})
    change = request.query_params.get("change", "")
    again = history.remade(made, change) if change in changes else set()
    return _filled("event.html", request, name=name, configuration=configuration, rows=rows, nodes=nodes, tried=tried,
                   picture=placed(nodes), flows=flows, flow=flow, changes=changes, change=change, again=again,
                   earlier=_earlier(request, rows), searches=store_index.searches(name, configuration))  # fmt: skip


def _settings(settings):
    """Names of the settings of a product's recipe, also of those in a nested table "settings"."""
    for name, value in settings.items():
        yield from _settings(value) if isinstance(value, dict) and name == "settings" else [name]


def _earlier(request, rows):
    """[(Entry, lines of `comparison.moved`, reasons)] of other results of an event, compared with its rows."""
    earlier = []
    for row in (row for row in rows if _delivered(row["document"])):
        calibration = request.app.state.calibrations.get(row["calibration"])
        others = store_index.relatives(row["report"]) if calibration else []
        for one, why in (pair for pair in others if pair[0].ref.event == row["event"]):
            document = store_index.document(one)
            if _delivered(document):
                compared = comparison.of_event(calibration, row["event"], document, row["document"], why)
                earlier.append((one, comparison.moved(compared), why))
    return earlier


def _delivered(document):
    """True if a document (None: none) has a status with a result."""
    return (document or {}).get("status") in WITH_RESULT


def compare(request):
    """Results of two configurations event by event: values, difference in sigma, and why."""
    calibration = _calibration(request)
    known = [location.OPERATIONAL, *configurations.names(calibration.name)]
    first, second = (request.query_params.get(side, known[0 if side == "a" else -1]) for side in "ab")
    document = comparison.between(calibration, (first, second))
    return _filled("compare.html", request, calibration=calibration, known=known, document=document,
                   tables=comparison.tables(document), assumption=comparison.ASSUMPTION)  # fmt: skip


def search(request):
    """Discovery of an event: verdict, findings, detection limits, and link to its report."""
    name, configuration = _event(request)
    searches = _there(store_index.searches(name, configuration))
    return _filled("search.html", request, name=name, configuration=configuration, found=searches)


def designs(request):
    """Designs of sessions in the catalogue, proposed ones, and planned and detected manoeuvres of an event."""
    known = {name: catalog.design(name) for name in catalog.names("designs")}
    name = request.query_params.get("event", "")
    event = catalog.event(name) if name in catalog.names("events") else None
    rows = [row for row in store_index.results() if row["event"] == name]
    flown = [one for row in rows for one in (row["document"] or {}).get("manoeuvres") or []]
    proposed = store_index.proposed()
    return _filled("designs.html", request, known=known, name=name, event=event, flown=flown, proposed=proposed)


def results(request):
    """Catalogue of all delivered values as CSV, with links to these pages."""
    at = str(request.base_url).rstrip("/")
    link = lambda one, name: f"{at}/{'report' if name.endswith('.html') else 'file'}/{one.ref.key}/{name}"  # noqa: E731
    return _csv(years.csv_of(years.delivered(request.app.state.calibrations, link)), "results")


def _csv(text, name):
    """Response with CSV text, to be saved as name.csv."""
    disposition = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return PlainTextResponse(text, media_type="text/csv", headers=disposition)


def products(request):
    """All products of the store, those replaced by newer ones when asked for."""
    everything = request.query_params.get("all") == "1"
    entries = [one for one in store_index.entries() if one.configurations or everything]
    differs = store_index.differing(entries)
    return _filled("products.html", request, found=entries[::-1], everything=everything, differs=differs)


def product(request):
    """One product: variables, a plot, attributes, provenance, related products."""
    entry = _there(store_index.entry(request.path_params["key"]))
    held = series.listed(entry.ref.path)
    shown = _shown(held, request.query_params.get("variable"))
    wish = _wish(request, shown.name if shown else "")
    table = series.table(entry.ref.path, shown) if shown and not shown.plottable else None
    with contents.opened(entry.ref.path) as file:
        attributes = {name: str(one) for name, one in contents.attributes(file).items() if name != "gravcal_recipe"}
    return _filled("product.html", request, found=entry, held=held.values(), shown=shown, wish=wish, table=table,
                   chosen=plots.chosen(shown, wish.columns) if shown and shown.plottable else (),
                   relatives=store_index.relatives(entry), siblings=store_index.siblings(entry), attributes=attributes,
                   tree=history.tree(entry), views=plots.VIEWS)  # fmt: skip


def figure(request):
    """JSON figure of a variable, as of `plots.figure`."""
    return JSONResponse(plots.figure(_wish(request, request.path_params["variable"])))


def data(request):
    """JSON data of a figure between the coordinates "from" and "to", as drawn; HTTP 400 without both."""
    start, stop = _ends(request)
    if start is None or stop is None:
        raise HTTPException(400, "give from and to, two numbers")
    return JSONResponse(plots.data(_wish(request, request.path_params["variable"]), start, stop))


def samples(request):
    """Data of a figure as CSV, every sample between the coordinates "from" and "to", if any."""
    wish = _wish(request, request.path_params["variable"])
    return _csv(plots.table(wish, *_ends(request)), wish.variable)


def _ends(request):
    """[from, to] of the query, coordinates of the axis as drawn; None for each that is no number."""
    texts = (request.query_params.get(name, "") for name in ("from", "to"))
    return [float(text) if re.fullmatch(r"[-+]?\d+(\.\d*)?(e[-+]?\d+)?", text) else None for text in texts]


def file(request):
    """A file that the record of a product names: of a report, shown without scripts, or to be kept."""
    entry = _there(store_index.entry(request.path_params["key"]))
    path = _there(store_index.file(entry, request.path_params["name"]))
    is_shown = request.url.path.startswith("/report/")
    headers = {"Content-Security-Policy": REPORT} if is_shown else {"Content-Disposition": "attachment"}
    return FileResponse(path, media_type=KINDS.get(path.suffix, "text/plain; charset=utf-8"), headers=headers)


def not_found(request, _):
    """HTTP 404: there is no such page."""
    return _filled("message.html", request, 404, title="Not in this store",
                   text="There is no such page, event or product here.")  # fmt: skip


def broken(request, _):
    """HTTP 500: a page failed."""
    return _filled("message.html", request, 500, title="This page failed",
                   text="A product may be damaged: gravcal products verify says which.")  # fmt: skip


def missing(_, error):
    """HTTP 404 with the text of a `series.Missing`."""
    return PlainTextResponse(f"{error}\n", 404)


def _there(target):
    """The target itself; HTTP 404 where it is None or empty."""
    if not target:
        raise HTTPException(404)
    return target


def _calibration(request):
    """Calibration in the path of the request; HTTP 404 if unknown."""
    return _there(request.app.state.calibrations.get(request.path_params["calibration"]))


def _event(request):
    """(event, configuration) in the request, by default "operational"."""
    return request.path_params["event"], request.query_params.get("as", location.OPERATIONAL)


def _wish(request, variable):
    """`plots.Wish` of a variable (name) by a query: column, view, with (key of another product), start and even (1)."""
    query = request.query_params  # what is not valid is ignored
    columns = tuple(int(t) for t in query.getlist("column") if t.isascii() and t.isdigit() and len(t) < 9)
    view = query.get("view", "overlay")
    view = view if view in plots.VIEWS else "overlay"
    other = query.get("with", "") if store_index.entry(query.get("with", "")) else ""
    key = request.path_params["key"]
    return plots.Wish(key, variable, columns, other, view, query.get("start") == "1", query.get("even") == "1")


def _shown(held, name):
    """Variable of {name: Variable} to show: that of the name, else the first plottable, along time if any; or None."""
    plain = [one for one in held.values() if one.plottable and one.name not in one.dims]
    timed = [one for one in plain if one.dims[one.axis].startswith("time")]
    best = [one for one in timed if one.dtype.startswith("float") and one.units != "1"]
    return held.get(name) or next(iter([*best, *timed, *plain, *held.values()]), None)


def _filled(template, request, status=200, **content):
    """HTML response of a template, with entries that all pages use."""
    known = {
        "names": {name: one.title for name, one in request.app.state.calibrations.items()},
        "store": str(location.folder()),
        "version": __version__,
        "path": request.url.path,
        "query": str(request.url.query),
    }
    return HTMLResponse(TEMPLATES.get_template(template).render(**known, **content), status)


def _signed(text):
    """Text with true minus signs before numbers (not exponents), ± and µ."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text.replace("+-", "±").replace(" um", " µm"))


TEMPLATES = environment("gravcal.browse", "templates")
TEMPLATES.tests["digest"] = lambda value: re.fullmatch("[0-9a-f]{32,}", str(value))
TEMPLATES.filters |= {
    "stamp": lambda text: text[:16].replace("T", " "),  # UTC
    "short": lambda text: text[:12],
    "seconds": lambda value: f"{value:.2g} s" if value < 100 else f"{value:.0f} s",
    "signs": true_units,
    "calendar": gps_text,
    "rounded": lambda value, sigma: _signed(rounded(value, sigma)),
    "numbers": _signed,
    "quantity": quantity,
}


def placed(nodes):
    """Layout of [Node], px, stages right of their inputs: "width", "height", "boxes" (x, y, Node), "lines" (SVG)."""
    known = {node.key or node.stage: node for node in nodes}
    inputs = {name: [key for key in node.inputs if key in known] for name, node in known.items()}
    depths, columns, places, lines = {}, {}, {}, []
    for name in graphlib.TopologicalSorter(inputs).static_order():
        depths[name] = 1 + max((depths[key] for key in inputs[name]), default=-1)
    last = max((depths[name] for name, node in known.items() if node.key), default=-1)
    for name, node in known.items():
        columns.setdefault(depths[name] if node.key else last + 1, []).append(name)  # what failed stands at the end
    tallest = max(map(len, columns.values()), default=0)
    for depth, column in sorted(columns.items()):
        near = {name: [places[key][1] for key in inputs[name]] for name in column}
        column.sort(key=lambda name, near=near: (sum(near[name]) / max(len(near[name]), 1), known[name].stage))
        for row, name in enumerate(column):
            x, y = MARGIN + depth * ACROSS, MARGIN + ((tallest - len(column)) / 2 + row) * DOWN
            places[name] = (x, y, known[name])
            for key in inputs[name]:  # from the right of one box to the left of another; past columns it bends late
                u, v, w = places[key][0] + WIDTH, places[key][1] + HEIGHT / 2, y + HEIGHT / 2
                bend = (ACROSS - WIDTH) * (0.5 if x - places[key][0] == ACROSS else 0.9)
                lines.append(f"M{u:.0f},{v:.0f} C{u + bend:.0f},{v:.0f} {x - bend:.0f},{w:.0f} {x:.0f},{w:.0f}")
    width = 2 * MARGIN + max(columns, default=0) * ACROSS + WIDTH
    return {"width": width, "height": 2 * MARGIN + tallest * DOWN, "boxes": list(places.values()), "lines": lines}
