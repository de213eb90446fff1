"""Report of a day of a magnetometer: its product, its result document, and the page."""

from dataclasses import replace

import numpy as np

from gravcal.report.figures import AXIS, COLOURS, thinned
from gravcal.report.named_parameters import Page, cells, parameters
from gravcal.report.pages import Section, words

WORDS = words(__file__, "page.toml")


def content(products):
    """Facts {name: number} of the record, and the sections of the page after the result; products {stage: Dataset}."""
    estimate, aligned = products["estimate"], products["align"]
    difference = estimate["residual_b"].values
    facts = {
        "records": int(estimate.sizes["time"]),
        "seconds": float(np.ptp(estimate["time"].values)),
        "noise_nt": (1e9 * estimate["noise"].values).tolist(),
        "mean_nt": (1e9 * difference.mean(axis=0)).tolist(),
        "field_range_nt": (1e9 * np.ptp(aligned["model_b"].values, axis=0)).tolist(),
        "dipole_sigma_a_m2": aligned["dipole_b"].values.std(axis=0).tolist(),
    }
    return facts, [Section("Field", figures=[_field], notes=WORDS.notes["field"])]


@WORDS.figure("estimate")
def _field(panels, estimate):  # measured less reference field with the fit, and its residual, nT
    above, below = panels
    minutes = (estimate["time"].values - estimate["time"].values[0]) / 60
    measured, fitted = (1e9 * estimate[name].values for name in ("residual_b", "fitted_b"))
    fit = {"color": COLOURS["black"], "linewidth": 0.5, "linestyle": ":"}
    for index, axis in enumerate("xyz"):
        above.plot(*thinned(minutes, measured[:, index]), label=axis, **AXIS[axis])
        above.plot(*thinned(minutes, fitted[:, index]), label="fit", **fit)
        below.plot(*thinned(minutes, (measured - fitted)[:, index]), **AXIS[axis])


PAGE = Page(
    "magnetometer", "Magnetometer", "Magnetometer against the reference field", ("estimate", "align", "checks"), content
)


def content_beside(products):
    """Facts and sections as of `content`, with those of the comparison with another calibration."""
    facts, sections = content(products)
    comparison = products["beside"]
    difference = 1e9 * comparison["difference_b"].values
    facts |= {
        "theirs_records": int(comparison.sizes["time"]),
        "theirs_flagged": int(comparison["flagged"]),
        "theirs_less_ours_mean_nt": difference.mean(axis=0).tolist(),
        "theirs_less_ours_rms_nt": np.sqrt(np.mean(difference**2, axis=0)).tolist(),
        "theirs_less_reference_rms_nt": (1e9 * np.sqrt(np.mean(comparison["theirs_b"].values ** 2, axis=0))).tolist(),
        "theirs_from_orbit_m": float(comparison["apart"]),
    }
    rows = zip(parameters(comparison, "own_").items(), parameters(comparison).values(), strict=True)
    rows = [[name.replace("_", " "), *cells(ours), *cells(theirs)] for (name, ours), theirs in rows]
    section = Section("Beside another calibration", [WORDS.table("both", rows)], [_beside], [WORDS.note("theirs")])
    return facts, [*sections, section]


def more_beside(products):
    """{"theirs": parameters that the field of the other calibration implies}, and a sentence on the difference."""
    comparison = products["beside"]
    texts = [f"{one:.1f}" for one in np.sqrt(np.mean((1e9 * comparison["difference_b"].values) ** 2, axis=0))]
    sentence = f" Another calibration's field less ours: rms {', '.join(texts)} nT in x, y, z."
    return {"theirs": parameters(comparison)}, sentence


@WORDS.figure("beside")
def _beside(panel, comparison):  # calibrated field of the other calibration less ours, nT
    minutes = (comparison["time"].values - comparison["time"].values[0]) / 60
    for index, axis in enumerate("xyz"):
        panel.plot(*thinned(minutes, 1e9 * comparison["difference_b"].values[:, index]), label=axis, **AXIS[axis])


BESIDE = replace(PAGE, products=(*PAGE.products, "beside"), content=content_beside, more=more_beside)
