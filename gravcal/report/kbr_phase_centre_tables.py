"""Tables of the page of a ranging calibration, in the form of Tables 4 to 8 of the source paper."""

from gravcal.report.pages import table
from gravcal.report.words import NOT_DETERMINED, chi_square, plus_minus, signed

OBSERVABLES = ("range", "range_rate", "range_acceleration")
TITLES = {"range": "range", "range_rate": "range rate", "range_acceleration": "range acceleration"}
ESTIMATORS = {"ls": "least squares", "robust": "robust, IGG-III"}
TABLES = {"ls": "Table 4", "robust": "Table 6"}


def true_units(text):
    """Text of the terminal with the signs that a page can show."""
    for old, new in (("+-", "±"), (" um", " µm"), (" urad", " µrad"), (" -", " −")):
        text = text.replace(old, new)
    return text


def result(document, published, estimator):
    """All observables of one estimator beside the printed values."""
    own = {}
    for one in published.get(estimator, []):
        label = one["labels"]
        own[label["satellite"][-1].upper(), label["component"], label["observable"]] = one
    rows = []
    for letter, blocks in document["satellites"].items():
        for k, axis in enumerate("xyz"):
            row = [f"GRACE-{letter} {axis}"]
            for name in OBSERVABLES:
                found = blocks[name][estimator]
                row.append(plus_minus(found["phase_centre_mm"][k], found["sigma_mm"][k]))
                row.append(_printed(own.get((letter, axis, name))))
            rows.append(row)
    heads = ["mm"] + [head for name in OBSERVABLES for head in (TITLES[name], "printed")]
    caption = (
        f"Phase centres by {ESTIMATORS[estimator]}, millimetres. Printed: 10.3390/rs14143395, {TABLES[estimator]}, "
        f"September 2020; its range columns were not detrended."
    )
    return table(caption, heads, rows)


def _printed(record):
    if record is None or record["value"][0] is None:
        return NOT_DETERMINED
    value, sigma = record["value"][0], record["sigma"][0]
    digits = 1 if abs(value) >= 100 else 2
    return f"{signed(value, digits)} ± {sigma:.{digits}f}"


def subsets(document, published):
    """One-sided sets and sets with x held: shifts of y and z, predicted from the shift of x, and those printed."""
    printed = _printed_shifts(published)
    rows = []
    for name, axes in (("positive", "xyz"), ("mirror", "xyz"), ("positive_x_fixed", "yz"), ("mirror_x_fixed", "yz")):
        for letter, found in document["subsets"][name]["range_rate"].items():
            for k, axis in ((k, axis) for k, axis in enumerate("xyz") if axis in axes):
                predicted = found["predicted_shift_mm"][k]
                rows.append(
                    [
                        f"{name.replace('_x_fixed', ', x held')}, GRACE-{letter} {axis}",
                        plus_minus(found["phase_centre_mm"][k], found["sigma_mm"][k]),
                        _number(found["shift_mm"][k]),
                        _number(predicted),
                        _number(printed.get((name, letter, axis))),
                    ]
                )
    caption = (
        "One-sided sets, range rate, millimetres: shift against all wiggles, and tan(offset) times the shift of x; "
        "with x held, by what the catalogue's x misses. "
        "Printed: Table 5 minus Table 4, range rate."
    )
    return table(caption, ["set", "value", "shift", "predicted", "printed shift"], rows)


def _printed_shifts(published):
    joint = {
        (one["labels"]["satellite"], one["labels"]["component"]): one["value"][0]
        for one in published.get("ls", [])
        if one["labels"]["observable"] == "range_rate"
    }
    found = {}
    for one in published.get("subsets", []):
        label = one["labels"]
        key = (label["satellite"], label["component"])
        if label["observable"] == "range_rate" and key in joint:
            found[label["subset"], key[0][-1].upper(), key[1]] = one["value"][0] - joint[key]
    return found


def _number(value, digits=3):
    return NOT_DETERMINED if value is None else signed(value, digits)


def geometry(document):
    """Condition numbers and the ratio of errors."""
    own = document["geometry"]
    rows = [
        [name.replace("_", " "), *(_plain(own["condition"][one][name]) for one in OBSERVABLES)]
        for name in own["condition"]["range"]
    ]
    ratio = [_number(v, 4) for v in own["one_sided_sigma_ratio"]["positive"]]
    caption = (
        f"Condition number of the whitened, detrended columns. Error of y and z over that of x, positive only: "
        f"{', '.join(ratio)}; tan of the offset angle: {_number(own['tan_offset'], 4)}."
    )
    return table(caption, ["set", *TITLES.values()], rows)


def _plain(value):
    return NOT_DETERMINED if value is None else f"{value:.1f}"


def manoeuvres(document):
    """Every wiggle with its own estimate."""
    rows = []
    for one in document["manoeuvres"]:
        cells = [plus_minus(v["value"], v["sigma"], digits=4) for v in one["estimates_mm"].values()]
        rows.append(
            [
                f"{one['satellite']} {one['kind']}",
                f"{one['start'] - document['record']['start']:.0f}",
                f"{one['stop'] - one['start']:.0f}",
                _number(one["offset_deg"], 2),
                _number(one["amplitude_deg"], 2),
                one["component"],
                *cells,
            ]
        )
    heads = ["wiggle", "start, s", "length, s", "offset, °", "amplitude, °", "", *TITLES.values()]
    spread = document["consistency"]["scatter_between_manoeuvres_mm"]["range_rate"]
    told = [f"{k} {axis} {_number(v, 4)}" for k, both in spread.items() for axis, v in zip("yz", both[1:], strict=True)]
    agree = "; ".join(
        f"{TITLES[name]} {chi_square(test)}" for name, test in document["consistency"]["manoeuvres"].items()
    )
    caption = (
        f"Sub-manoeuvres found in the pointing angles, and the component each tells alone, millimetres. "
        f"Disagreement, chi-square / degrees of freedom, probability: {agree}. "
        f"Error of the mean by the scatter between wiggles, range rate: {', '.join(told)}."
    )
    return table(caption, heads, rows)


def noise(document):
    """Noise at the frequencies that matter."""
    own = document["noise"]
    rows = [
        [
            f.replace("_", " ").replace("mhz", "mHz"),
            _plain2(own["quiet_um_rthz"][f]),
            _plain2(own["manoeuvres_um_rthz"][f]),
        ]
        for f in own["quiet_um_rthz"]
    ]
    camera = _plain2(own["star_camera_urad_rthz_4_mhz"])
    caption = (
        f"Noise of the range, µm/√Hz, from {own['source']} data of {own['seconds']:.0f} s. Star cameras as seen by the "
        f"ranging in the wiggles: {camera} µrad/√Hz at 4 mHz."
    )
    return table(caption, ["frequency", "quiet", "in wiggles"], rows)


def _plain2(value):
    return NOT_DETERMINED if value is None else f"{value:.2f}"


def vectors(document, published):
    """Adopted vectors beside those of the paper and of the sequence-of-events file."""
    rows = []
    for letter, found in document["adopted"]["satellites"].items():
        values = [plus_minus(v, s) for v, s in zip(found["phase_centre_mm"], found["sigma_mm"], strict=True)]
        rows.append([f"GRACE-{letter}, this event", *values])
        for one in published.get("vkb1b", []):
            if one["labels"]["satellite"] == f"grace-{letter.lower()}" and None not in one["value"]:
                x, y, z = one["value"]
                name = one["labels"]["solution"].replace("_", " ")
                rows.append([f"GRACE-{letter}, {name}", signed(x, 1), signed(y / 1e3, 4), signed(z / 1e3, 4)])
    return table("Vectors in millimetres; printed: 10.3390/rs14143395, Tables 7 and 8.", ["", "x", "y", "z"], rows)


def routine(document):
    """What quiet data say."""
    own, rows = document["routine_pointing"], []
    for letter in document["pair"]:
        block = own[letter]
        for k, axis in enumerate("xyz"):
            value, sigma = block["phase_centre_mm"][k], block["sigma_mm"][k]
            behind = block["behind_antenna_correction_mm"][k]
            rows.append([f"GRACE-{letter} {axis}", plus_minus(value, sigma), _number(behind)])
    heads = ["mm", "quiet ranging against orbit", "behind the file's antenna correction"]
    return table("Phase centres from routine pointing, millimetres.", heads, rows)
