"""Results of a centre-of-mass event for the terminal: short text, and estimates beside the truth."""

from gravcal.report.plain import AXES, gps_text

TRUTH_HEADS = ("variant", "component", "estimate (um)", "sigma (um)", "truth (um)", "error/sigma")


def truth_table(document, truth, total=False):
    """Estimated beside true offset, one row for each angular acceleration and component.

    Parameters
    ----------
    document : dict of the event
    truth : dict of the simulation with "offset_um" in the same direction
    total : bool, judge by the error that holds inertia and dipole per current too

    Returns
    -------
    rows : lists of texts under TRUTH_HEADS
    """
    if truth["direction"] != document["direction"]:
        raise ValueError(f"truth is {truth['direction']}, document {document['direction']}")
    name = "sigma_total_um" if total else "sigma_um"
    return [
        _truth_row(variant, axis, block["offset_um"][i], block[name][i], truth["offset_um"][i])
        for variant, block in document.get("variants", {}).items()
        for i, axis in enumerate(AXES)
    ]


def _truth_row(variant, axis, value, sigma, true):
    """One line of the table."""
    if value is None:
        return [variant, axis, "not determined", "", f"{true:.2f}", ""]
    ratio = f"{(value - true) / sigma:+.2f}" if sigma > 0 else ""
    return [variant, axis, f"{value:.2f}", f"{sigma:.2f}", f"{true:.2f}", ratio]


def summary(document):
    """Result in a few lines of plain text.

    Parameters
    ----------
    document : dict of the event

    Returns
    -------
    text : str, lines of at most 100 signs without a line feed at the end
    """
    lines = [f"{document['event']}: {document['status']}", *_wrapped(document["verdict"]["text"])]
    if "variants" in document:
        lines += ["", *_offsets(document), "", *_manoeuvres(document), _delays(document)]
    lines += [_field(document)]
    if document.get("roll_response"):
        lines.append(_roll(document["roll_response"]))
    return "\n".join(lines)


def _wrapped(text):
    import textwrap

    return textwrap.wrap(text, 98)


def _offsets(document):
    """Offset, error and total error of every angular acceleration."""
    lines = ["offset from proof mass to CoM (um)", " " * 16 + "".join(f"{axis:>23}" for axis in AXES)]
    for name, block in document["variants"].items():
        star = "*" if name == document["adopted"]["variant"] else " "
        cells = zip(block["offset_um"], block["sigma_um"], block["sigma_total_um"], strict=True)
        lines.append(f"{star}{name:<15}" + "".join(f"{_cell(*one):>23}" for one in cells))
    return [*lines, "* adopted; in brackets the error with that of inertia and dipole per current"]


def _cell(value, sigma, total):
    return "not determined" if value is None else f"{value:.2f} +- {sigma:.2f} ({total:.1f})"


def _manoeuvres(document):
    """Kinds and times, and whether they agree."""
    kinds = [one["kind"] for one in document["manoeuvres"]]
    counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("pitch", "roll", "yaw") if kind in kinds)
    first, last = document["manoeuvres"][0]["start"], document["manoeuvres"][-1]["stop"]
    tests = document["consistency"]
    lines = [f"manoeuvres       {counted}; {gps_text(first)} to {gps_text(last)} GPS"]
    words = {"manoeuvres": "manoeuvres", "variants": "acc and sca", "catalogue": "mtq and acc"}
    for name, test in ((words[key], tests[key]) for key in words):
        told = "" if test["p"] is None else f", chi2 {test['chi2']:.1f} / {test['dof']}, p {test['p']:.3f}"
        lines.append(f"{'agreement':<17}{name} {test['verdict']}{told}")
    return lines


def _delays(document):
    """Tags late against the torquers."""
    told = [
        f"{name} not determined" if one["value"] is None else f"{name} {one['value']:+.3f} +- {one['sigma']:.3f} s"
        for name, one in document["delays_s"].items()
    ]
    return f"{'tags late':<17}{', '.join(told)}"


def _field(document):
    """Magnetometer against the model."""
    check = document["field_check"]
    bias, rms = (", ".join("-" if v is None else f"{v:.0f}" for v in check[name]) for name in ("bias_nt", "rms_nt"))
    return f"{'field check':<17}magnetometer minus {check['model']} (nT): bias {bias}; rms {rms}"


def _roll(response):
    """Slope of roll acceleration on torquer current times field."""
    text = f"{'roll response':<17}{response['value']:.4f} +- {response['sigma']:.4f} {response['unit']}"
    if response["expected"]:
        text += f", expected {response['expected']['value']:.4f} +- {response['expected']['sigma']:.4f}"
    return text
