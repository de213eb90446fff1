"""Report of a day of routine pointing: its product, its result document, and the page."""

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend, thinned
from gravcal.report.named_parameters import Page
from gravcal.report.pages import Figure, Section, Table

NOTES = (
    "Each block of a revolution has its own bias and slow orbit error; its noise is measured in the blocks beside it; "
    "errors are wider by what columns at wrong times of the day gain.",
    "A phase centre is null where its error is larger than a wiggle would leave: routine pointing turns the line of "
    "sight by milliradians and moves x by the square of that, far below the orbit errors. Phase centres are calibrated "
    "by wiggles (kbr_phase_centre); here they show whether those of the catalogue still hold.",
)
CORRECTIONS = ("none", "as_measured", "smoothed")
SHARE = (
    "The antenna correction is made of the pointing as star cameras measure it. The range shows how much of it is "
    "motion; the star cameras themselves say what to expect: their spectrum above its floor. What is not motion is "
    "noise that the correction adds to the range. In the lowest band orbit errors follow the pointing, which the share "
    "is of as well.",
)


def content(products):
    """Facts of the record, and what follows the result."""
    found, line = products["estimate"], -products["align"]["column"].values.reshape(-1, 2, 3)
    angles = np.stack([np.arctan2(-line[..., 2], line[..., 0]), np.arctan2(line[..., 1], line[..., 0])], axis=-1)
    facts = {
        "satellites": products["align"].attrs["satellites"],
        "readings": int(found.sizes["time"]),
        "rms_of_blocks_mm": 1e3 * float(np.sqrt(np.mean(found["residual"].values ** 2))),
        "rms_of_phase_centres_um": 1e6 * float(np.sqrt(np.mean(found["fitted"].values ** 2))),
        "pointing_scatter_mrad": (1e3 * angles.std(axis=0)).ravel().tolist(),
        "variance_at_wrong_times": found["excess"].values.tolist(),
    }
    heads = ["band, mHz", "share in the range", "σ", "expected", "no correction", "as measured", "smoothed pointing"]
    rows = [
        ["{:g} to {:g}".format(*one["band_mhz"]), *(f"{one[n]:.2f}" for n in ("value", "sigma", "expected"))]
        + [f"{one['range_um'][name]:.2f}" for name in CORRECTIONS]
        for one in shares(found)
    ]
    shown = Table("Share of the antenna correction, and the range with it, µm/√Hz.", heads, rows, reads=("estimate",))
    caption = "Share of the antenna correction that the range shows, and pointing with what is kept of it."
    figure = Figure(draw_share, ("estimate", "align"), caption)
    caption = "Range minus orbit without bias and slow orbit error, and what the phase centres make of it."
    ranged = Section("Range", (), [Figure(draw_range, ("estimate",), caption)], NOTES)
    return facts, [Section("Antenna correction", [shown], [figure], SHARE), ranged]


def shares(found):
    """Rows of the document: band, share with its error, what star cameras expect, density of the range, um/sqrt(Hz)."""
    edge, sigma = 1e3 * found["edge"].values, np.sqrt(np.diag(found["share_covariance"].values))
    density = 1e6 * np.sqrt(found["density"].values)
    return [
        {
            "band_mhz": edge[k : k + 2].tolist(),
            "value": float(found["share"][k]),
            "sigma": float(sigma[k]),
            "expected": float(found["expected"][k]),
            "range_um": dict(zip(CORRECTIONS, density[:, k].tolist(), strict=True)),
        }
        for k in range(sigma.size)
    ]


def more(products):
    """Shares by band, and the sentence on them."""
    rows = shares(products["estimate"])
    said = ["{:.2f} +- {:.2f} at {:g} to {:g}".format(one["value"], one["sigma"], *one["band_mhz"]) for one in rows[1:]]
    return {"share": rows}, f" The range shows of the antenna correction {', '.join(said)} mHz."


def draw_share(found, aligned):
    """Shares with errors and expectations, and the spectra of pointing with what is kept."""
    figure, panels = grid(1, 2, 2.4, margins={"wspace": 0.3})
    left, right = panels[0]
    edge, known = 1e3 * found["edge"].values, slice(1, None)
    middle = np.sqrt(edge[1:] * edge[:-1])[known]
    sigma = np.sqrt(np.diag(found["share_covariance"].values))[known]
    left.errorbar(middle, found["share"].values[known], sigma, color=COLOURS["blue"], marker="o", ls="", label="range")
    left.plot(middle, found["expected"].values[known], "x", color=COLOURS["vermilion"], label="star cameras expect")
    left.axhline(0, color=COLOURS["grey"], lw=0.6)
    left.set(xscale="log", xlabel="mHz", title="share of the correction")
    left.set_xticks(edge[1:], [f"{one:g}" for one in edge[1:]])
    left.minorticks_off()
    frequency, density = 1e3 * aligned["frequency"].values, 1e3 * np.sqrt(aligned["pointing_density"].values)
    kept = density * aligned["pointing_gain"].values
    for k, axis in np.ndindex(2, 2):
        colour = COLOURS[("blue", "vermilion")[k]]
        label = f"{('yaw', 'pitch')[axis]} {aligned.attrs['satellites'][k]}"
        right.loglog(frequency, density[k, axis], color=colour, ls=("-", "--")[axis], label=label)
        right.loglog(frequency, np.where(kept > 0, kept, np.nan)[k, axis], color=colour, ls="", marker=".", ms=3)
    right.set(xlabel="mHz", title="pointing, mrad/√Hz; points: kept")
    left.legend()
    right.legend()
    return figure


def draw_range(found):
    """Range minus orbit of the blocks, and its part from the phase centres magnified."""
    figure, panels = grid(2, 1, 3.2, sharex=True, margins={"hspace": 0.3})
    hours = (found["time"].values - found["time"].values[0]) / 3600
    for panel, name, unit, factor, colour in (
        (panels[0, 0], "residual", "mm", 1e3, "sky"),
        (panels[1, 0], "fitted", "µm", 1e6, "vermilion"),
    ):
        gaps = np.flatnonzero(np.diff(hours) > 0.1) + 1
        series = np.insert(factor * found[name].values, gaps, np.nan)
        label = "ranging minus orbit" if name == "residual" else "phase centres"
        panel.plot(*thinned(np.insert(hours, gaps, np.nan), series), color=COLOURS[colour], label=label)
        panel.set_title(unit)
    panels[1, 0].set_xlabel("hours of the record")
    legend(figure, panels, 2)
    return figure


PAGE = Page(
    "ranging",
    "Routine pointing",
    "Centre of mass to phase centre by routine pointing",
    ("estimate", "align", "checks"),
    content,
    more,
)
