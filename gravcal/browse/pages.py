"""One function for each page: asks the shelf, fills a template. Names from the address are looked up, never joined."""

import functools
import graphlib
import math
import re

from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse

from gravcal import __version__, catalog
from gravcal.browse import access, plots, series, store_index
from gravcal.browse import timeline as years
from gravcal.report import comparison
from gravcal.report.pages import environment, true_units
from gravcal.report.plain import gps_text, quantity
from gravcal.store import configurations, history, location
from gravcal.store import product as contents
from gravcal.store.results import rounded

KINDS = {".html": "text/html; charset=utf-8", ".json": "application/json", ".nc": "application/x-netcdf"}
WIDTH, HEIGHT = 138, 50  # of a box, px
ACROSS, DOWN = 158, 60  # from one box to the next, px
MARGIN = 6


def page(body):
    """Decorator: a page is computed in a thread of its own, so that others are answered meanwhile."""

    @functools.wraps(body)
    async def answer(request):
        return await run_in_threadpool(body, request)

    return answer


@page
def home(request):
    """Calibrations with their state, and all events."""
    rows = store_index.results()
    counts = {name: [row for row in rows if row["calibration"] == name] for name in request.app.state.calibrations}
    return _filled("home.html", request, rows=rows, counts=counts, waiting=store_index.waiting(rows))


@page
def timeline(request):
    """Results of a calibration over the years."""
    name = request.path_params["calibration"]
    calibration = request.app.state.calibrations.get(name)
    if calibration is None:
        return not_found(request, None)
    points = years.points(calibration)
    letters = sorted({point.satellite for point in points})
    return _filled("timeline.html", request, calibration=calibration, letters=letters, points=points)


@page
def timeline_figure(request):
    """Figure of one satellite over the years."""
    calibration = request.app.state.calibrations.get(request.path_params["calibration"])
    satellite = request.path_params["satellite"]
    drawn = plots.over_years(calibration, satellite) if calibration else None
    return JSONResponse(drawn) if drawn else JSONResponse({"error": "found no result"}, 404)


@page
def event(request):
    """Chain of stages of one event as its last run left it, what a change would remake, its results and reports."""
    name, configuration = request.path_params["event"], request.query_params.get("as", location.OPERATIONAL)
    plain = [row for row in store_index.results() if row["event"] == name]
    flows = store_index.flows(name, configuration)
    flow = request.query_params.get("flow", flows[0] if flows else "")
    nodes = store_index.chain(name, configuration, flow if flow in flows else None)
    if not (nodes or plain and configuration == location.OPERATIONAL):
        return not_found(request, None)
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
    """Names of the settings of a product that a user can choose, also of those handed on as a table."""
    for name, value in settings.items():
        yield from _settings(value) if isinstance(value, dict) and name == "settings" else [name]


def _earlier(request, rows):
    """Other results of an event, with what each value was and by how much this one differs, and why."""
    found = []
    for row in (row for row in rows if _delivered(row["document"])):
        calibration = request.app.state.calibrations.get(row["calibration"])
        others = store_index.relatives(row["report"]) if calibration else []
        for one, why in (pair for pair in others if pair[0].ref.event == row["event"]):
            document = store_index.document(one)
            if _delivered(document):
                pair = (row["event"], document, row["document"], why)
                compared = comparison.comparison(calibration, ("that", "this"), [pair], {})
                found.append((one, comparison.moved(compared["events"][0]), why))
    return found


def _delivered(document):
    """Whether a document, or None, holds a result."""
    return (document or {}).get("status") in years.RESULTS


@page
def compare(request):
    """Results of two configurations event by event: values, difference in sigma, and why."""
    name = request.path_params["calibration"]
    calibration = request.app.state.calibrations.get(name)
    if calibration is None:
        return not_found(request, None)
    known = [location.OPERATIONAL, *configurations.names(name)]
    first, second = (request.query_params.get(side, known[0 if side == "a" else -1]) for side in "ab")
    sides = []
    for one in (first, second):
        own = [row for row in store_index.results(one) if row["calibration"] == name and _delivered(row["document"])]
        sides.append({row["event"]: row for row in own})
    shared = sorted(sides[0].keys() & sides[1].keys())
    whys = {one: history.apart(*(side[one]["report"].ref.key for side in sides)) for one in shared}
    pairs = [(one, *(side[one]["document"] for side in sides), whys[one]) for one in shared]
    alone = {n: sorted(own.keys() - other.keys()) for n, own, other in ((first, *sides), (second, *sides[::-1]))}
    tables = comparison.tables(comparison.comparison(calibration, (first, second), pairs, alone))
    return _filled("compare.html", request, calibration=calibration, known=known, compared=(first, second),
                   tables=tables, alone=alone, assumption=comparison.ASSUMPTION)  # fmt: skip


@page
def search(request):
    """What discovery said of an event: verdict, findings, what it could not have seen; and its own page."""
    name, configuration = request.path_params["event"], request.query_params.get("as", location.OPERATIONAL)
    found = store_index.searches(name, configuration)
    if not found:
        return not_found(request, None)
    return _filled("search.html", request, name=name, configuration=configuration, found=found)


@page
def designs(request):
    """Designs of sessions in the catalogue, and what of an event was planned and found."""
    known = {name: catalog.design(name) for name in catalog.names("designs")}
    name = request.query_params.get("event", "")
    event = catalog.event(name) if name in catalog.names("events") else None
    rows = [row for row in store_index.results() if row["event"] == name]
    flown = [one for row in rows for one in (row["document"] or {}).get("manoeuvres") or []]
    proposed = store_index.proposed()
    return _filled("designs.html", request, known=known, name=name, event=event, flown=flown, proposed=proposed)


@page
def results(request):
    """Catalogue of all delivered values as CSV, with links to these pages."""
    at = str(request.base_url).rstrip("/")
    link = lambda one, name: f"{at}/{'report' if name.endswith('.html') else 'file'}/{one.ref.key}/{name}"  # noqa: E731
    return _csv(years.csv_of(years.delivered(request.app.state.calibrations, link)), "results")


def _csv(text, name):
    """Answer with a table to be kept."""
    return PlainTextResponse(text, media_type="text/csv",
                             headers={"Content-Disposition": f'attachment; filename="{name}.csv"'})  # fmt: skip


@page
def products(request):
    """All products of the store, those replaced by newer ones when asked for."""
    everything = request.query_params.get("all") == "1"
    found = [one for one in store_index.entries() if one.configurations or everything]
    return _filled("products.html", request, found=found[::-1], everything=everything,
                   differs=store_index.differing(found))  # fmt: skip


@page
def product(request):
    """One product: what it holds, a plot, how it was made."""
    found = store_index.entry(request.path_params["key"])
    if found is None:
        return not_found(request, None)
    held = series.listed(found.ref.path)
    shown = _shown(held, request.query_params.get("variable"))
    wish = _wish(request, shown.name if shown else "")
    table = series.table(found.ref.path, shown) if shown and not shown.plottable else None
    with contents.opened(found.ref.path) as file:
        attributes = {name: str(one) for name, one in contents.attributes(file).items() if name != "gravcal_recipe"}
    return _filled("product.html", request, found=found, held=held, shown=shown, wish=wish, table=table,
                   chosen=plots.chosen(shown, wish.columns) if shown and shown.plottable else (),
                   relatives=store_index.relatives(found), siblings=store_index.siblings(found), attributes=attributes,
                   tree=history.tree(found), views=plots.VIEWS)  # fmt: skip


@page
def figure(request):
    """Figure of a variable."""
    try:
        return JSONResponse(plots.figure(_wish(request, request.path_params["variable"])))
    except (plots.Missing, OSError) as error:
        return JSONResponse({"error": str(error)}, 404)


@page
def data(request):
    """Data of a figure between two places of its axis."""
    try:
        start, stop = (float(request.query_params[name]) for name in ("from", "to"))
        if not (math.isfinite(start) and math.isfinite(stop)):
            raise ValueError
        return JSONResponse(plots.data(_wish(request, request.path_params["variable"]), start, stop))
    except (plots.Missing, OSError) as error:
        return JSONResponse({"error": str(error)}, 404)
    except (KeyError, ValueError):
        return JSONResponse({"error": "give from and to, two numbers"}, 400)


@page
def samples(request):
    """Data of a figure as CSV, every sample between two places of its axis."""
    try:
        ends = [float(request.query_params.get(name, "nan")) for name in ("from", "to")]
        wish = _wish(request, request.path_params["variable"])
        return _csv(plots.table(wish, *(None if math.isnan(one) else one for one in ends)), wish.variable)
    except (plots.Missing, OSError) as error:
        return PlainTextResponse(f"{error}\n", 404)
    except ValueError as error:
        return PlainTextResponse(f"{error}\n", 400)


@page
def report(request):
    """A file of a report, shown without scripts."""
    return _file(request, {"Content-Security-Policy": access.REPORT})


@page
def download(request):
    """A file of a product, to be kept."""
    return _file(request, {"Content-Disposition": "attachment"})


def not_found(request, _):
    """Say that there is no such page."""
    return _filled("message.html", request, 404, title="Not in this store",
                   text="There is no such page, event or product here.")  # fmt: skip


def broken(request, _):
    """Say that a page failed."""
    return _filled("message.html", request, 500, title="This page failed",
                   text="A product may be damaged: gravcal products verify says which.")  # fmt: skip


def _file(request, headers):
    """A file that the record of a product names."""
    found = store_index.entry(request.path_params["key"])
    path = store_index.file(found, request.path_params["name"]) if found else None
    if path is None:
        return not_found(request, None)
    return FileResponse(path, media_type=KINDS.get(path.suffix, "text/plain; charset=utf-8"), headers=headers)


def _wish(request, variable):
    """What the address asks to be drawn."""
    asked = request.query_params
    columns = tuple(int(text) for text in asked.getlist("column") if text.isascii() and text.isdigit())
    view = asked.get("view", "overlay")
    view = view if view in plots.VIEWS else "overlay"
    other = asked.get("with", "") if store_index.entry(asked.get("with", "")) else ""
    key = request.path_params["key"]
    return plots.Wish(key, variable, columns, other, view, asked.get("start") == "1", asked.get("even") == "1")


def _shown(held, name):
    """Variable that the page shows: the one asked for, else the first of those that vary along time."""
    asked = next((one for one in held if one.name == name), None)
    plain = [one for one in held if one.plottable and one.name not in one.dims]
    timed = [one for one in plain if one.dims[one.axis].startswith("time")]
    best = [one for one in timed if one.dtype.startswith("float") and one.units != "1"]
    return asked or next(iter([*best, *timed, *plain, *held]), None)


def _filled(template, request, status=200, **content):
    """Page of a template."""
    known = {
        "names": {name: one.title for name, one in request.app.state.calibrations.items()},
        "store": str(location.folder()),
        "version": __version__,
        "path": request.url.path,
    }
    return HTMLResponse(_environment().get_template(template).render(query=str(request.url.query), **known, **content),
                        status)  # fmt: skip


@functools.lru_cache(maxsize=1)
def _environment():
    """Templates of this package."""
    made = environment("gravcal.browse", "templates")
    made.filters |= {
        "stamp": lambda text: text[:16].replace("T", " "),  # UTC
        "short": lambda text: text[:12],
        "seconds": lambda value: f"{value:.2g} s" if value < 100 else f"{value:.0f} s",
        "signs": true_units,
        "calendar": gps_text,
        "rounded": lambda value, sigma: _signed(rounded(value, sigma)),
        "numbers": _signed,
        "quantity": quantity,
    }
    return made


def _signed(text):
    """Text with true signs before its numbers, but in powers of ten."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text.replace("+-", "±").replace(" um", " µm"))


def placed(nodes):
    """Picture of a chain, stages beside inputs: "width", "height", "boxes" (x, y, node), "lines" as path texts."""
    known, depths, columns, places = {node.key: node for node in nodes if node.key}, {}, {}, {}
    inputs = {node.key or node.stage: [key for key in node.inputs if key in known] for node in nodes}
    for key in graphlib.TopologicalSorter(inputs).static_order():
        depths[key] = 1 + max((depths[below] for below in inputs[key]), default=-1)
    for node in nodes:
        depth = depths[node.key] if node.key else max((depths[key] for key in known), default=-1) + 1
        columns.setdefault(depth, []).append(node)
    tallest = max(map(len, columns.values()), default=0)
    for depth, column in sorted(columns.items()):
        beside = {id(node): [places[key][1] for key in inputs[node.key or node.stage]] for node in column}
        wish = lambda node, near=beside: (sum(near[id(node)]) / max(len(near[id(node)]), 1), node.stage)  # noqa: E731
        for row, node in enumerate(sorted(column, key=wish)):
            top = MARGIN + (tallest - len(column)) * DOWN / 2
            places[node.key or node.stage] = (MARGIN + depth * ACROSS, top + row * DOWN, node)
    lines = [_line(places[key], places[node], depths[node] - depths[key]) for node in known for key in inputs[node]]
    width = 2 * MARGIN + max(columns, default=0) * ACROSS + WIDTH
    boxes = {"width": width, "height": 2 * MARGIN + tallest * DOWN, "boxes": list(places.values())}
    return boxes | {"lines": sorted(lines)}


def _line(start, stop, columns):
    """Curve from the right of one box to the left of another; one that passes columns bends late."""
    x, y = start[0] + WIDTH, start[1] + HEIGHT / 2
    u, v = stop[0], stop[1] + HEIGHT / 2
    bend = (ACROSS - WIDTH) * (0.5 if columns == 1 else 0.9)
    return f"M{x:.0f},{y:.0f} C{x + bend:.0f},{y:.0f} {u - bend:.0f},{v:.0f} {u:.0f},{v:.0f}"
