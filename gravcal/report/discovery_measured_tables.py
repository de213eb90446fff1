"""Tables of a discovery in measured data: adequacy, findings, what is left, facts."""

from __future__ import annotations

from itertools import zip_longest

from gravcal.report.discovery import scaled
from gravcal.report.pages import table
from gravcal.report.plain import NOT_DETERMINED, probability

#: Ends of the names of facts that are units; a name without one is a count or a ratio.
UNITS = {"_nt": "nT", "_um": "um", "_mm": "mm", "_mrad": "mrad", "_a_m2": "A m2", "_m": "m"}
LONG = 6  # numbers of a fact, above which it is its range
BEST = 10  # causes of the first round that are shown


def adequacy(document: dict) -> dict:
    """Chi-square and probability of every search before and after.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows = [
        [
            label,
            *(f"{one[f'chi2_{w}']:.0f} / {one['dof']}" for w in ("before", "after")),
            *(probability(one[f"p_{w}"]) for w in ("before", "after")),
        ]
        for label, one in document["gain"].items()
    ]
    heads = ["search", "before", "after", "chance before", "chance after"]
    return table("Chi-square / degrees of freedom of each search, and its chance.", heads, rows, words=(0,), wide=True)


def findings(document: dict) -> dict | None:
    """Every finding with what is tied with it, its parameters, its chance and its gains.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows = []
    for one in document["findings"]:
        gains = one["heldout_gain"]
        numbers = [f"{gains['in_sample_chi2']:.0f}", f"{gains['chi2']:.0f}", probability(one["significance"])]
        known = [(n, *scaled(p)) for n, p in one["parameters"].items() if p["value"] is not None]
        lines = zip_longest([f"{one['cause']}{_form(one)}"], one["tied_with"], known, [numbers])
        rows += [
            [one["in"] if i == 0 else None, cause or "", tied or "", *_filled(parameter), *_filled(gained)]
            for i, (cause, tied, parameter, gained) in enumerate(lines)
        ]
    heads = ["search", "cause", "tied with", "parameter", "value", "unit", "chi-square gained", "held out", "chance"]
    caption = "Findings, in the order they were named. Chance is corrected for everything that was tried."
    return table(caption, heads, rows, words=(0, 1, 2, 3, 5), wide=True) if rows else None


def _form(one):
    return f", {one['form']}" if one["form"] else ""


def _filled(cells):
    return list(cells or [""] * 3)


def rivals(document: dict) -> dict | None:
    """What other causes gain in the place of each finding.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows = []
    for one in document["findings"]:
        best = {}
        for rival in one["rivals"]:  # best first; other forms of the cause say nothing else
            if rival["cause"] != one["cause"]:
                best.setdefault(rival["cause"], rival)
        own = {"cause": "", "gain": one["gain"]["chi2"], "dof": one["gain"]["dof"]}
        for i, rival in enumerate([own, *best.values()]):
            head = [one["in"], one["cause"]] if i == 0 else [None, ""]
            rows.append([*head, rival["cause"] or "itself", f"{rival['gain']:.1f}", str(rival["dof"])])
    heads = ["search", "named", "in its place", "chi-square gained", "parameters"]
    caption = "What other causes gain in the place of a finding, the other findings in the model."
    return table(caption, heads, rows, words=(0, 1, 2), wide=True) if rows else None


def hidden(document: dict) -> dict:
    """Causes that these data cannot tell apart, and listed ones of which the baseline leaves next to nothing.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows = [
        [one["in"], one["cause"], f"cannot be told from {other}"]
        for one in document["findings"]
        for other in one["tied_with"]
    ]
    rows += [
        [one["in"], one["cause"], f"free parameters take it up: {100 * one['share_left']:.1f} % of its signal is left"]
        for one in document["indistinguishable_from_calibration"]
    ]
    rows = rows or [["all", "none", "of the listed causes is tied with another or taken up by free parameters"]]
    return table("Limits of these data.", ["search", "cause", "what cannot be said"], rows, words=(0, 1, 2), wide=True)


def unexplained(document: dict) -> dict:
    """What the extended model leaves: worst bands, strongest line and step; only probabilities where it is adequate.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows, level = [], document["provenance"]["settings"]["level"]
    for label, one in document["unexplained"].items():
        head = [label, probability(one["p"]), f"{one['reduced_chi2']:.2f}"]
        left = [_band(w) for w in one["worst"]] + [_line(s) for s in one["lines"]] if one["p"] < level else []
        left = left or [["nothing beyond noise" if one["p"] >= level else "no single band, line or step", "", ""]]
        rows += [[*(head if i == 0 else [None, "", ""]), *what] for i, what in enumerate(left)]
    heads = ["search", "chance", "reduced chi-square", "what is left", "power over noise", "chi-square"]
    return table("What the extended model leaves.", heads, rows, words=(0, 3), wide=True)


def _band(one):
    place = f"{one['channel']}, block {one['block']}, band {one['band'] + 1} of 4 (p {_chance(one['p'])})"
    return [place, f"{one['ratio']:.2f}", ""]


def _chance(p):
    return f"= {probability(p)}" if p >= 0.001 else probability(p)


def _line(one):
    unit = "Hz" if one["kind"] == "line" else "s"
    at = f"{one['at']:.4g}" if one["kind"] == "line" else f"{one['at']:.0f}"
    return [f"{one['kind']} of {one['channel']} at {at} {unit}", "", f"{one['gain']:.1f}"]


def facts(document: dict) -> dict:
    """What each record holds, with units.

    Parameters
    ----------
    document : of a view of measured data
    """
    labels = list(document["facts"])
    names = list(dict.fromkeys(n for one in document["facts"].values() for n in one))
    rows = []
    for name in names:
        end = next((e for e in UNITS if name.endswith(e)), "")
        unit = "s" if name == "seconds" else UNITS.get(end, "")
        cells = [_fact(document["facts"][label].get(name)) for label in labels]
        rows.append([name.removesuffix(end).replace("_", " "), unit, *cells])
    return table("Facts of each record.", ["fact", "unit", *labels], rows, words=(0, 1), wide=True)


def _fact(value):
    """Number, numbers, or the range of many; a mapping with its names."""
    if value is None:
        return NOT_DETERMINED
    if isinstance(value, dict):
        return ", ".join(f"{k}: {_fact(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        if len(value) > LONG:
            return f"{len(value)} from {_fact(min(value))} to {_fact(max(value))}"
        return ", ".join(map(_fact, value))
    return f"{value:.4g}".replace("-", "−") if isinstance(value, float) else str(value)


def tried(document: dict) -> dict:
    """What the best form of each cause gains alone, best first, with the parameter that is seen best.

    Parameters
    ----------
    document : of a view of measured data
    """
    rows = []
    for label, entries in document["tried"].items():
        best = {}
        for one in entries:  # best first
            best.setdefault(one["cause"], one)
        for i, one in enumerate(list(best.values())[:BEST]):
            head = [label if i == 0 else None, f"{one['cause']}{_form(one)}"]
            rows.append([*head, *_clearest(one), f"{one['gain']:.1f}", str(one["dof"])])
    heads = ["search", "cause", "seen best", "value", "unit", "chi-square gained", "parameters"]
    caption = "First round: what each cause gains alone, and of its parameters the one that stands out most."
    return table(caption, heads, rows, words=(0, 1, 2, 4), wide=True)


def _clearest(one):
    """Name, value and unit of the parameter that is most sigmas from zero."""
    keys = ("names", "value", "sigma", "units")
    known = [p for p in zip(*(one[k] for k in keys), strict=True) if p[1] is not None and p[2]]
    if not known:
        return ["", NOT_DETERMINED, ""]
    name, value, sigma, unit = max(known, key=lambda p: abs(p[1]) / p[2])
    return [name, *scaled({"value": value, "sigma": sigma, "unit": unit})]
