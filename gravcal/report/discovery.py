"""What a discovery delivers: the result document, its verdict in words, the page, and the extended model as a file."""

import json
from functools import partial

import numpy as np
import xarray as xr

from gravcal import toml
from gravcal.calibrations.checks import at_most
from gravcal.estimation.records import Reported
from gravcal.report import discovery_figures as figures
from gravcal.report import discovery_words as words
from gravcal.report import documents, pages
from gravcal.report.pages import Figure, Section, Table
from gravcal.report.plain import NOT_DETERMINED, decimals, gps_text, measured, plus_minus, probability, quantity, signed
from gravcal.store import product
from gravcal.store.results import units
from gravcal.store.schemas import VERSION, validate

MOVED = ("change", "change_in_old_sigma")
WIDE = 3.0  # sigma of a result that contradicts nothing


def report(
    found: xr.Dataset, *combined: xr.Dataset, calibration: str, event: str, satellite: str, settings: dict, reported
) -> tuple[xr.Dataset, dict[str, str]]:
    """Report product of a discovery with the probabilities of adequacy, and its files {name: text}.

    Parameters
    ----------
    found : Dataset of kind discovery
    combined : results of the calibration before and after, if it has such
    calibration, event : names
    satellite : letters
    settings : mapping of all parameters
    reported : Reported, what the calibration says of its result and readings
    """
    document, numbers = judged(
        found, *combined, calibration=calibration, event=event, settings=settings, reported=reported
    )
    files = {"discovery.json": json.dumps(document, indent=1, allow_nan=False) + "\n"}
    extended = model_text(numbers, event, settings.get("model", "")) if numbers.get("findings") else ""
    if extended and combined and not settings.get("model"):
        extended += _result_text(numbers["calibration_change"], calibration, found.attrs["records"])
    if extended and "model" in settings:  # a calibration that takes one
        files["model.toml"] = extended
    files["discovery.html"] = page(found, document, satellite, reported)
    names = {"before": "baseline", "after": "extended model"}
    kept = {
        f"p_{w}": ((), numbers.get(f"p_{w}", 1.0), {"units": "1", "long_name": f"probability of the {n} by chance"})
        for w, n in names.items()
    }
    return xr.Dataset(kept, attrs={"status": document["status"], "event": event}), files


def judged(found: xr.Dataset, *combined: xr.Dataset, calibration: str, event: str, settings: dict, reported) -> tuple:
    """Result document of a discovery, judged and valid, and the numbers in it; arguments as of `report`."""
    numbers = json.loads(found.attrs["numbers"])
    if combined and "calibration_change" in numbers:
        numbers = _with_result(numbers, *(reported.result(one) for one in combined))
    label = product.digest(found)[:12]
    provenance = {"settings": settings, "products": {f"{calibration}.discovery": label}}
    status, checks = numbers.pop("status", "delivered"), _of_result(numbers, numbers.pop("expected", {}))
    head = {"schema_version": VERSION, "status": status, "calibration": calibration, "event": event}
    said = {"verdict": {"text": words.verdict(numbers)}}
    document = head | {"kind": "discovery"} | said | numbers | {"provenance": provenance}
    document = documents.judged(document, (found, *combined), checks)
    validate(document, "discovery")
    return document, numbers


def _of_result(numbers, expected):
    """Checks of the delivered result against what is known of it beforehand; its error may be wider than that."""
    change, checks = numbers.get("calibration_change", {}), []
    names = change.get("names", ()) if expected else ()
    rows = zip(*(change[n] for n in ("after", "sigma_after")), units(change), strict=True) if names else ()
    for name, (value, sigma, unit) in zip(names, rows, strict=False):
        if name in expected and value is not None and sigma is not None:
            known, limit = expected[name]
            checks.append(at_most(f"{name} against the catalogue", abs(value - known), max(limit, WIDE * sigma), unit))
    return checks


def _with_result(numbers, before, after):
    """Numbers with the change of the calibration result as the calibration itself finds it, as of `Reported.result`."""
    change = numbers["calibration_change"]
    extra = np.array(change["covariance_of_findings"], dtype=float)
    (name, old, covariance), (_, new, other) = before, after
    new = new + np.array(change["correction"], dtype=float)
    sigma = [np.sqrt(np.diag(c)) for c in (covariance, other + extra)]
    found = {"before": old, "sigma_before": sigma[0], "after": new, "sigma_after": sigma[1]}
    found |= {"change": new - old, "change_in_old_sigma": (new - old) / sigma[0]}
    plain = {k: [float(v) if np.isfinite(v) else None for v in values] for k, values in found.items()}
    return numbers | {"calibration_change": change | {"variant": name, "joint_fit": change} | plain}


def page(found: xr.Dataset, document: dict, satellite: str, reported: Reported) -> str:
    """Page of a discovery; arguments as of `report`, with its result document."""
    level = document.get("level", "")
    return pages.page(
        document,
        sections(found, document, reported) if "findings" in document else [],
        {"discovery": found},
        heading="What the model gets wrong",
        subtitle=f"satellite {satellite}, level {level} for everything tried together",
    )


def sections(found: xr.Dataset, document: dict, reported: Reported) -> list[Section]:
    """Sections of the page that hold something."""
    here = ("discovery",)
    excess = [Figure(figures.power, here, POWER), Figure(figures.spectra, here, SPECTRA)]
    hidden = [unobservable_table(document), limits_table(document)]
    made = [
        Section("What was found", figures=drawings(found, document, reported)),
        Section("The cause", [findings_table(document), tied_table(document), weighed_table(document)], notes=[CAUSE]),
        Section("The result", [change_table(document), gain_table(document)], notes=[GAIN]),
        Section("What this event could not have shown", hidden, notes=not_shown(document)),
        Section("What is left", [outlier_table(document)], excess, notes=[f"{WRONG} {reported.note}".strip()]),
        Section("What was tried", [tried_table(document)]),
    ]
    numbers = range(-1, len(document["findings"]))
    drawn, named = any(figures.shown(found, number) for number in numbers), bool(document["findings"])
    return [one for one, wanted in zip(made, (drawn, named, *[True] * 4), strict=True) if wanted]


def drawings(found: xr.Dataset, document: dict, reported: Reported) -> list[Figure]:
    """A figure for each finding, or that of the least likely band."""
    made = []
    for number in range(len(document["findings"])) if document["findings"] else (-1,):
        about = {"number": number, "period": figures.fold(found, number)}
        said = figures.caption(found, **about, readings_of=reported.readings)
        made.append(Figure(partial(figures.reading, **about), ("discovery",), said))
    return made


def not_shown(document: dict) -> list[str]:
    """Notes on what would have stayed unseen: by the detection limits where they were made, else by the search."""
    if "limits" not in document:
        hidden = document["indistinguishable_from_calibration"]
        return [UNOBSERVABLE if hidden else NOTHING_HIDES, NO_LIMITS]
    found = {one["cause"] for one in document["findings"]}  # free beside the others, so that nothing more of it shows
    never = [_named(one) for one in document["limits"] if one["size"] is None and one["cause"] not in found]
    large = [_named(one) for one in document["limits"] if (one["size"] or 0) > (one["prior"] or np.inf)]
    rows = ("At no size that was tried", never), ("Only if larger than is plausible", large)
    return [f"{said}: {'; '.join(names)}." for said, names in rows if names] + [LIMITS]


def _named(one):
    """Effect and parameter of a limit."""
    return f"{words.title(one['cause'])} {one['parameter'].replace('_', ' ')}"


def outlier_table(numbers: dict) -> Table | None:
    """Isolated samples that were left out before the search."""
    rows = [
        [one["block"], f"{one['channel']} {one['axis']}", gps_text(one["time"], 1), f"{one['time']:.1f}"]
        + [signed(one["sigma"], 0)]
        for one in numbers.get("outliers", [])
    ]
    heads = ["block", "channel", "epoch, GPS time", "GPS s", "residual over its error"]
    caption = "Single samples that neither noise nor a listed effect explains, left out before the search."
    return Table(caption, heads, rows, words=(0, 1)) if rows else None


def findings_table(numbers: dict) -> Table | None:
    """Every finding with its parameters, its significance and what it gained on data left out."""
    rows = []
    for one in numbers["findings"]:
        held = f"{one['heldout_gain']['chi2']:.0f} ({one['heldout']})"
        gained = f"{one['heldout_gain']['in_sample_chi2']:.0f}", held, probability(one["significance"])
        rows.append([words.title(one["cause"]), one["form"] or "all parameters", *gained, "", ""])
        for name, parameter in one["parameters"].items():
            if parameter["value"] is not None:
                rows.append([None, name, "", "", "", *measured(*(parameter[n] for n in ("value", "sigma", "unit")))])
    heads = ["cause", "form, parameter", "chi-square gained", "held out", "chance", "value", "unit"]
    caption = "Findings, in the order they were named. Chance is corrected for everything that was tried."
    return Table(caption, heads, rows, words=(0, 1, 5, 6), wide=True) if rows else None


def tied_table(numbers: dict) -> Table | None:
    """Causes that this data cannot tell apart, and what would."""
    rows = []
    for one in numbers["findings"]:
        for other in one["separation"]:
            needed = other["events_needed"]
            more = "no such data would" if needed is None else f"{needed} events like this one"
            best = other["best_block"] or NOT_DETERMINED
            pair = words.title(one["cause"]), words.title(other["cause"])
            rows.append([*pair, f"{other['expected_chi2']:.1f}", best, more])
        for other in one.get("imitators", []):
            pair = words.title(one["cause"]), f"{words.title(other['cause'])}: {other['form']}"
            rows.append([*pair, f"{other['expected_chi2']:.1f}", NOT_DETERMINED, ""])
    heads = ["named", "fits as well", "expected chi-square between them", "tells most", "to tell them apart"]
    caption = "Causes that this data does not tell apart."
    return Table(caption, heads, rows, words=(0, 1, 3, 4), wide=True) if rows else None


def weighed_table(numbers: dict) -> Table | None:
    """Evidence of every cause in its best form, where it was weighed."""
    rows = [[words.title(r["cause"]), r["form"], f"{r['log_odds']:.1f}"] for r in numbers.get("weighed", [])]
    caption = (
        "Evidence: logarithm of the odds against none of them; 4.6 apart are odds of 100, below which two are tied."
    )
    return Table(caption, ["cause", "best form", "log odds"], rows, words=(0, 1)) if rows else None


def change_table(numbers: dict) -> Table:
    """Calibration before and after the extension."""
    one = numbers["calibration_change"]
    rows = []
    for k, (name, unit) in enumerate(zip(one["names"], units(one), strict=True)):
        pair = [plus_minus(one[w][k], one[f"sigma_{w}"][k]) for w in ("before", "after")]
        digits = decimals(one["sigma_after"][k]), 1
        moved = [
            NOT_DETERMINED if one[w][k] is None else signed(one[w][k], d) for w, d in zip(MOVED, digits, strict=True)
        ]
        rows.append([name, *pair, unit, *moved])
    heads = ["parameter", "before", "after", "unit", "change", "change over old error"]
    caption = f"Calibration result ({one['variant']}); the error after holds that of the findings."
    caption += f" What moves is given at {gps_text(one['epoch'])}." if "epoch" in one else ""
    return Table(caption, heads, rows, words=(0, 3), wide=True)


def gain_table(numbers: dict) -> Table:
    """Residual of each channel and chi-square before and after."""
    gain = numbers["gain"]
    rows = [
        [name, f"{before:.3f}", f"{gain['rms_after'][name]:.3f}"]
        for name, before in gain["rms_before"].items()
        if before is not None
    ]
    pair = [f"{gain[f'chi2_{w}']:.0f} / {gain[f'dof_{w}']}" for w in ("before", "after")]
    rows.append(["chi-square / degrees of freedom", *pair])
    rows.append(["held-out chi-square gained", "", f"{gain['heldout_chi2']:.0f}"])
    rows.append(["change of BIC, negative is better", "", signed(gain["bic_change"], 0)])
    heads = ["rms of the whitened residual", "before", "after"]
    return Table("Gain. A channel that is described to its noise has rms 1.", heads, rows, wide=True)


def unobservable_table(numbers: dict) -> Table | None:
    """Causes that look like the calibration itself."""
    rows, change = [], numbers["calibration_change"]
    about = list(zip(change["names"], change["sigma_before"], units(change), strict=True))
    for one in sorted(numbers["indistinguishable_from_calibration"], key=lambda r: -r["bias_in_sigma"])[:12]:
        where = ", ".join(f"{signed(v, 2)} {n}" for n, v in one["direction"].items())
        drag = one.get("drag_bias_m_s2")
        priced = one.get("bias_in_error") or [None] * len(about)
        each = zip(one["bias"], priced, about, strict=True)
        each = sorted(each, key=lambda row: -abs(row[0]) / (row[2][1] or np.inf))[:3]
        moved = ", ".join(f"{name} {signed(v, decimals(max(abs(v), 1e-3)))} {unit}" for v, _, (name, _, unit) in each)
        said = f"drag {quantity(max(drag), None, 'm s-2')}" if drag else moved
        held = ", ".join(f"{v:.2g} {unit}" for _, v, (_, _, unit) in each if v is not None)
        rows.append([words.title(one["cause"]), where, f"{one['signal_to_noise']:.1f}", said, held])
    heads = ["cause", "direction, in units of a plausible size", "signal to noise", "moves", "in the error"]
    caption = (
        "Causes of a plausible size that would move the result without being seen; the largest three moves. The error "
        "holds of each cause what those of its directions that are seen leave possible."
    )
    return Table(caption, heads, rows, words=(0, 1, 3, 4), wide=True) if rows else None


def limits_table(numbers: dict) -> Table | None:
    """Size from which each effect would have been named, what it would be taken for, and what it does when missed."""
    rows = []
    for one in numbers.get("limits", ()):
        size = NOT_DETERMINED if one["size"] is None else quantity(one["size"], None, one["unit"])
        share = f"{one['size'] / one['prior']:.2g}" if one["size"] is not None and one["prior"] else NOT_DETERMINED
        checked = {True: "yes", False: "no", None: ""}[one["confirmed"]]
        move = NOT_DETERMINED if one["bias_in_sigma"] is None else f"{one['bias_in_sigma']:.2g}"
        name = " ".join(part for part in (one["parameter"], one["form"]) if part)
        taken = ", ".join(map(words.title, one["confused_with"]))
        rows.append([words.title(one["cause"]), name, size, share, checked, move, taken])
    heads = ["effect", "parameter", "named from", "over plausible size", "confirmed", "moves result", "taken for"]
    caption = (
        "Just missed, or of plausible size where it is not seen, an effect moves the result by so many sigma. What was "
        "found is free beside all others and has no limit."
    )
    return Table(caption, heads, rows, words=(0, 1, 4, 6), wide=True) if rows else None


def tried_table(numbers: dict) -> Table:
    """What else was tried in the first round, best first."""
    rows = [
        [words.title(one["cause"]), one["form"] or "all parameters", f"{one['chi2']:.1f}", str(one["parameters"]),
         probability(one["significance"])]
        for one in numbers["tried"][:15]
    ]  # fmt: skip
    heads = ["cause", "form", "chi-square gained", "parameters", "chance"]
    return Table("First round: the best form of each cause.", heads, rows, words=(0, 1), wide=True)


def model_text(numbers: dict, event: str, given: str = "") -> str:
    """Extended model as TOML, as `--model` reads it; empty if no cause has a parameter that is determined.

    Parameters
    ----------
    numbers : of the document
    event : that it was found in
    given : entries of the model that the search began with, JSON text, which the extended one holds too; "" for none
    """
    comment, rows = f"Found by gravcal discover in {event}; give it to gravcal run with --model.", []
    for one in [*json.loads(given or "[]"), *numbers["findings"]]:
        if not one.get("adopted", True):
            continue
        known = {n: p for n, p in one.get("model", one["parameters"]).items() if p["value"] is not None}
        if not known:
            comment += f"\n{one['cause']} has no parameter that the data determine, so that it is not taken out."
            continue
        row = {"cause": one["cause"], "form": one["form"], "tied_with": one.get("tied_with", []), "parameters": {}}
        for name, parameter in known.items():
            related = {n: r for n, r in parameter.get("correlation", {}).items() if n in known}
            row["parameters"][name] = {n: parameter.get(n) for n in ("value", "sigma", "unit")} | {
                "correlation": related
            }
        rows.append(row | {name: one.get(name) or None for name in ("waves", "leads")})
    return toml.text({"event": event, "effect": rows}, comment) if rows else ""


def _result_text(change, calibration, records):
    """What the search adds to the result of the calibration from the records that it was made in, as TOML."""
    if not np.all(np.isfinite(np.array(change["covariance_of_findings"], dtype=float))):
        return ""
    row = {"calibration": calibration, "records": records, "unit": change["unit"]}
    row |= {"correction": change["correction"], "covariance": change["covariance_of_findings"]}
    return toml.text({"result": row})


WRONG = (
    "Every measured channel is predicted by the current model; what is left is divided by the noise as measured "
    "outside the manoeuvres, so that a channel described to its noise has power 1 everywhere. The probability in the "
    "verdict is that of the most unusual number among all channels, manoeuvres, bands, candidates, lines and steps, "
    "set against noise drawn through the same fit."
)
CAUSE = (
    "For each cause the gain in chi-square when it is added with all baseline parameters free. A cause is named only "
    "if its chance, corrected for everything that was tried, is below the level, and if it also gains on data that it "
    "was not fitted to: manoeuvres left out one by one, or every second stretch of time for what happens in one."
)
GAIN = (
    "The result is estimated anew with the findings free, and averaged over what is tied with them; its error contains "
    "theirs, and what a search cannot see of the catalogue at the price of its priors."
)
UNOBSERVABLE = (
    "These causes look like the calibration parameters themselves; only other data or ground tests can exclude them."
)
NOTHING_HIDES = "No listed effect of plausible size could have moved the result without being seen."
NO_LIMITS = (
    "From which size on each effect would have been named is looked for on request (discover with its option limits)."
)
LIMITS = (
    "Every effect of the catalogue was added to what the found model leaves of these very records, each parameter by "
    "itself and with either sign, at signal-to-noise ratios from 3 to 60. Named means alone or in a tied set of three "
    "at most. Sizes are scored with the products of the search; where a row says so, the search itself was asked at "
    "the limit and, if it did not name it, up to 1.6 times above."
)
POWER = "Power of the residual over that of noise; four bands a manoeuvre."
SPECTRA = "Mean over manoeuvres and axes; the dashed line is noise."
