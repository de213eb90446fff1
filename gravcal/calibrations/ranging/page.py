"""Report of a day of routine pointing: its product, its result document, and the page."""

from __future__ import annotations

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend, thinned
from gravcal.report.named_parameters import Page
from gravcal.report.pages import Figure, Section

NOTES = (
    "Each block of a revolution has its own bias and slow orbit error; the noise of one half of the day is measured in "
    "the other.",
    "A phase centre is null where its error is larger than a wiggle would leave: routine pointing turns the line of "
    "sight by less than a milliradian and moves x by the square of that, far below the orbit errors. Phase centres are "
    "calibrated by wiggles (kbr_phase_centre); here they show whether those of the catalogue still hold.",
)


def content(products):
    """Facts of the record, and what follows the result."""
    found, line = products["estimate"], -products["align"]["column"].values.reshape(-1, 2, 3)
    angles = np.stack([np.arctan2(-line[..., 2], line[..., 0]), np.arctan2(line[..., 1], line[..., 0])], axis=-1)
    facts = {
        "satellites": products["align"].attrs["satellites"],
        "minutes": int(found.sizes["time"]),
        "rms_of_blocks_mm": 1e3 * float(np.sqrt(np.mean(found["residual"].values ** 2))),
        "rms_of_phase_centres_um": 1e6 * float(np.sqrt(np.mean(found["fitted"].values ** 2))),
        "pointing_scatter_mrad": (1e3 * angles.std(axis=0)).ravel().tolist(),
    }
    caption = "Range minus orbit without bias and slow orbit error, and what the phase centres make of it."
    return facts, [Section("Range", (), [Figure(draw_range, ("estimate",), caption)], NOTES)]


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
)
