"""Report page of a gradient-torque event: one self-contained HTML text."""

from __future__ import annotations

from gravcal.report import gradient_torque_figures as figures
from gravcal.report.gradient_torque import NAMES
from gravcal.report.pages import figure, numbered, render, section, table, traced
from gravcal.report.plain import gps_text

TORQUE_NOTES = (
    "Angular acceleration of the test mass relative to the satellite from one zonal term at a time. Degree 1 is empty: "
    "the origin is the centre of mass, C10 = 0 (erratum S-9). The satellite alone makes the signal where the test mass "
    "is a cube: its torque vanishes (erratum S-5); elongation lets it appear.",
)
KNOWLEDGE_NOTES = (
    "One epoch gives six numbers for five elements of the gradient tensor and three of the drag: two combinations stay "
    "unseen, and both contain the diagonal of the tensor, which enters no torque. The printed pair of equations has "
    "rank 5 for 6 unknowns; quaternion inversion fills the gap with a relation without physical ground (erratum S-6).",
    "Below, several epochs together, one piece of knowledge after the other, and the standard deviation of the drag in "
    "the middle. The torque balance hardly moves it: it tells the centre of pressure, not the drag.",
)


def page(document, given):
    """Page of one event.

    Parameters
    ----------
    document : dict of `gravcal.report.gradient_torque.document`
    given : {name: Dataset} of the products
    """
    sections = [_drag(document, given), _torque(document, given), _knowledge(document)]
    return render(
        "gradient_torque.html",
        document=document,
        verdict=document["verdict"]["text"].replace("m/s2", "m/s²"),
        subtitle=_subtitle(given["gradient"]),
        sections=traced(numbered(sections), document["provenance"]["products"]),
        settings=[(name, str(value)) for name, value in document["settings"].items()],
        provenance=list(document["provenance"]["products"].items()),
    )


def _subtitle(modelled):
    time, sensors = modelled["time"].values, modelled.sizes["sensor"]
    chi2 = ", ".join(
        f"{c / d:.3f}" for c, d in zip(modelled.attitude_chi2.values, modelled.attitude_dof.values, strict=True)
    )
    span = f"{gps_text(time[0])} to {gps_text(time[-1])} GPS, {time.size} epochs"
    return f"{span}, {sensors} sensor{'s' * (sensors > 1)}. Attitude fit, chi-square over degrees of freedom: {chi2}."


def _drag(document, given):
    """Errors of the methods."""
    drawn = [
        _figure(
            figures.errors,
            (given["combine"],),
            "gradient_torque.combine",
            "Errors of the methods in amplitude, with and without sensor noise; as figures 8 and 9 of the paper.",
        ),
        _figure(
            figures.series,
            (given,),
            _drags(document),
            "Drag of the one-sensor method, and how far the others are from it.",
        ),
    ]
    return section("Drag", [_methods(document), _budget(document)], drawn)


def _torque(document, given):
    """Spectra by zonal degree."""
    drawn = [
        _figure(
            figures.spectra,
            (given["torque"],),
            "gradient_torque.torque",
            "Amplitude by zonal degree, all axes together, against the sensor; grouped as figures 4 to 7 of the paper.",
        ),
        _figure(figures.degrees, (given["torque"],), "gradient_torque.torque", "Rms by zonal degree and axis."),
    ]
    seen = [
        str(n)
        for n, yes in zip(document["torque"]["degrees"], document["torque"]["above_sensitivity"], strict=True)
        if yes
    ]
    note = (
        f"Degrees with a line above three times the sensor's noise: {', '.join(seen) or 'none'} (sensitivity assumed)."
    )
    return section("Gravity-gradient torque", [], drawn, (*TORQUE_NOTES, note))


def _knowledge(document):
    """Identifiability."""
    found = document["identifiability"]
    heads = ["known", "rank", "unknowns", "σ drag x", "σ drag y", "σ drag z"]
    rows = [[k["known"], k["rank"], k["unknowns"], *(_short(s) for s in k["drag_sigma"])] for k in found["knowledge"]]
    steps = table("Joint system of several epochs, m/s²", heads, rows, source="gradient_torque.combine")
    names = found["null_space"]["unknowns"]
    null = [[f"{v:+.2f}" for v in vector] for vector in found["null_space"]["vectors"]]
    units = found["null_space"]["units"]
    caption = f"Combinations that one epoch does not see (rank {found['rank']} of {found['unknowns']}); {units}"
    tables = [steps, table(caption, names, null, source="gradient_torque.combine")]
    if "centre_of_pressure_m" in document:
        tables.append(_pressure(document["centre_of_pressure_m"]))
    return section("What one sensor can tell", tables, [], KNOWLEDGE_NOTES)


def _pressure(found):
    rows = [
        [axis, f"{value:+.4f}", f"{sigma:.4f}", f"{prior:.4f}"]
        for axis, value, sigma, prior in zip("xyz", found["value"], found["sigma"], found["prior_sigma"], strict=True)
    ]
    return table(
        "Centre of pressure from the torque balance, m",
        ["axis", "value", "σ", "σ before"],
        rows,
        source="gradient_torque.drag.one_sensor",
    )


def _methods(document):
    """Errors and standard deviations."""
    keys = ("rms_error", "rms_error_without_noise", "rms_error_bare_reading", "sigma_rms", "sigma_total_rms")
    heads = ["method", "error", "without noise", "bare reading", "σ", "σ with places", "error/σ", "printed, order"]
    printed = f"{float(document['settings']['requirement_m_s2']):.0e}"
    rows = [
        [
            NAMES[name],
            *(_short(block[key]) for key in keys),
            "–" if block["error_over_sigma"] is None else f"{block['error_over_sigma']:.3f}",
            "–" if name == "one_sensor" else printed,
        ]
        for name, block in document["drag"].items()
    ]
    return table(
        "Drag, rms over time and axes, m/s² (errors need the truth of a simulation; printed: eqs. 10, 16)",
        heads,
        rows,
        source="gradient_torque.combine",
    )


def _budget(document):
    """Parts of the standard deviation."""
    rows = [
        [NAMES[name], source, *(_short(v) for v in values)]
        for name, block in document["drag"].items()
        for source, values in block["budget"].items()
    ]
    return table(
        "Standard deviation by cause, m/s²",
        ["method", "cause", "x", "y", "z"],
        rows,
        source=_drags(document),
        words=(0, 1),
    )


def _drags(document):
    """Products of all methods, as the provenance lists them."""
    return ", ".join(f"gradient_torque.drag.{name}" for name in document["drag"])


def _figure(draw, given, source, caption):
    """Figure whose title is the first sentence of its caption."""
    return figure(draw, *given, source=source, title=caption.split(".")[0], caption=caption)


def _short(value):
    return "–" if value is None else f"{value:.2e}"
