"""Tables of a centre-of-mass event: what the page and the terminal show, as plain rows of text."""

from gravcal.report.pages import table
from gravcal.report.plain import AXES, gps_text
from gravcal.report.words import chi_square, key_of, plus_minus, printed, probability, signed

NOT_DETERMINED = "–"


def combined(document, published):
    """Combined offset of every angular acceleration, ours beside the printed one; like Table 6 of the paper.

    Parameters
    ----------
    document : dict of the event
    published : {section: records}
    """
    known = {one.labels["variant"]: one for one in published.get("combined", ())}
    heads = ["angular acceleration"]
    for axis in AXES:
        heads += [f"{axis} (µm)", f"{axis} printed"] if known else [f"{axis} (µm)"]
    rows = []
    for name, block in document["variants"].items():
        row = [name]
        for i in range(3):
            row.append(plus_minus(block["offset_um"][i], block["sigma_um"][i], block["sigma_total_um"][i]))
            row += [printed(known.get(name), i)] if known else []
        rows.append([*row, chi_square(document["consistency"]["manoeuvres"]["by_variant"][name])])
    names = list(document["variants"])
    adopted = document["adopted"]["variant"]
    caption = "Offset from proof mass to CoM, in SRF: value ± error (total error)."
    return table(
        caption,
        [*heads, "χ²/dof, p of manoeuvres"],
        rows,
        source=key_of(document, "combine"),
        strong=names.index(adopted) if adopted else None,
        wide=bool(known),
    )


def printed_manoeuvres(document, published):
    """Printed values of each manoeuvre: the k-th of a kind and latitude in the paper is our k-th of them.

    Parameters
    ----------
    document : dict of the event
    published : {section: records}

    Returns
    -------
    printed : {(index, variant): Published}
    """
    records = published.get("manoeuvres", ())
    orders = {}
    for one in records:
        places = orders.setdefault((one.labels["kind"], one.labels["latitude_class"]), [])
        if one.labels["order"] not in places:
            places.append(one.labels["order"])
    found = {}
    for index, ours in enumerate(document["manoeuvres"]):
        places = orders.get((ours["kind"], ours["latitude_class"]), [])
        order = places.pop(0) if places else None
        found |= {(index, one.labels["variant"]): one for one in records if one.labels["order"] == order}
    return found


def manoeuvres(document, published):
    """Offset of every manoeuvre and angular acceleration; like Table 7 of the paper.

    Parameters
    ----------
    document : dict of the event
    published : {section: records}
    """
    known = printed_manoeuvres(document, published)
    heads = ["manoeuvre", "angular acc."]
    for axis in AXES:
        heads += [f"{axis} (µm)", "printed"] if known else [f"{axis} (µm)"]
    rows = []
    for index, one in enumerate(document["manoeuvres"]):
        label = _label(index, one)
        for name, block in one["variants"].items():
            row = [label, name]
            for i in range(3):
                row.append(plus_minus(block["offset_um"][i], block["sigma_um"][i]))
                row += [printed(known.get((index, name)), i)] if known else []
            rows.append([*row, chi_square(block["fit"])])
            label = None
    caption = "Offset from each manoeuvre; – is not determined by it."
    heads.append("χ²/dof, p of fit")
    return table(caption, heads, rows, source=key_of(document, "combine"), wide=True, words=(0, 1))


def _label(index, one):
    """Number, kind, latitude and start of a manoeuvre."""
    where = "" if one["latitude_deg"] is None else f", {signed(one['latitude_deg'], 0)}°"
    missing = f", not used: gap in {' and '.join(one['gaps'])}" if one["gaps"] else ""
    return f"{index + 1} {one['kind']}{where}, {gps_text(one['start'])[11:]}{missing}"


def instruments(document):
    """Delays, scales and attitude residual of every manoeuvre, and of all.

    Parameters
    ----------
    document : dict of the event
    """
    heads = ["manoeuvre", "edges late, acc (s)", "edges late, sca (s)"]
    heads += ["torque scale x", "y", "z", "angular scale x", "y", "z", "attitude rms x, y, z (µrad)"]
    rows = []
    for index, one in enumerate(document["manoeuvres"]):
        row = [f"{index + 1} {one['kind']}"]
        row += [plus_minus(one[n]["value"], one[n]["sigma"], digits=3) for n in ("acc_shift_s", "sca_shift_s")]
        row += _scales(one["torque_scale"], 3) + _scales(one["angular_scale"], 4)
        rms = [NOT_DETERMINED if item is None else f"{item:.1f}" for item in one["attitude_rms_urad"]]
        rows.append([*row, ", ".join(rms)])
    delay = document["delays_s"]
    late = [plus_minus(delay[n]["value"], delay[n]["sigma"], digits=3) for n in ("acc", "sca")]
    scales = document["scales"]
    rms = ", ".join(NOT_DETERMINED if v is None else f"{v:.1f}" for v in document["attitude"]["rms_urad"])
    rows.append(["all; tags late", *late, *_scales(scales["torque"], 3), *_scales(scales["angular"], 4), rms])
    caption = (
        "Edges of the wave against the torquer telemetry's bracket; magnetic torque over the catalogue; angular "
        "accelerometer over torquers; star camera minus dynamics."
    )
    return table(caption, heads, rows, source=key_of(document, "attitude"), wide=True, strong=len(rows) - 1)


def _scales(block, digits):
    """Three scales with their errors."""
    return [plus_minus(v, s, digits=digits) for v, s in zip(block["value"], block["sigma"], strict=True)]


def agreement(document):
    """Tests of manoeuvres and of angular accelerations with their verdicts.

    Parameters
    ----------
    document : dict of the event
    """
    tests = document["consistency"]
    rows = [
        [f"manoeuvres, {name}", chi_square(one, False), probability(one["p"]), one["verdict"]]
        for name, one in tests["manoeuvres"]["by_variant"].items()
    ]
    others = {"variants": "acc and sca", "catalogue": "mtq and acc, within catalogue error"}
    rows += [
        [words, chi_square(tests[name], False), probability(tests[name]["p"]), tests[name]["verdict"]]
        for name, words in others.items()
    ]
    heads = ["what should agree", "χ² / dof", "p", f"verdict at {tests['level']:g}"]
    return table(
        "Do the estimates agree within their errors?", heads, rows, source=key_of(document, "combine"), words=(0, 3)
    )


def field(document):
    """Magnetometer against the model.

    Parameters
    ----------
    document : dict of the event
    """
    check = document["field_check"]
    names = (("bias", "bias_nt"), ("rms", "rms_nt"), ("largest", "max_nt"))
    rows = [[word, *[NOT_DETERMINED if v is None else signed(v, 0) for v in check[name]]] for word, name in names]
    caption = f"Magnetometer minus {check['model']} in SRF, {check['samples']} samples."
    heads = ["nT", *AXES]
    return table(caption, heads, rows, source=key_of(document, "field"))
