"""Report of a day of routine pointing: its product, its result document, and the page."""

import numpy as np

from gravcal.calibrations.ranging.model import angles
from gravcal.report.figures import COLOURS, bars, opened, thinned
from gravcal.report.named_parameters import Page
from gravcal.report.pages import Section, words

WORDS = words(__file__, "page.toml")
CORRECTIONS = ("none", "as_measured", "smoothed")


def content(products):
    """Facts {name: number} of the record, and the sections of the page after the result; products {stage: Dataset}."""
    estimate = products["estimate"]
    facts = {
        "satellites": products["align"].attrs["satellites"],
        "readings": int(estimate.sizes["time"]),
        "rms_of_blocks_mm": 1e3 * float(np.sqrt(np.mean(estimate["residual"].values ** 2))),
        "rms_of_phase_centres_um": 1e6 * float(np.sqrt(np.mean(estimate["fitted"].values ** 2))),
        "pointing_scatter_mrad": (1e3 * angles(products["align"]).std(axis=0)).ravel().tolist(),
        "variance_at_wrong_times": estimate["excess"].values.tolist(),
    }
    return facts, [
        Section("Antenna correction", [WORDS.table("share", shares(estimate))], [_share], [WORDS.note("share")]),
        Section("Range", figures=[_range], notes=WORDS.notes["range"]),
    ]


def shares(estimate):
    """Rows by band: share of the antenna correction in the range, as of star cameras expected, range in um/sqrt(Hz)."""
    edge, sigma = 1e3 * estimate["edge"].values, np.sqrt(np.diag(estimate["share_covariance"].values))
    density = 1e6 * np.sqrt(estimate["density"].values)
    return [
        {
            "band_mhz": edge[k : k + 2].tolist(),
            "value": float(estimate["share"][k]),
            "sigma": float(sigma[k]),
            "expected": float(estimate["expected"][k]),
            "range_um": dict(zip(CORRECTIONS, density[:, k].tolist(), strict=True)),
        }
        for k in range(sigma.size)
    ]


def more(products):
    """{"share": rows of `shares`} for the document, and a sentence on all bands but the first."""
    rows = shares(products["estimate"])
    text = ["{:.2f} +- {:.2f} at {:g} to {:g}".format(one["value"], one["sigma"], *one["band_mhz"]) for one in rows[1:]]
    return {"share": rows}, f" The range shows of the antenna correction {', '.join(text)} mHz."


@WORDS.figure("estimate", "align")
def _share(panels, estimate, aligned):  # shares by band; density of the pointing and what the filter keeps
    left, right = panels
    edge, known = 1e3 * estimate["edge"].values, slice(1, None)
    middle = np.sqrt(edge[1:] * edge[:-1])[known]
    sigma = np.sqrt(np.diag(estimate["share_covariance"].values))[known]
    bars(left, middle, estimate["share"].values[known], sigma, color=COLOURS["blue"], label="range")
    left.plot(middle, estimate["expected"].values[known], "x", color=COLOURS["vermilion"], label="star cameras expect")
    left.axhline(0, color=COLOURS["grey"], lw=0.6)
    left.set_xscale("log")
    left.set_xticks(edge[1:], [f"{one:g}" for one in edge[1:]])
    left.minorticks_off()
    frequency, density = 1e3 * aligned["frequency"].values, 1e3 * np.sqrt(aligned["pointing_density"].values)
    kept = density * aligned["pointing_gain"].values
    for k, axis in np.ndindex(2, 2):
        colour = COLOURS[("blue", "vermilion")[k]]
        label = f"{('yaw', 'pitch')[axis]} {aligned.attrs['satellites'][k]}"
        right.loglog(frequency, density[k, axis], color=colour, ls=("-", "--")[axis], label=label)
        right.loglog(frequency, np.where(kept > 0, kept, np.nan)[k, axis], color=colour, ls="", marker=".", ms=3)
    left.legend()
    right.legend()


@WORDS.figure("estimate")
def _range(panels, estimate):  # ranging minus orbit, mm, and its part by the phase centres, um
    above, below = panels
    hours = (estimate["time"].values - estimate["time"].values[0]) / 3600
    residual, fitted = (opened(hours, estimate[name].values, 0.1) for name in ("residual", "fitted"))
    above.plot(*thinned(residual[0], 1e3 * residual[1]), color=COLOURS["sky"], label="ranging minus orbit")
    below.plot(*thinned(fitted[0], 1e6 * fitted[1]), color=COLOURS["vermilion"], label="phase centres")


PAGE = Page(
    "ranging",
    "Routine pointing",
    "Centre of mass to phase centre by routine pointing",
    ("estimate", "align", "checks"),
    content,
    more,
)
