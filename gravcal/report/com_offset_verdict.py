"""Which estimate is adopted, what it says about the limits, and whether the estimates agree."""

import numpy as np

from gravcal.calibrations.checks import at_least, at_most, largest
from gravcal.report.plain import AXES, chi_square_test

RULE = (
    "acc_calibrated if it determines all three components, else mtq, else whichever determines most with the "
    "smallest total error: the angular accelerometer follows the true motion between the torquer samples, its scale "
    "comes from the torquers, and the total error holds that of inertia and dipole per current."
)
PREFERRED = ("acc_calibrated", "mtq")
CONFIDENCE = 2.0  # standard deviations between a value and a limit for a clear answer


def adopted(variants):
    """The estimate that is handed on.

    Parameters
    ----------
    variants : blocks of the document by name

    Returns
    -------
    adopted : {"variant", "rule"}, variant None if nothing is determined
    """

    def known(name):
        return [item for item in variants[name]["sigma_total_um"] if item is not None]

    for name in PREFERRED:
        if name in variants and len(known(name)) == 3:
            return {"variant": name, "rule": RULE}
    best = min(variants, key=lambda name: (-len(known(name)), sum(known(name))), default=None)
    return {"variant": best if best is not None and known(best) else None, "rule": RULE}


def consistency(combined, name, level):
    """Whether manoeuvres agree (those of the adopted variant; all beside it), measured variants, and the catalogue.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    name : adopted variant or None
    level : probability below which estimates disagree
    """
    names = combined.attrs["variants"].split()
    tests = {
        variant: _judged(chi_square_test(combined["chi2"].values[i], combined["dof"].values[i]), level)
        for i, variant in enumerate(names)
    }
    others = {
        test: (combined[f"{test}_chi2"].values, combined[f"{test}_dof"].values) for test in ("variants", "catalogue")
    }
    own = tests.get(name, _judged(chi_square_test(np.nan, 0), level))
    return {
        "level": level,
        "manoeuvres": own | {"variant": name, "by_variant": tests},
    } | {test: _judged(chi_square_test(*numbers), level) for test, numbers in others.items()}


def _judged(test, level):
    """Test with its verdict."""
    agree = None if test["p"] is None else test["p"] >= level
    words = {None: "not tested", True: "consistent", False: "not consistent"}[agree]
    return test | {"consistent": agree, "verdict": words}


def checks(combined, consistency, settings):
    """Checks of the result: fit of every manoeuvre, agreement at the level of the verdict, plausible size.

    A variant that determines no component is not judged: nothing of it is delivered.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    consistency : of the document: "level", and {"p"} of "manoeuvres", "variants", "catalogue"
    settings : fit_limit, plausible_um

    Returns
    -------
    checks : list of Check
    """
    names = combined.attrs["variants"].split()
    fit = [combined[f"manoeuvre_{name}"].values.astype(float) for name in ("chi2", "dof")]
    ratio = np.divide(*fit, out=np.full_like(fit[0], np.nan), where=fit[1] > 0)
    delivered = np.isfinite(combined["offset"].values).any(axis=1)
    found = [
        at_most(f"chi2 per degree of freedom, {name}", largest(own), settings["fit_limit"], "1")
        for name, own, any_delivered in zip(names, ratio, delivered, strict=True)
        if any_delivered
    ]
    words = {"manoeuvres": "manoeuvres", "variants": "angular accelerations", "catalogue": "torquers and catalogue"}
    tested = {said: consistency[name]["p"] for name, said in words.items()}
    found += [
        at_least(f"agreement of {said}, p", np.nan if p is None else p, consistency["level"], "1")
        for said, p in tested.items()
    ]
    found.append(
        at_most("size of the offset", 1e6 * largest(np.abs(combined["offset"].values)), settings["plausible_um"], "um")
    )
    return [one for one in found if not np.isnan(one.value)]


def verdict(variants, chosen, consistency, settings):
    """Answers to the three questions asked of every event, with a sentence for people.

    Parameters
    ----------
    variants, chosen, consistency : parts of the document
    settings : requirement_um, accuracy_um

    Returns
    -------
    verdict : {"requirement_um", "requirement", "accuracy_um", "accuracy_met", "consistent", "text"}
    """
    limit, accuracy = float(settings["requirement_um"]), float(settings["accuracy_um"])
    if chosen["variant"] is None:
        text = "Manoeuvres were found, but they determine no component of the offset."
        return {"requirement_um": limit, "accuracy_um": accuracy, "text": text}
    block = variants[chosen["variant"]]
    within = [_within(v, s, limit) for v, s in zip(block["offset_um"], block["sigma_total_um"], strict=True)]
    met = [None if s is None else s <= accuracy for s in block["sigma_total_um"]]
    agree = [consistency[name]["consistent"] for name in ("manoeuvres", "variants", "catalogue")]
    sentences = [_offset_text(block, chosen["variant"]), _requirement_text(within, limit)]
    sentences += [_accuracy_text(met, accuracy), _consistency_text(*agree)]
    return {
        "requirement_um": limit,
        "requirement": within,
        "accuracy_um": accuracy,
        "accuracy_met": all(item is True for item in met),
        "consistent": False if False in agree else None if None in agree[:2] else True,
        "text": " ".join(sentences),
    }


def _within(value, sigma, limit):
    """One component against the requirement, with its error in mind."""
    if value is None:
        return "undetermined"
    if abs(value) + CONFIDENCE * sigma <= limit:
        return "within"
    return "exceeds" if abs(value) - CONFIDENCE * sigma > limit else "undecided"


def _offset_text(block, name):
    components = [
        f"{axis} not determined" if value is None else f"{axis} {value:.1f} +- {sigma:.1f}"
        for axis, value, sigma in zip(AXES, block["offset_um"], block["sigma_total_um"], strict=True)
    ]
    return f"Delivered: {', '.join(components)} um ({name})."


def _requirement_text(within, limit):
    words = {"within": "met in", "exceeds": "exceeded in", "undecided": "undecided in", "undetermined": "not tested in"}
    groups = [(words[w], [a for a, own in zip(AXES, within, strict=True) if own == w]) for w in words]
    told = [f"{word} {', '.join(axes)}" for word, axes in groups if axes]
    return f"Requirement of {limit:g} um {'; '.join(told)}."


def _accuracy_text(met, accuracy):
    if all(item is True for item in met):
        return f"Accuracy better than {accuracy:g} um on all axes."
    short = [axis for axis, item in zip(AXES, met, strict=True) if item is not True]
    return f"Accuracy of {accuracy:g} um not reached: {', '.join(short)}."


def _consistency_text(manoeuvres, variants, catalogue):
    words = {None: "were not compared", True: "agree", False: "DISAGREE"}
    text = f"Manoeuvres {words[manoeuvres]}; angular accelerations {words[variants]}"
    return f"{text}{'; the torquers are FURTHER from the catalogue than its error' if catalogue is False else ''}."
