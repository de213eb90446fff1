"""Figures of an inertial-sensor event: the swing, its filter, the offset, the roll and the noise of z."""

from __future__ import annotations

import numpy as np

from gravcal.report.figures import COLOURS, grid, legend
from gravcal.report.plain import AXES

AXIS_COLOURS = (COLOURS["vermilion"], COLOURS["blue"], COLOURS["green"])
WIDE = {"left": 0.1, "right": 0.985, "hspace": 0.42, "wspace": 0.3}


def swing(scaled):
    """Angular readouts, angular acceleration and attitude of the swing.

    Parameters
    ----------
    scaled : Dataset, "inertial_sensor.scale"
    """
    figure, panels = grid(3, 1, 4.6, sharex=True, margins=WIDE)
    time = scaled.time_bin.values - scaled.time_bin.values[0]
    rows = (
        (1e3 * _centred(scaled.angular_volt.values), "readout (mV)"),
        (1e6 * _centred(scaled.rate_dot_b.values), "angular acc. (µrad s$^{-2}$)"),
        (1e6 * scaled.angle_b.values, "attitude (µrad)"),
    )
    for panel, (values, name) in zip(panels[:, 0], rows, strict=True):
        for axis in (2, 1, 0):
            panel.plot(time, values[:, axis], color=AXIS_COLOURS[axis], label=AXES[axis])
        panel.set_ylabel(name)
    panels[-1, 0].set_xlabel("time (s)")
    legend(figure, panels[0, 0], 3)
    return figure


def _centred(values):
    return values - np.nanmean(values, axis=0)


def residuals(scaled):
    """Measured minus predicted attitude with the noise of a bin.

    Parameters
    ----------
    scaled : Dataset, "inertial_sensor.scale"
    """
    figure, panels = grid(1, 3, 2.0, sharey=True, margins=WIDE | {"wspace": 0.1})
    time = scaled.time_bin.values - scaled.time_bin.values[0]
    for axis, panel in enumerate(panels[0]):
        panel.plot(time, 1e6 * scaled.residual_b.values[:, axis], color=AXIS_COLOURS[axis], linewidth=0.7)
        panel.set_title(AXES[axis])
        panel.set_xlabel("time (s)")
    panels[0, 0].set_ylabel("residual (µrad)")
    return figure


def convergence(scaled):
    """Kalman estimate and its error over time, with the batch value.

    Parameters
    ----------
    scaled : Dataset, "inertial_sensor.scale"
    """
    figure, panels = grid(1, 3, 2.1, margins=WIDE | {"wspace": 0.38})
    time = scaled.time_bin.values - scaled.time_bin.values[0]
    names = ("β$_x$ (rad s$^{-2}$ V$^{-1}$)", "β$_y$ (rad s$^{-2}$ V$^{-1}$)", "delay (s)")
    for column, (panel, name) in enumerate(zip(panels[0], names, strict=True)):
        batch = float(scaled.batch_value[column])
        _converging(panel, time, scaled.filter_value.values[:, column], scaled.filter_sigma.values[:, column], batch)
        panel.set_title(name)
        panel.set_xlabel("time (s)")
    legend(figure, panels[0, 0], 3)
    return figure


def _converging(panel, time, value, sigma, end):
    """One estimate over time; the scale is that of its later part."""
    late = time > 0.2 * time[-1]
    panel.fill_between(time, value - sigma, value + sigma, color=COLOURS["sky"], alpha=0.4, linewidth=0, label="± σ")
    panel.plot(time, value, color=COLOURS["blue"], label="filter")
    panel.axhline(end, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="batch")
    reach = 1.3 * np.max(np.abs(value[late] - end) + sigma[late])
    panel.set_ylim(end - reach, end + reach)


def filtering(aligned):
    """Amplitude spectra of the common-mode readouts before and after the CRN filter.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"
    """
    from gravcal.calibrations.inertial_sensor.scale import filtered_readouts

    step, before, after = filtered_readouts(aligned)
    figure, panels = grid(1, 3, 2.2, sharey=True, margins=WIDE | {"wspace": 0.1})
    for panel, column, name in zip(panels[0], (0, 3, 4), ("a$_x$", "angular x", "angular y"), strict=True):
        for values, colour, label in ((before, "grey", "before"), (after, "vermilion", "after CRN")):
            frequency, density = _density(values[:, column], step)
            panel.loglog(frequency, density, color=COLOURS[colour], linewidth=0.7, label=label)
        panel.set_title(name)
        panel.set_xlabel("frequency (Hz)")
    panels[0, 0].set_ylabel("density (V Hz$^{-1/2}$)")
    panels[0, 0].set_ylim(1e-9, 1e-1)
    legend(figure, panels[0, 0], 2)
    return figure


def _density(values, step):
    """One-sided amplitude density, tapered by a cosine bell."""
    taper = np.hanning(values.size)
    power = 2 * step * np.abs(np.fft.rfft(taper * (values - values.mean()))) ** 2 / np.sum(taper**2)
    return np.fft.rfftfreq(values.size, step)[1:], np.sqrt(power)[1:]


def offset(moved):
    """Linear readings of the swing with the fitted term of the offset.

    Parameters
    ----------
    moved : Dataset, "inertial_sensor.offset"
    """
    figure, panels = grid(3, 1, 4.4, sharex=True, margins=WIDE)
    time = moved.time_bin.values - moved.time_bin.values[0]
    for axis, panel in enumerate(panels[:, 0]):
        panel.plot(time, 1e9 * moved.reading.values[:, axis], color=COLOURS["grey"], linewidth=0.6, label="reading")
        panel.plot(time, 1e9 * moved.model.values[:, axis], color=AXIS_COLOURS[axis], label="model")
        panel.set_ylabel(f"f$_{AXES[axis]}$ (nm s$^{{-2}}$)")
    panels[-1, 0].set_xlabel("time (s)")
    legend(figure, panels[2, 0], 2)
    return figure


def offset_convergence(moved):
    """Kalman estimate of the offset over time.

    Parameters
    ----------
    moved : Dataset, "inertial_sensor.offset"
    """
    figure, panels = grid(1, 3, 2.1, margins=WIDE | {"wspace": 0.38})
    time = moved.time_bin.values - moved.time_bin.values[0]
    for axis, panel in enumerate(panels[0]):
        value, sigma = (1e6 * moved[name].values[:, axis] for name in ("filter_value", "filter_sigma"))
        _converging(panel, time, value, sigma, 1e6 * float(moved.offset[0, axis]))
        panel.set_title(f"{AXES[axis]} (µm)")
        panel.set_xlabel("time (s)")
    legend(figure, panels[0, 0], 3)
    return figure


def segments(biased):
    """Bias of every segment, those left out hollow, with the robust mean.

    Parameters
    ----------
    biased : Dataset, "inertial_sensor.bias"
    """
    figure, panels = grid(4, 1, 5.6, sharex=True, margins=WIDE)
    time = (biased.time_segment.values - biased.time_segment.values[0]) / 86400
    used = biased.used.values.astype(bool)
    for axis in range(3):
        panel, mean = panels[axis, 0], float(biased.bias[axis])
        value = 1e9 * (biased.segment_bias.values[:, axis] - mean)
        panel.plot(time[~used], value[~used], "o", mfc="none", color=COLOURS["grey"], markersize=2.5, label="left out")
        panel.plot(time[used], value[used], ".", color=AXIS_COLOURS[axis], markersize=3, label="used")
        panel.axhline(0, color=COLOURS["black"], linewidth=0.7)
        reach = 1.4 * np.max(np.abs(value[used]))
        panel.set_ylim(-reach, reach)
        name = "b" if biased.separable[axis] else "b - a"
        panel.set_ylabel(f"{name}$_{AXES[axis]}$ (nm s$^{{-2}}$)")
        panel.set_title(f"minus {mean:.6e} m s$^{{-2}}$")
    panels[3, 0].semilogy(time, 100 * biased.uniformity.values, ".", color=COLOURS["black"], markersize=3)
    panels[3, 0].set_ylabel("rate scatter (%)")
    panels[3, 0].set_xlabel("time (days)")
    legend(figure, panels[0, 0], 2)
    return figure


def z_noise(biased):
    """Amplitude spectrum of z with the old factor, the new one, and with everything modelled taken off.

    Parameters
    ----------
    biased : Dataset, "inertial_sensor.bias"
    """
    figure, panels = grid(1, 1, 2.6, margins=WIDE)
    names = ("factor of the ground", "factor of the swing", "and motion, drag, trend taken off")
    for row, colour, name in zip(biased.density.values, ("grey", "sky", "vermilion"), names, strict=True):
        panels[0, 0].loglog(biased.frequency.values, row, color=COLOURS[colour], label=name)
    panels[0, 0].axhline(3e-9, color=COLOURS["black"], linewidth=0.7, linestyle="--", label="requirement")
    panels[0, 0].set_xlabel("frequency (Hz)")
    panels[0, 0].set_ylabel("density (m s$^{-2}$ Hz$^{-1/2}$)")
    legend(figure, panels[0, 0], 4)
    return figure


def motion(detected):
    """Body rates over the whole record.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    """
    figure, panels = grid(1, 1, 1.9, margins=WIDE | {"bottom": 0.2})
    time = (detected.time.values - detected.time.values[0]) / 3600
    gap = np.append(np.diff(time) > 0.1, False)
    for axis in range(3):
        rate = np.where(gap, np.nan, 1e3 * detected.rate_b.values[:, axis])
        panels[0, 0].plot(time, rate, color=AXIS_COLOURS[axis], label=AXES[axis])
    panels[0, 0].set_xlabel("time (h)")
    panels[0, 0].set_ylabel("rate (mrad s$^{-1}$)")
    legend(figure, panels[0, 0], 3)
    return figure
