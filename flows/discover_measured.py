"""Discovery in printed numbers: the published table of the offset.

`VIEWS` maps a name to a callable (data, satellite, date, settings) that gives a document of the discovery form; the
view of each lives in `gravcal/calibrations`, the search in `gravcal/discovery`.
"""

from __future__ import annotations

import numpy as np

from flows import measured_table
from gravcal import catalog
from gravcal.discovery import attribution, product
from gravcal.discovery.blocks import Block, Candidate
from gravcal.discovery.rounds import Choice, baseline_of, search
from gravcal.store.schemas import VERSION

SEED = 20140115  # of the draws of the adequacy test
#: Share of its size that a cause keeps beside the baseline when the data can still speak of it.
HIDDEN = 0.02


def discover(name: str, data=None, satellite=None, date=None, settings=None) -> dict:
    """Document of one view.

    Parameters
    ----------
    name : key of VIEWS
    data : folder of Level-1 files; None for the published table
    satellite, date : which of the folder
    settings : {parameter: text or value}
    """
    return discovered(name, data, satellite, date, settings)[0]


def discovered(name: str, data=None, satellite=None, date=None, settings=None) -> tuple[dict, dict]:
    """Document of one view and what its page draws.

    Parameters
    ----------
    name, data, satellite, date, settings : as of `discover`

    Returns
    -------
    document : dict
    found : {label of the search: Dataset of kind discovery}
    """
    chosen = catalog.parameters("discover_measured").with_settings(settings or {})
    prepared = VIEWS[name](data, satellite, date, chosen)
    if "runs" not in prepared:
        prepared |= {"runs": [(prepared.pop("label"), prepared.pop("blocks"), prepared.pop("candidates"))]}
    found = [(label, searched(blocks, candidates, chosen)) for label, blocks, candidates in prepared.pop("runs")]
    drawn = {label: product.dataset(result, {}, ()) for label, result in found}
    return document(name, prepared, found, chosen), drawn


def searched(blocks: list[dict], candidates: list[dict], chosen):
    """Result of the search over the records of a view.

    Parameters
    ----------
    blocks, candidates : fields of Block and Candidate
    chosen : Parameters
    """
    choice = Choice(chosen.level, chosen.tie, chosen.rounds, "unknown:step", {})
    rows = [Block(**b) for b in blocks], [Candidate(**c) for c in candidates]
    return search(*rows, choice, np.random.default_rng(SEED))


def document(name, prepared, found, chosen) -> dict:
    """Document of the discovery form from the searches of a view, one a satellite.

    Parameters
    ----------
    name : of the view
    prepared : {"calibration", "event", "origin", "files", "said", "facts", "notes"}, and "largest_sigma" {cause: sigma
        above which a parameter is not determined}
    found : list of (label, Result)
    chosen : Parameters
    """
    from gravcal import __version__

    results, limits = [r for _, r in found], (chosen.level, chosen.tie)
    largest = prepared.get("largest_sigma", {})
    used = {n: e.value for n, e in chosen.entries.items() if {"search", name} & set(e.stages)}
    return {
        "schema_version": VERSION,
        "status": "delivered",
        "calibration": prepared["calibration"],
        "view": name,
        "event": prepared["event"],
        "origin": prepared["origin"],
        "configuration": "operational",
        "checks": [],
        "provenance": {"gravcal": __version__, "files": prepared["files"], "settings": used, "seed": SEED},
        "adequate_before": all(r.before.p >= chosen.level for r in results),
        "adequate_after": all(r.after.p >= chosen.level for r in results),
        "p_before": min(float(r.before.p) for r in results),
        "p_after": min(float(r.after.p) for r in results),
        "findings": [
            undetermined(finding(r, k, label, *limits), largest) for label, r in found for k in range(len(r.findings))
        ],
        "indistinguishable_from_calibration": [h for label, r in found for h in hidden(r, label)],
        "unexplained": {label: _unexplained(r) for label, r in found},
        "calibration_change": {"applies": False, "reason": prepared["said"]},
        "gain": {label: _gain(r) for label, r in found},
        "tried": {label: _tried(r, largest) for label, r in found},
        "facts": prepared["facts"],
        "notes": prepared["notes"],
    }


def finding(result, position: int, label: str, level: float, tie: float) -> dict:
    """One accepted cause in the form of the document; tied are also causes that gain as much on these data.

    Parameters
    ----------
    result : Result
    position : of the finding
    label : which search
    level : family-wise; tie : of chi-square
    """
    one, rivals = result.findings[position], _rivals(result, position)
    equal = {r["cause"] for r in rivals if r["score"] > one.gain - 2 * one.dof - tie} - {one.cause}
    plain = lambda v: float(v) if np.isfinite(v) else None  # noqa: E731
    rows = zip(one.names, one.units, one.value, one.sigma, strict=True)
    return {
        "cause": one.cause,
        "form": one.form,
        "in": label,
        "tied_with": sorted({*one.tied, *(other["cause"] for other in one.imitators), *equal}),
        "in_catalogue": not one.cause.startswith("unknown:"),
        "parameters": {n: {"value": plain(v), "sigma": plain(s), "unit": u} for n, u, v, s in rows},
        "significance": float(one.significance),
        "gain": {"chi2": float(one.gain), "dof": int(one.dof)},
        "heldout_gain": {"chi2": float(one.heldout), "in_sample_chi2": float(one.gain)},
        "rivals": rivals,
        "level": level,
        "heldout": "blocks",
    }


def undetermined(finding: dict, largest: dict) -> dict:
    """Finding whose parameters are null where their sigma says that this data does not determine them.

    Parameters
    ----------
    finding : of `finding`
    largest : {cause: largest sigma}
    """
    limit = largest.get(finding["cause"], np.inf)
    for one in finding["parameters"].values():
        if one["sigma"] is not None and one["sigma"] > limit:
            one |= {"value": None, "sigma": None}
    return finding


def _rivals(result, position):
    """What other causes gain in the place of a finding, the other findings in the model."""
    problem, others = result.problem, [f.index for k, f in enumerate(result.findings) if k != position]
    gram = attribution.projected(problem.gram.sum(axis=0), baseline_of(problem, others))
    rows = []
    for index, (candidate, place) in enumerate(zip(problem.candidates, problem.places, strict=True)):
        ratio = attribution.ratio(gram, place, problem.size)
        if index != result.findings[position].index and index not in others and ratio.dof:
            score = float(ratio.gain - 2 * ratio.dof)
            rows.append({"cause": candidate.cause, "gain": float(ratio.gain), "dof": int(ratio.dof), "score": score})
    return sorted(rows, key=lambda r: -r["score"])[:5]


def hidden(result, label: str) -> list[dict]:
    """Listed causes of which the baseline leaves next to nothing, with the share that is left.

    Parameters
    ----------
    result : Result
    label : which search
    """
    problem, rows = result.problem, []
    left = np.diag(attribution.projected(problem.gram.sum(axis=0), baseline_of(problem, ())))
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        size = problem.size[place]
        if candidate.listed and np.any(size > 0):
            share = float(np.max(np.sqrt(np.clip(left[place], 0, None)) / np.where(size > 0, size, np.inf)))
            if share < HIDDEN:
                rows.append({"cause": candidate.cause, "in": label, "share_left": share})
    return rows


def _unexplained(result):
    bands = [r for r in result.after.rows if r["ratio"] > 0]
    worst = sorted(bands, key=lambda r: r["p"])[:3]
    scans = [(s, int(np.argmax(s.gain[:, 0]))) for s in result.after.scans]
    lines = [
        {"kind": s.kind, "channel": s.channel, "at": float(s.at[k]), "gain": float(s.gain[k, 0])} for s, k in scans
    ]
    numbers = {"p": float(result.after.p), "reduced_chi2": result.chi2[1] / max(result.dof, 1)}
    return numbers | {"worst": worst, "lines": lines}


def _gain(result):
    before, after = result.chi2
    numbers = {"chi2_before": before, "chi2_after": after, "dof": result.dof}
    return numbers | {"p_before": float(result.before.p), "p_after": float(result.after.p)}


def _tried(result, largest):
    """What every candidate gains alone beside the baseline, best first, with its value and what error it would have."""
    problem, rows = result.problem, []
    gram = attribution.projected(problem.gram.sum(axis=0), baseline_of(problem, ()))
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        one = attribution.ratio(gram, place, problem.size)
        sigma = np.sqrt(np.diag(one.covariance))
        known = (sigma > 0) & (sigma <= largest.get(candidate.cause, np.inf))
        words = {"cause": candidate.cause, "form": candidate.form, "names": candidate.names, "units": candidate.units}
        numbers = {"gain": float(one.gain), "dof": int(one.dof)}
        pairs = {"value": _null(one.value, known), "sigma": _null(sigma, known)}
        rows.append(words | numbers | pairs)
    return sorted(rows, key=lambda r: 2 * r["dof"] - r["gain"])


def _null(values, known):
    return [float(v) if k else None for v, k in zip(values, known, strict=True)]


VIEWS = {
    "published_table": measured_table.prepare,
}
