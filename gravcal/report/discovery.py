"""Result document of a discovery, its verdict in words, its tables, and the extended model as a file."""

from __future__ import annotations

import json

from gravcal.report.documents import foreword
from gravcal.report.pages import table
from gravcal.report.plain import NOT_DETERMINED, plus_minus, probability, signed
from gravcal.store.schemas import VERSION

MOVED = ("change", "change_in_old_sigma")


def document(numbers: dict, calibration: str, event: str, provenance: dict) -> dict:
    """Result document.

    Parameters
    ----------
    numbers : of `gravcal.discovery.product.summary`
    calibration, event : names
    provenance : mapping
    """
    head = {"schema_version": VERSION, "status": numbers.get("status", "delivered")}
    head |= {"calibration": calibration, "event": event, "kind": "discovery"}
    return head | {k: v for k, v in numbers.items() if k != "status"} | {"provenance": provenance}


def verdict(document: dict) -> str:
    """What was found, in a sentence or two, the origin of the data first.

    Parameters
    ----------
    document : of `document`, judged
    """
    return foreword(document["origin"]) + _said(document)


def _said(numbers):
    """What was found."""
    if numbers.get("status") == "no_manoeuvre":
        return "No calibration manoeuvre is in this data, so there is nothing that a model could get wrong."
    found = numbers["findings"]
    chance = _chance(numbers["p_before"])
    if not found and numbers["adequate_before"]:
        return f"The model describes the data to their noise ({chance}); nothing is named."
    if not found:
        return f"The model is not adequate ({chance}), but no cause that was tried passes; see what is left."
    named = _by_search(found, numbers["gain"])
    after = "describes the data to their noise" if numbers["adequate_after"] else "still leaves more than noise"
    return f"Found{named}. The extended model {after} ({_chance(numbers['p_after'])})."


def _by_search(found, searches):
    """Names of the findings; where there is more than one search, each with those it found the same in."""
    if "in" not in found[0] or len(searches) == 1:
        return ": " + "; ".join(_named(one) for one in found)
    groups = {}
    for label in dict.fromkeys(one["in"] for one in found):
        names = "; ".join(_named(one) for one in found if one["in"] == label)
        groups.setdefault(names, []).append(label)
    return " in " + ". In ".join(f"{', '.join(labels)}: {names}" for names, labels in groups.items())


def _chance(p):
    text = probability(p)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def _named(one):
    label = one["cause"] if one["in_catalogue"] else f"unknown effect, follows {one['cause'].removeprefix('unknown:')}"
    listed = [name for name in one["tied_with"] if not name.startswith("unknown:")]
    drivers = [name.removeprefix("unknown:") for name in one["tied_with"] if name.startswith("unknown:")]
    others = [*listed, *([f"an effect in no list that follows {' or '.join(drivers)}"] if drivers else [])]
    return f"{label} (or {', '.join(others)}: this data cannot tell)" if others else label


def findings_table(numbers: dict) -> dict | None:
    """Every finding with its parameters, its significance and what it gained on data left out.

    Parameters
    ----------
    numbers : of the document
    """
    rows = []
    for one in numbers["findings"]:
        held = f"{one['heldout_gain']['chi2']:.0f} ({one['heldout']})"
        head = [one["cause"], one["form"] or "all parameters", f"{one['heldout_gain']['in_sample_chi2']:.0f}", held]
        rows.append([*head, probability(one["significance"]), "", ""])
        for name, parameter in one["parameters"].items():
            if parameter["value"] is not None:
                value, unit = scaled(parameter)
                rows.append(["", name, "", "", "", value, unit])
    heads = ["cause", "form, parameter", "chi-square gained", "held out", "chance", "value", "unit"]
    caption = "Findings, in the order they were named. Chance is corrected for everything that was tried."
    return table(caption, heads, rows, words=(0, 1, 5, 6), wide=True) if rows else None


def scaled(parameter: dict) -> tuple[str, str]:
    """Value with its error in a power of ten that suits it, and the unit with that power.

    Parameters
    ----------
    parameter : {"value", "sigma", "unit"}
    """
    value, sigma = parameter["value"], parameter["sigma"]
    if value is None or sigma is None or sigma == 0:
        return (NOT_DETERMINED if value is None else f"{value:.4g}"), parameter["unit"]
    sharp = abs(value) > 1 and sigma < 1e-5 * abs(value)  # an epoch
    power = 0 if sharp else _power(max(abs(value), sigma))
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    unit = parameter["unit"] if power == 0 else f"10{raised} {parameter['unit']}".removesuffix(" 1")
    return plus_minus(value / 10**power, sigma / 10**power), unit


def _power(size):
    import math

    power = 3 * math.floor(math.log10(size) / 3) if size > 0 else 0
    return 0 if power in (0, 3) else power


def tied_table(numbers: dict) -> dict | None:
    """Causes that this data cannot tell apart, and what would.

    Parameters
    ----------
    numbers : of the document
    """
    rows = []
    for one in numbers["findings"]:
        for other in one["separation"]:
            needed = other["events_needed"]
            more = "no such data would" if needed is None else f"{needed} events like this one"
            best = other["best_block"] or NOT_DETERMINED
            rows.append([one["cause"], other["cause"], f"{other['expected_chi2']:.1f}", best, more])
        for other in one.get("imitators", []):
            name = f"an effect in no list that follows {other['cause'].removeprefix('unknown:')}: {other['form']}"
            rows.append([one["cause"], name, f"{other['expected_chi2']:.1f}", NOT_DETERMINED, ""])
    heads = ["named", "fits as well", "expected chi-square between them", "tells most", "to tell them apart"]
    caption = "Causes that this data does not tell apart."
    return table(caption, heads, rows, words=(0, 1, 3, 4), wide=True) if rows else None


def change_table(numbers: dict) -> dict:
    """Calibration before and after the extension.

    Parameters
    ----------
    numbers : of the document
    """
    one = numbers["calibration_change"]
    rows = []
    for k, name in enumerate(one["names"]):
        pair = [plus_minus(one[w][k], one[f"sigma_{w}"][k]) for w in ("before", "after")]
        digits = _digits(one["sigma_after"][k]), 1
        moved = [
            NOT_DETERMINED if one[w][k] is None else signed(one[w][k], d) for w, d in zip(MOVED, digits, strict=True)
        ]
        rows.append([name, *pair, *moved])
    heads = ["parameter", "before", "after", "change", "change over old error"]
    caption = f"Calibration result in {one['unit']} ({one['variant']}); the error after holds that of the findings."
    return table(caption, heads, rows, wide=True)


def _digits(sigma):
    """Decimals that show a tenth of an error."""
    import math

    return 1 if not sigma else max(1, 1 - math.floor(math.log10(sigma)))


def gain_table(numbers: dict) -> dict:
    """Residual of each channel and chi-square before and after.

    Parameters
    ----------
    numbers : of the document
    """
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
    return table("Gain. A channel that is described to its noise has rms 1.", heads, rows, wide=True)


def hidden_table(numbers: dict) -> dict | None:
    """Causes that look like the calibration itself.

    Parameters
    ----------
    numbers : of the document
    """
    rows, unit = [], numbers["calibration_change"]["unit"]
    for one in sorted(numbers["indistinguishable_from_calibration"], key=lambda r: -r["bias_in_sigma"])[:12]:
        where = ", ".join(f"{signed(v, 2)} {n}" for n, v in one["direction"].items())
        largest = max(abs(v) for v in one["bias"])
        bias = ", ".join(signed(v, _digits(largest / 10)) for v in one["bias"])
        drag = one.get("drag_bias_m_s2")
        said = f"drag {max(drag):.1e} m s-2" if drag else f"{bias} {unit}"
        rows.append([one["cause"], where, f"{one['signal_to_noise']:.1f}", said])
    names = ", ".join(numbers["calibration_change"]["names"])
    heads = ["cause", "direction, in units of a plausible size", "signal to noise", f"bias of {names}"]
    caption = "Causes of a plausible size that would move the result without being seen."
    return table(caption, heads, rows, words=(0, 1, 3), wide=True) if rows else None


def tried_table(numbers: dict) -> dict:
    """What else was tried in the first round, best first.

    Parameters
    ----------
    numbers : of the document
    """
    rows = [
        [one["cause"], one["form"] or "all parameters", f"{one['chi2']:.1f}", str(one["parameters"]),
         probability(one["significance"])]
        for one in numbers["tried"][:15]
    ]  # fmt: skip
    heads = ["cause", "form", "chi-square gained", "parameters", "chance"]
    return table("First round: the best form of each cause.", heads, rows, words=(0, 1), wide=True)


def model_text(numbers: dict, event: str, given: str = "") -> str:
    """Extended model as TOML, as `--model` reads it; empty if no cause has a parameter that is determined.

    Parameters
    ----------
    numbers : of the document
    event : that it was found in
    given : entries of the model that the search began with, JSON text, which the extended one holds too; "" for none
    """
    lines, sized = [f"# Found by gravcal discover in {event}; give it to gravcal run with --model."], 0
    lines.append(f"event = {_text(event)}")
    for one in [*json.loads(given or "[]"), *numbers["findings"]]:
        known = {n: p for n, p in one.get("model", one["parameters"]).items() if p["value"] is not None}
        sized += bool(known)
        if not known:
            lines += ["", f"# {one['cause']} has no parameter that the data determine, so that it is not taken out."]
            continue
        lines += ["", "[[effect]]", f"cause = {_text(one['cause'])}", f"form = {_text(one['form'])}"]
        lines.append(f"tied_with = {json.dumps(one.get('tied_with', []))}")
        lines += [_parameter_line(name, parameter, known) for name, parameter in known.items()]
    return "\n".join(lines) + "\n" if sized else ""


def _parameter_line(name, parameter, known):
    """One parameter with what is known of its error."""
    words = [f"value = {parameter['value']!r}"]
    if parameter.get("sigma") is not None:
        words.append(f"sigma = {parameter['sigma']!r}")
    words.append(f"unit = {_text(parameter.get('unit', ''))}")
    related = [f"{n} = {r!r}" for n, r in parameter.get("correlation", {}).items() if n in known]
    if related:
        words.append(f"correlation = {{ {', '.join(related)} }}")
    return f"parameters.{name} = {{ {', '.join(words)} }}"


def _text(value):
    return json.dumps(value, ensure_ascii=False)
