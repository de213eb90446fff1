"""Report of a day of a magnetometer: its product, its result document, and the page."""

import numpy as np

from gravcal.report.figures import AXIS, COLOURS, grid, thinned
from gravcal.report.named_parameters import Page
from gravcal.report.pages import Section, figure

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
