"""Report page of an inertial-sensor event: one self-contained HTML text."""

from __future__ import annotations

from gravcal.report import inertial_sensor_figures as figures
from gravcal.report import inertial_sensor_tables as tables
from gravcal.report.pages import figure, numbered, render, section, traced
from gravcal.report.plain import gps_text

WANDERS = "Measured minus predicted attitude, means of bins. The prediction integrates the readouts twice, their noise "
WANDERS += "too: it wanders by 0.1 to 1 mrad in minutes, and has that weight in the estimate."


def page(document, given, published):
    """Page of one event.

    Parameters
    ----------
    document : dict of `gravcal.report.inertial_sensor.document`
    given : {name: Dataset} of the products
    published : {section: records}
    """
    sections = [section("Motion", [], [_figure(figures.motion, given, "detect", "Body rates, means over a minute.")])]
    if "scale" in given:
        sections += _swing(document, given, published)
    if "bias" in given:
        sections += _roll(document, given, published)
    return render(
        "inertial_sensor.html",
        document=document,
        verdict=document["verdict"]["text"].replace("+-", "±").replace(" um", " µm"),
        subtitle=_subtitle(document),
        sections=traced(numbered(sections), document["provenance"]["products"]),
        settings=_flat(document["settings"]),
        provenance=_flat(document["provenance"]),
    )


def _subtitle(document):
    spans = [f"{m['kind']} {gps_text(m['start'])} to {gps_text(m['stop'])}" for m in document["manoeuvres"]]
    return f"{'; '.join(spans) or 'No manoeuvre'} GPS. Vectors from the centre of mass to the test mass, sensor frame."


def _figure(draw, given, name, caption):
    """One figure of one product."""
    return figure(draw, given[name], source=f"inertial_sensor.{name}", title=caption.split(".")[0], caption=caption)


def _from(name, *own):
    """Tables with the product they were read from."""
    return [one | {"source": f"inertial_sensor.{name}"} for one in own]


def _swing(document, given, published):
    """Sections of the swing."""
    scale = [
        _figure(figures.swing, given, "scale", "Swing: angular readouts, angular acceleration, attitude."),
        _figure(figures.convergence, given, "scale", "Kalman filter against batch least squares."),
        _figure(figures.residuals, given, "scale", WANDERS),
        _figure(figures.filtering, given, "align", "Readouts before and after the CRN filter of the published method."),
    ]
    moved = [
        _figure(figures.offset, given, "offset", "Linear readings, slow part removed, and the term of the offset."),
        _figure(
            figures.offset_convergence, given, "offset", "Offset by the Kalman filter against batch least squares."
        ),
    ]
    notes = [f"{name}: {why}." for name, why in document["not_determined"].items() if "bias" not in name]
    own = _from("scale", tables.factors(document, published), tables.arms(document), tables.factor_budget(document))
    own.append(tables.actuation(published))
    found = _from("offset", tables.offset(document, published), tables.budget(document))
    return [
        section("Scale factors", own, scale, [_delay(document), *notes]),
        section("Offset", found, moved, [OFFSET_NOTE]),
    ]


OFFSET_NOTE = (
    "The scale calibration of the swing cancels in the offset: its systematic error is that of J/(M l), 3 to 4 % "
    "(errata T-6, T-11), and for z that of k_y, which nothing in orbit determines. Printed errors hold neither."
)


def _delay(document):
    delay = document["swing"]["delay_s"]
    agree = document["swing"]["filter_minus_batch"]["sigmas"]
    return (
        f"Star-tracker tags later than those of the sensor by {delay['value']:.4f} ± {delay['sigma']:.4f} s. "
        f"Kalman filter and batch differ by {agree:.1e} standard deviations at the end."
    )


def _roll(document, given, published):
    """Sections of the roll."""
    roll = document["roll"]
    noise = roll["z_noise"]
    if "bias" in document["not_determined"]:
        return [section("Bias", [], [], [f"Not determined: {document['not_determined']['bias']}"])]
    notes = [
        f"{roll['segments']} of {roll['segments_found']} segments used. Scale factors and offset: {roll['source']}.",
        f"b_y: {document['not_determined']['bias_y']}.",
    ]
    spectrum = (
        f"Between 10 and 50 mHz {noise['before_m_s2_rthz']:.1e} m s⁻² Hz⁻¹ᐟ² with the factor of the ground, "
        f"{noise['after_m_s2_rthz']:.1e} now: {noise['ratio']:.3f} of before. The change of k_z alone gives "
        f"{noise['ratio_of_factors']:.3f}; only the rest is less noise."
    )
    own = _from("bias", tables.bias(document, published), tables.bias_budget(document))
    drawn = [_figure(figures.segments, given, "bias", "Bias of every segment and uniformity of the roll rate.")]
    z = _figure(figures.z_noise, given, "bias", "Amplitude spectrum of z, median of the segments.")
    return [section("Bias", own, drawn, notes), section("Noise of z", [], [z], [spectrum])]


def _flat(values, before=""):
    """Names and texts of nested settings or provenance."""
    rows = []
    for name, value in sorted(values.items()):
        if isinstance(value, dict):
            rows += _flat(value, f"{name}: " if name != "products" else "")
        else:
            rows.append((f"{before}{name}", ", ".join(map(str, value)) if isinstance(value, list) else str(value)))
    return rows
