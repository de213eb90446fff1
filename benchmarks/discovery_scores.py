"""Scores of the study of discovery: silent, named, tied, unknown, parameters, calibration, time."""

from __future__ import annotations

from collections import Counter

import numpy as np
from scipy import stats

from benchmarks.discovery_cases import UNLISTED
from benchmarks.tables import Figure, say

LEVEL = 0.005  # of a test that knows the form
WIDE = 3.0  # times the error of an estimator that knows the form: other forms are open
TIE = 9.0  # expected chi-square below which two causes are alike
FIXED = ("time", "frequency", "phase", "damping")  # not sizes
#: Epochs or frequencies that a test must look at which knows the form but not where.
PLACES = {"accelerometer.bias_step": 385, "accelerometer.stray_tone": 930, "accelerometer.flexible_mode": 930}


def ties(found: dict) -> list[str]:
    """Causes of the catalogue that a finding is tied with.

    Parameters
    ----------
    found : finding
    """
    return [name for name in found["tied_with"] if not name.startswith("unknown:")]


def right(row: dict) -> bool:
    """Whether what was hidden, and nothing else, was named, alone or inside a tied set.

    Parameters
    ----------
    row : of `discovery.one`
    """
    hidden, left = set(row["hidden"]), list(row["found"])
    for name in row["hidden"]:
        fits = [f for f in left if name == f["cause"] or name in f["tied_with"]]
        if fits:
            left.remove(fits[0])
            hidden.discard(name)
    return not hidden and not left


def confusion(rows: list[dict]) -> None:
    """Who was taken for whom, a line a hidden effect.

    Parameters
    ----------
    rows : of `discovery.one`
    """
    table: dict[str, Counter] = {}
    for row in rows:
        if "error" in row:
            table.setdefault(f"{row['kind']} (stopped)", Counter())[row["error"][:60]] += 1
            continue
        hidden = " + ".join(sorted(row["hidden"])) or "nothing"
        named = " + ".join(sorted(_named(f, row) for f in row["found"])) or "nothing"
        table.setdefault(hidden, Counter())[named] += 1
    for hidden, counts in sorted(table.items()):
        say(f"  {hidden}: " + ", ".join(f"{n} x {name}" for name, n in counts.most_common()))


def _named(found, row):
    tied = next((h for h in row["hidden"] if h in found["tied_with"]), None)
    return f"{tied} (tied)" if tied else found["cause"]


def figures(rows: list[dict]) -> list[Figure]:
    """Numbers beside their targets.

    Parameters
    ----------
    rows : of `discovery.one`
    """
    good = [r for r in rows if "error" not in r]
    by = {k: [r for r in good if r["kind"] == k] for k in ("clean", "one", "two", "unlisted", "weak")}
    found = [Figure("cases that stopped with an error", f"{len(rows) - len(good)} of {len(rows)}", "", "0")]
    if by["clean"]:
        found += _clean(by["clean"])
    if by["one"]:
        found += [_share("one hidden effect named", [right(r) for r in by["one"]], 0.95), _parameters(by["one"])]
        found += [_scatter(by["one"]), *_beside_known(by["one"])]
    if by["two"]:
        found.append(_share("two hidden effects named", [right(r) for r in by["two"]], 0.85))
    if by["unlisted"]:
        found += _unlisted(by["unlisted"])
    for kind in ("one", "weak"):
        found += _power(by[kind], kind) if by[kind] else []
    seconds = [r["seconds"] for r in good]
    if seconds:
        found.append(Figure("processor seconds of a discovery, median", f"{np.median(seconds):.1f}", "", "15"))
    return found


def _share(name, hits, target, below=False):
    """Share of cases with its interval."""
    n, k = len(hits), int(sum(hits))
    low, high = stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    met = (k / n <= target) if below else (k / n >= target)
    return Figure(name, f"{k} of {n}", f"{low:.2f} to {high:.2f}", f"{'<=' if below else '>='} {target:g}", met)


def _clean(rows):
    p = np.array([r["p_before"] for r in rows])
    uniform = float(stats.kstest(p, "uniform").pvalue)
    silent = _share("clean events that name something", [bool(r["found"]) for r in rows], 0.02, below=True)
    return [silent, Figure("adequacy uniform on clean events, KS", f"p = {uniform:.3f}", "", "> 0.01", uniform > 0.01)]


def _parameters(rows):
    """Parameters of named effects within three sigma of what was hidden."""
    hits = []
    for row in rows:
        if len(row["found"]) != 1 or row["found"][0]["cause"] != row["hidden"][0] or ties(row["found"][0]):
            continue
        for name, entry in row["found"][0]["parameters"].items():
            true = row["effects"].get(f"{row['hidden'][0]}.{name}", 0.0)
            if entry["value"] is not None and entry["sigma"] and name not in ("damping", "phase"):
                hits.append(abs(entry["value"] - true) < 3 * entry["sigma"])
    return _share("parameters of untied findings within three sigma", hits or [False], 0.97)


def _scatter(rows):
    """Error of the calibration result after the extension, over its own error."""
    errors = np.array([r["error_in_sigma"] for r in rows if right(r) and not ties(r["found"][0])], dtype=float)
    if not errors.size:
        return Figure("error over sigma of the result after the extension, rms", "none")
    rms = np.sqrt(np.nanmean(errors**2, axis=0))
    return Figure("error over sigma of the result after the extension, rms", " ".join(f"{v:.2f}" for v in rms))


def _beside_known(rows):
    """Error of the calibration result over that of an estimator that knows the form, in the errors of the latter.

    Where forms that the data cannot tell apart move the result differently, only the one who knows the form has an
    answer; the error that was given says so. These cases are counted, with their error over that sigma.
    """
    known = [r for r in rows if "known_um" in r]
    wide = [r for r in known if np.max(_sigma(r) / r["known_sigma_um"]) > WIDE]
    told = [r for r in known if r not in wide]
    name = "error of the result over that with the form known"
    if not told:
        return [Figure(name, "none")]
    sizes = np.array([r["known_sigma_um"] for r in told])
    found, best = (
        np.sqrt(np.mean(((np.array([r[n] for r in told]) - [r["true"] for r in told]) / sizes) ** 2, axis=0))
        for n in ("after", "known_um")
    )
    whole = float(np.linalg.norm(found) / np.linalg.norm(best))
    axes = " ".join(f"{v:.2f}" for v in found / best)
    rows = [Figure(name, f"{whole:.2f}", axes, "<= 1.3", whole <= 1.3)]
    if wide:
        rms = np.sqrt(np.mean(np.square([r["error_in_sigma"] for r in wide]), axis=0))
        errors = "error over sigma " + " ".join(f"{v:.2f}" for v in rms)
        rows.append(Figure("  forms that the data leave open move the result", f"{len(wide)} of {len(known)}", errors))
    return rows


def _sigma(row):
    """Error (3,) um that the result was given."""
    return (np.array(row["after"]) - row["true"]) / row["error_in_sigma"]


def _power(rows, kind):
    """Hidden effects noticed, of those that a test of their form at the same level sees."""
    found = []
    for told, limit in (("form", _limit), ("form and all but the size", lambda row: stats.chi2.isf(LEVEL, 1))):  # noqa: ARG005
        seen = [bool(r["found"]) for r in rows if r.get("known_gain", 0.0) > limit(r)] or [False]
        found.append(_share(f"noticed, of those that a test of their {told} sees ({kind})", seen, 0.90))
    return found


def _limit(row):
    """Gain along the true direction at which a test sees an effect that knows its form, not its parameters.

    All sizes are free, and gain one each by chance; an epoch or a frequency is looked for.
    """
    (slug,) = row["hidden"]
    sizes = sum(name.rpartition(".")[2] not in FIXED for name in row["effects"])
    sizes = 2 * sizes if slug == "accelerometer.stray_tone" else sizes  # cosine and sine
    return stats.chi2.isf(LEVEL / PLACES.get(slug, 1), sizes) - (sizes - 1)


def _unlisted(rows):
    noticed = [bool(r["found"]) or r["p_before"] < 0.005 for r in rows]
    apart = [r for r in rows if r["left_by_listed"] >= TIE]
    listed = [any(not f["cause"].startswith("unknown:") for f in r["found"]) for r in apart] or [False]
    alone = [any(ties(f) == f["tied_with"] and not f["cause"].startswith("unknown:") for f in r["found"]) for r in rows]
    alike = Figure(
        "effects in no list that a listed cause imitates on this data", f"{len(rows) - len(apart)} of {len(rows)}"
    )
    driver = []
    for row in apart:
        first = next((f["cause"] for f in row["found"]), "")
        driver.append(any(word in first for word in UNLISTED[row["hidden"][0]][1]) and first.startswith("unknown:"))
    return [
        _share("effects in no list noticed", noticed, 0.95),
        _share("effects in no list given catalogue names only", alone, 0.05, below=True),
        _share("  given a catalogue name, of those that no listed cause imitates", listed, 0.05, below=True),
        _share("right driver channel named first", driver or [False], 0.80),
        alike,
    ]
