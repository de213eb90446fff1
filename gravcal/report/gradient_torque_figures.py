"""Figures of a gradient-torque report."""

from __future__ import annotations

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend

GROUPS = ((1, 5), (6, 11), (12, 17), (18, 23))  # S-GRS paper, figures 4 to 7
CYCLE = ("blue", "vermilion", "green", "purple", "orange", "sky")
METHODS = {"two_sensor": ("blue", "two sensors"), "one_sensor": ("vermilion", "one sensor")}
PRINTED = {"one_sensor_published": ("grey", "one sensor, printed")}


def spectra(torque):
    """Amplitude of each zonal degree, four groups as printed, and the noise of the sensor.

    Parameters
    ----------
    torque : Dataset, "gradient_torque.torque"
    """
    figure, panels = grid(2, 2, 4.6, sharex=True, sharey=True, margins={"hspace": 0.28, "wspace": 0.06})
    frequency = 1e3 * torque["frequency"].values
    total = np.sqrt(np.sum(torque["amplitude"].values ** 2, axis=1))
    noise = np.sqrt(np.sum(torque["sensitivity"].values ** 2))
    for panel, (low, high) in zip(panels.ravel(), GROUPS, strict=True):
        chosen = [i for i, n in enumerate(torque["degree"].values) if low <= n <= high]
        for colour, i in zip(CYCLE, chosen, strict=False):
            label = str(int(torque["degree"][i])) + ("" if total[i].any() else " (empty)")
            panel.loglog(frequency, np.where(total[i] > 0, total[i], np.nan), color=COLOURS[colour], label=label)
        panel.axhline(noise, color=COLOURS["black"], linestyle="--", label="sensor")
        panel.set_title(f"zonal degrees {low} to {high}")
        panel.set_ylim(1e-18, 1e-5)
        panel.legend(ncols=2, loc="upper right")
    for panel in panels[1]:
        panel.set_xlabel("frequency, mHz")
    for panel in panels[:, 0]:
        panel.set_ylabel("amplitude, rad/s²")
    return figure


def degrees(torque):
    """Rms of each degree and axis, and the part of the test mass.

    Parameters
    ----------
    torque : Dataset, "gradient_torque.torque"
    """
    figure, panels = grid(1, 1, 2.4)
    panel, n = panels[0, 0], torque["degree"].values
    for axis, colour in enumerate(("blue", "vermilion", "green")):
        rms, own = (
            np.where(torque[k].values[:, axis] > 0, torque[k].values[:, axis], np.nan) for k in ("rms", "test_mass_rms")
        )
        panel.semilogy(n, rms, "o-", markersize=3, color=COLOURS[colour], label=f"about {'xyz'[axis]}")
        if np.isfinite(own).any():
            panel.semilogy(n, own, "x:", markersize=3, color=COLOURS[colour], label=f"test mass about {'xyz'[axis]}")
    panel.axhline(torque["sensitivity"].values.mean(), color=COLOURS["black"], linestyle="--", label="sensor, one line")
    panel.set(xlabel="zonal degree", ylabel="rms, rad/s²", xticks=n[::2])
    legend(figure, panel, 7)
    return figure


def errors(combined):
    """Amplitude of drag, of the bare reading's error and of each method's, with noise and without.

    Parameters
    ----------
    combined : Dataset, "gradient_torque.combine"; None where the truth is not known
    """
    if not np.isfinite(combined["error_rms"].values).any():
        return None
    figure, panels = grid(1, 2, 3.2, sharex=True, sharey=True, margins={"wspace": 0.06})
    edges = np.geomspace(combined["frequency"].values[0], combined["frequency"].values[-1], 140)
    names = [str(name) for name in combined["method"].values]
    for panel, key, title in zip(panels[0], ("error", "clean_error"), ("with sensor noise", "without"), strict=True):
        _binned(panel, combined, combined["drag_amplitude"].values, edges, ("black", "drag as estimated"))
        for name, (colour, label) in (PRINTED | METHODS).items():
            if name in names:
                values = combined[f"{key}_amplitude"].values[names.index(name)]
                _binned(panel, combined, values, edges, (colour, f"error, {label}"))
        panel.set_title(title)
        panel.set_xlabel("frequency, mHz")
    panels[0, 0].set_ylabel("amplitude, m/s²")
    panels[0, 0].set_ylim(1e-19, 1e-6)
    legend(figure, panels[0, 0], 4)
    return figure


def _binned(panel, combined, amplitude, edges, style):
    """Rms amplitude of all axes in bins of frequency."""
    frequency = combined["frequency"].values
    power = np.sum(amplitude**2, axis=0)
    index = np.digitize(frequency, edges)
    bins = np.unique(index)
    x = [1e3 * frequency[index == b].mean() for b in bins]
    y = [np.sqrt(power[index == b].mean()) for b in bins]
    panel.loglog(x, np.maximum(y, 1e-30), color=COLOURS[style[0]], label=style[1])


def series(given):
    """Drag by the one-sensor method, and the difference of the others to it.

    Parameters
    ----------
    given : {name: Dataset} of the products
    """
    figure, panels = grid(2, 3, 3.4, sharex=True, margins={"hspace": 0.3, "wspace": 0.28})
    one = given["drag.one_sensor"]
    hours = (one["time"].values - one["time"].values[0]) / 3600
    every = slice(None, None, max(1, hours.size // 3000))
    for axis in range(3):
        panels[0, axis].plot(hours[every], 1e9 * one["drag_b"].values[every, axis], color=COLOURS["vermilion"])
        panels[0, axis].set_title(f"drag {'xyz'[axis]}, nm/s²")
        for name, (colour, label) in {"two_sensor": METHODS["two_sensor"], **PRINTED}.items():
            if f"drag.{name}" in given:
                difference = given[f"drag.{name}"]["drag_b"].values - one["drag_b"].values
                panels[1, axis].plot(
                    hours[every], 1e9 * difference[every, axis], color=COLOURS[colour], label=f"{label} minus one"
                )
        panels[1, axis].set_xlabel("hours")
        panels[1, axis].set_title(f"difference {'xyz'[axis]}, nm/s²")
    if panels[1, 0].lines:
        legend(figure, panels[1, 0], 2)
    return figure
