"""Findings in the measured days of --data, figures beside those first said; --out draws that of docs/discoveries.md."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.ranging import first_said
from benchmarks.tables import STUDIES, Figure, grid, numbers, say, title
from flows import discover, engine, thrusters
from flows.calibration import load
from gravcal import catalog
from gravcal.calibrations.published_table import observations as published
from gravcal.calibrations.thrusters import estimate, model
from gravcal.discovery import design, driver
from gravcal.errors import GravcalError
from tasks import stage

STUDY = STUDIES["measured"]
TABLE = discover.STUDIES["published_table"]
SHIFTS_S = np.sort((*np.arange(-60.0, 61.0, 5.0), *np.arange(-4.0, 1.5, 0.5)))
LAGS_S = np.arange(-17.5, 18.0, 5.0)


def measured(options) -> list[Figure]:
    """Print what every run finds, and every figure beside what was said of it; or draw the picture."""
    if options.out:
        draw(options.data, Path(options.out))
        return []
    for name, folder, letters in STUDY["runs"]:
        try:
            searched(name, load(name).source(data=options.data / folder, satellite=letters))
        except GravcalError as error:
            say(f"{name} {folder} {letters}: not run, inputs missing: {error}")
    searched(TABLE.name, TABLE)
    day, rows = options.data / STUDY["runs"][-1][1], list(of_table())
    title("figures, and what was said of them")
    grid([("", "here", "said"), *rows, *(first_said(day) if day.exists() else [])])
    return []


def searched(name, source) -> None:
    """Print what a search finds."""
    ref = engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline")
    document = discover.document(ref)
    say(f"{document['calibration']} {document['event']}")
    for one in document["findings"]:
        values = {k: f"{v['value']:.3g} +- {v['sigma']:.2g}" for k, v in one["parameters"].items() if v["sigma"]}
        say(f"  {one['cause']} {one['form']} tied with {one['tied_with']}: {values}")
        gains = one["heldout_gain"]
        say(f"     gain {gains['in_sample_chi2']:.1f}, held out {gains['chi2']:.1f}")
    say(f"  adequate before {document['adequate_before']}, after {document['adequate_after']}")


def of_table():
    """Chi-square of 13 degrees of freedom, evidence, and odds of two more manoeuvres."""
    settings = [catalog.parameters(TABLE.name).with_settings({"variant": one}) for one in STUDY["variants"]]
    tables = [published.observe({}, **TABLE.discovery.settings(TABLE, one)) for one in settings]
    yield "Table 7, chi-square", ", ".join(STUDY["variants"]), ""
    for name, cause, form, said in STUDY["causes"]:
        yield f"  {name}", numbers([left(one, cause, form) for one in tables], ".0f"), said
    weighed = [{row.cause: row.log_odds for row in one.weighed()} for one in tables]
    odds = [np.exp(row["accelerometer.angular_leak"] - row["accelerometer.current_leak"]) for row in weighed]
    yield "  odds of the coupling against a current", numbers(odds, ".0f"), "not weighed"
    for name, more in STUDY["more"].items():
        chi2 = apart(tables[0], more)
        yield f"  two more, {name}", f"{chi2:.0f}, {design.odds(chi2, 2 * np.log(driver.TIED_ODDS)):.2f}", ""


def left(table, cause="", form=""):
    """Chi-square of the printed numbers beside one offset, and the best of the forms of a cause that begin so."""
    (value, sigma, known), beside = table.printed, [np.zeros((len(table.rows), 3, 0))]
    if cause:
        beside = [one.columns for one in table.causes if one.cause == cause and one.form.startswith(form)]
    return min(_misfit((value / sigma)[known], *_whitened(columns, sigma, known)) for columns in beside)


def apart(table, more=()):
    """Least chi-square expected of a current that leaks where yaw acceleration in a_y acts, as large as fitted.

    Manoeuvres of studies.toml are flown beside the table, with errors as those of their kind in it.
    """
    value, sigma, known = table.printed
    kinds = [(row["kind"], row["latitude_class"]) for row in table.rows]
    alike = [[k for k, one in enumerate(kinds) if one == (kind, area)] for kind, area, *_ in more]
    arcs = [published.arc(*one, 1, table.about) for one in kinds]
    arcs += [published.arc(kind, area, heading, table.about, latitude) for kind, area, latitude, heading in more]
    sigma = np.stack([*sigma, *(np.sqrt(np.mean(sigma[own] ** 2, axis=0)) for own in alike)])
    known = np.stack([*known, *(known[own[0]] for own in alike)])
    causes = {one.cause: one for one in published.of_readings("", arcs, table.mean)}
    angular, current = (causes[f"accelerometer.{name}_leak"] for name in ("angular", "current"))
    offset, columns = _whitened(angular.columns, sigma, known)
    y = (value / sigma[: len(value)])[known[: len(value)]]
    both = np.column_stack([offset, columns[:, angular.names.index("y_from_z")]])
    true = both[:, 3] * np.linalg.lstsq(both[: y.size], y)[0][3]
    return min(_misfit(true, offset, one[:, None]) for one in _whitened(current.columns, sigma, known)[1].T)


def _whitened(columns, sigma, known):
    """Rows of the offset (n, 3), and of columns (3, q) m of each manoeuvre (n, q), over their errors."""
    parts = zip([np.eye(3)] * len(columns), columns, strict=True)
    rows = [np.column_stack(part) / s[:, None] for part, s in zip(parts, sigma, strict=True)]
    return np.split(np.stack(rows)[known], [3], axis=1)


def _misfit(observed, *columns):
    """Chi-square that columns leave."""
    beside = np.column_stack(columns)
    return float(np.sum((observed - beside @ np.linalg.lstsq(beside, observed)[0]) ** 2))


def draw(root: Path, folder: Path) -> None:
    """Figure of the page, from a folder of measured data into another."""
    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "gravcal"
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    chosen = catalog.parameters("thrusters")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for letter, color in (("A", "#1f77b4"), ("B", "#d55e00")):
        source = load("thrusters").source(data=root / "grace-2014-01-15", satellite=letter)
        products = {name: stage.read(ref) for name, ref in thrusters.DISCOVERY.baseline(source, chosen).items()}
        records, inertia = model.records(products["align"]), catalog.satellite(letter).settings()["inertia"]
        known = records.camera, model.noise_of(products["noise"]), inertia
        rows = estimate.rows_of(*known, block_s=chosen.block_s, knot_s=chosen.knot_s)
        firings = records.firings
        gains = [fitted(rows, [row.segment.gains(firings.late_by(-s)) for row in rows])[2] for s in SHIFTS_S]
        left.plot(SHIFTS_S, gains, color=color, marker=".", lw=1, label=f"GRACE-{letter}")
        roll = (firings.impulse_b * [1, 0, 0])[:, :, None]
        columns = [[row.segment.after(firings.time + lag, roll) for lag in LAGS_S] for row in rows]
        value, sigma, _ = fitted(rows, [np.concatenate(one, axis=2) for one in columns])
        right.errorbar(LAGS_S + (letter == "B"), value, 3 * sigma, color=color, marker="o", ls="", capsize=3)
    left.set(xlabel="all firings moved by (s)", ylabel="gain in chi-square", yscale="log")
    left.legend(frameon=False)
    right.axhline(0, color="0.6", lw=0.8)
    right.set(xlabel="time from the tag of a firing (s)", ylabel="roll impulse / nominal")
    figure.savefig(folder / "discovery_firings.svg", metadata={"Date": None})


def fitted(rows, columns):
    """Value, sigma and gain of columns (n, 3, q) rad by block."""
    each = [row.less(row.whiten(row.segment.sharp(c))) for row, c in zip(rows, columns, strict=True)]
    normal = sum(one.T @ one for one in each)
    right = sum(one.T @ row.less(row.observed) for row, one in zip(rows, each, strict=True))
    value = np.linalg.solve(normal, right)
    return value, np.sqrt(np.diag(np.linalg.inv(normal))), float(right @ value)
