"""Report of a day of a magnetometer: its product, its result document, and the page."""

from dataclasses import replace

import numpy as np

from gravcal.report.figures import AXIS, COLOURS, grid, thinned
from gravcal.report.named_parameters import Page, cells, parameters
from gravcal.report.pages import Section, Table, figure

NOTES = (
    "Measured less reference field is bias, scale and axes out of square in the field of the instrument, a small turn "
    "of its mounting (or of the star camera: the same), the leak of the torquers' dipoles, a uniform field along the "
    "moment of the main field (ring current), and what a late tag makes of the changing field.",
    "All are free at once. Minutes of data determine few of them: what is null is not determined, and held groups "
    "(setting held) give the others under the assumption that those are nought.",
)


def content(products):
    """Facts of the record, and what follows the result."""
    found, aligned = products["estimate"], products["align"]
    difference = found["residual_b"].values
    facts = {
        "records": int(found.sizes["time"]),
        "seconds": float(np.ptp(found["time"].values)),
        "noise_nt": (1e9 * found["noise"].values).tolist(),
        "mean_nt": (1e9 * difference.mean(axis=0)).tolist(),
        "field_range_nt": (1e9 * np.ptp(aligned["model_b"].values, axis=0)).tolist(),
        "dipole_sigma_a_m2": aligned["dipole_b"].values.std(axis=0).tolist(),
    }
    return facts, [Section("Field", figures=[_field], notes=NOTES)]


@figure(
    "estimate",
    caption="Measured less reference field, and the same as the parameters make it. Below, what is left.",
)
def _field(found):
    labels = {"xlabel": "minutes", "ylabels": ("difference, nT", "residual, nT")}
    figure, ((above,), (below,)) = grid(2, 1, 3.6, sharex=True, margins={"hspace": 0.12}, **labels)
    minutes = (found["time"].values - found["time"].values[0]) / 60
    measured, fitted = (1e9 * found[name].values for name in ("residual_b", "fitted_b"))
    fit = {"color": COLOURS["black"], "linewidth": 0.5, "linestyle": ":"}
    for index, axis in enumerate("xyz"):
        above.plot(*thinned(minutes, measured[:, index]), label=axis, **AXIS[axis])
        above.plot(*thinned(minutes, fitted[:, index]), label="fit", **fit)
        below.plot(*thinned(minutes, (measured - fitted)[:, index]), **AXIS[axis])
    return figure


PAGE = Page(
    "magnetometer", "Magnetometer", "Magnetometer against the reference field", ("estimate", "align", "checks"), content
)


THEIRS = (
    "Another's calibrated field of the same day, turned into the body by our orbit and attitude, against ours: the "
    "reading less what the instrument adds by our parameters. Of theirs: the same parameters with their field in place "
    "of the reference field, as their own of the month come in no daily file. The reader of these files is made "
    "by their published description and was not tested on a real one."
)


def content_beside(products):
    """The same, with the calibrated field of others."""
    facts, sections = content(products)
    found = products["beside"]
    difference = 1e9 * found["difference_b"].values
    facts |= {
        "theirs_records": int(found.sizes["time"]),
        "theirs_flagged": int(found["flagged"]),
        "theirs_less_ours_mean_nt": difference.mean(axis=0).tolist(),
        "theirs_less_ours_rms_nt": np.sqrt(np.mean(difference**2, axis=0)).tolist(),
        "theirs_less_reference_rms_nt": (1e9 * np.sqrt(np.mean(found["theirs_b"].values ** 2, axis=0))).tolist(),
        "theirs_from_orbit_m": float(found["apart"]),
    }
    rows = zip(parameters(found, "own_").items(), parameters(found).values(), strict=True)
    rows = [[name.replace("_", " "), *cells(ours), *cells(theirs)] for (name, ours), theirs in rows]
    heads = ["parameter", "ours ± σ", "unit", "theirs ± σ", "unit"]
    tables = [Table("Our parameters, and those that their field implies.", heads, rows, ("beside",), (0, 2, 4))]
    return facts, [*sections, Section("Beside another calibration", tables, [_beside], (THEIRS,))]


def more_beside(products):
    """Parameters that the field of others implies, and a sentence on the difference."""
    found = products["beside"]
    difference = 1e9 * found["difference_b"].values
    texts = [f"{one:.1f}" for one in np.sqrt(np.mean(difference**2, axis=0))]
    said = f" Another calibration's field less ours: rms {', '.join(texts)} nT in x, y, z."
    return {"theirs": parameters(found)}, said


@figure("beside", caption="Calibrated field of others less ours, by axis.")
def _beside(found):
    labels = {"xlabel": "minutes", "ylabels": ("theirs less ours, nT",)}
    figure, ((panel,),) = grid(1, 1, 2.4, **labels)
    minutes = (found["time"].values - found["time"].values[0]) / 60
    for index, axis in enumerate("xyz"):
        panel.plot(*thinned(minutes, 1e9 * found["difference_b"].values[:, index]), label=axis, **AXIS[axis])
    return figure


BESIDE = replace(PAGE, products=(*PAGE.products, "beside"), content=content_beside, more=more_beside)
