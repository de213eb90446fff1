"""Page of a discovery: a panel for each finding, and what is said of it."""

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from gravcal.estimation.outcome import Change, Gain, HeldoutGain, NamedCause, Outcome, Readings, Shown, Unexplained
from gravcal.estimation.quantities import tabled
from gravcal.estimation.records import Parameter
from gravcal.report import discovery
from gravcal.report import discovery_words as words

CHANGE = Change(("x", "y"), "um", "mtq", (), (2.0, 1.0), (55.1, 2.0), (1.9, 1.0), (-12.3, 0.1), (), (), ())


def outcome(*findings, p=(0.0, 0.4), quiet=1.0, change=CHANGE, number=0):
    """Outcome of a search; the reading of a finding of that number is shown."""
    readings = Readings((Shown(number, "linear", "manoeuvre 2", 1),), (12.0,))
    some = (), findings, (), Unexplained(), change, Gain(9.0, 8.0, 9, 8, 1.0, -4.5, -4.0, 0.0, {}, {}), (), {}
    return Outcome(False, True, *p, 1.0, quiet, 0.005, *some, readings=readings)


#: What a finding adds: it follows the square wave, happens once, or is a line of its own.
ADDED = {
    "follows": lambda time: 1e-10 * np.sign(np.sin(2 * np.pi * time / 12)),
    "stepped": lambda time: 1e-10 * (time > 80),
    "waved": lambda time: 1e-10 * np.sin(2 * np.pi * time / 7.3),
}


def found(added, number=0, parameters=None):
    """Product with a linear reading of some nm s-2, 200 s of one manoeuvre of period 12 s; `added` by the finding."""
    time = np.arange(0.0, 200.0, 0.5)
    square = 5e-9 * np.sign(np.sin(2 * np.pi * time / 12))[:, None] * np.ones(3)
    noise = 1e-11 * np.random.default_rng(3).standard_normal((time.size, 3))
    values = {"measured": square + ADDED[added](time)[:, None] + noise, "simulated": square}
    values["extended"] = square + ADDED[added](time)[:, None] if number >= 0 else np.full_like(square, np.nan)
    data = {f"linear_{part}": (("linear_time", "axis"), v, {"units": "m s-2"}) for part, v in values.items()}
    data["linear_finding"] = ("linear_time", np.full(time.size, float(number)))
    findings = [finding("case.a", **(parameters or {}))] if number >= 0 else []
    return tabled(xr.Dataset(data, {"linear_time": 6e8 + time}), outcome(*findings, number=number))


@pytest.mark.parametrize(
    ("added", "parameters", "period"),
    [
        ("follows", {}, 12.0),
        ("stepped", {}, None),
        ("waved", {"frequency": (1 / 7.3, None, "Hz")}, 7.3),
        ("waved", {}, None),
    ],
)
def test_a_finding_is_folded_over_the_period_that_it_has(added, parameters, period):
    """Contract: that of the manoeuvre or its own, against time where it repeats in neither."""
    product = found(added, parameters=parameters)
    assert discovery.fold(product, 0) == (pytest.approx(period) if period else None)
    figure = discovery.reading(product, 0)
    assert figure.axes[1].get_xlabel() == ("phase (s)" if period else "time from the first sample (s)")
    assert ("Folded over" in discovery.caption(product, 0, {})) == bool(period)


def test_a_panel_shows_reading_and_difference_in_units_and_what_is_not_named_no_model():
    """Contract: measured, simulated, extended; what either leaves, with a prefix; the least likely band unexplained."""
    figure = discovery.reading(found("follows"), 0)
    assert [panel.get_ylabel() for panel in figure.axes] == ["linear y (nm s⁻²)", "difference (pm s⁻²)"]
    left = {bars.get_label(): bars.lines[0].get_ydata() for bars in figure.axes[1].containers}
    assert np.abs(left["simulated without it"]).mean() == pytest.approx(100, rel=0.1)  # pm s-2
    assert np.abs(left["extended model"]).max() < 10
    product = found("follows", number=-1)
    figure = discovery.reading(product, -1)
    assert "extended model" not in figure.axes[0].get_legend_handles_labels()[1]
    assert "least likely band" in discovery.caption(product, -1, {})
    product = found("follows")
    assert (discovery.reading(product, 1), discovery.caption(product, 1, {})) == (None, "")
    assert discovery.shown(product.drop_vars("linear_measured"), 0) is None


def finding(cause, form="", **parameters):
    """A finding with {name: (value, sigma, unit)}."""
    rows, listed = {n: Parameter(*row) for n, row in parameters.items()}, not cause.startswith("unknown:")
    known = {"significance": 1e-9, "level": 0.005, "heldout": "blocks", "heldout_gain": HeldoutGain(9.0, 10.0, 1)}
    known |= {"tied_with": (), "adopted": True, "in_catalogue": listed, "separation": (), "imitators": ()}
    return NamedCause(cause, form, rows, model=rows, **known)


def test_a_law_in_no_list_is_a_sentence_with_numbers():
    """Contract: in words and symbols, by how much and with which error."""
    law = "linear reading, a memory of the size of the current, tau 39.8 s"
    sizes = {"linear_x": (1e-11, 2e-10, "m s-2"), "linear_z": (6.1e-9, 2.1e-10, "m s-2"), "tau": (39.8, 2.2, "s")}
    assert words.sentence(finding("unknown:torquer_current", law, **sizes)) == (
        "An effect in no list that follows torquer current: linear reading follows a memory of the size of the "
        "current; Δa = A u, where τ du/dt + u = |x|, x = the current, of size one, A(z) = 6.10 ± 0.21 nm s⁻², "
        "τ = 39.8 ± 2.2 s."
    )
    text = words.sentence(finding("unknown:latitude", "wave of 4 a", linear_z_sine=(6e-9, 2e-10, "m s-2")))
    assert "C cos u + S sin u, where u = 4 a, S(z) = 6.00 ± 0.20 nm s⁻²" in text


def test_every_effect_of_the_catalogue_has_a_sentence():
    """Contract: no slug of a parameter is left in it."""
    from gravcal import effects

    for slug, effect in effects.catalogue().items():
        for parameter in effect.parameters:
            text = words.sentence(finding(slug, **{parameter.name: (0.5, 0.01, parameter.unit)}))
            assert not re.search("[a-z]_", text.replace(parameter.name, "")), text
    text = words.sentence(finding("accelerometer.temperature", y_1=(3e-9, 1e-10, "m s-2")))  # of one of two sensors
    assert text.startswith("The change from long night to long day of y of sensor 1 is 3.00 ± 0.10 nm s⁻²")
    text = words.sentence(finding("unknown:torquer torque", "x alone", x=(-3.26, 0.81, "1")))  # no law
    assert text == "The share in x is −326 ± 81 % (an effect in no list that follows torquer torque)."


def test_a_form_that_was_named_has_its_own_size_beside_what_is_left_if_all_are_free():
    """Contract: sentence and first row of the table say the size of the form, rows below it all parameters."""
    all_free = {"z_from_x": (2e-11, 1.2e-11, "m s-2 A-1 m-2"), "z_from_y": (-2e-11, 1e-11, "m s-2 A-1 m-2")}
    model = {"z_from_x": Parameter(3e-11, 5e-13, "m s-2 A-1 m-2")}
    one = replace(finding("accelerometer.current_leak", "z_from_x alone", **all_free), model=model)
    assert words.sentence(one).endswith(
        "along x is 30.00 ± 0.50 pm s⁻² A⁻¹ m⁻² (accelerometer: current leak; alone, with 1 more in the table)."
    )
    first, *others = discovery.findings_table([one]).rows
    assert first[1] == "z_from_x alone"
    assert [row[-2] for row in (first, *others)] == ["30.00 ± 0.50", "20 ± 12", "−20 ± 10"]


def test_the_verdict_says_what_moves_and_alarms():
    """Contract: moves in the unit of the result; too little power is said beside a finding as well."""
    one = finding("torque.dipole_gain", rod_x=(-0.02, 0.001, "1"))
    text = words.verdict(outcome(one, quiet=1e-5))
    assert "2.00 ± 0.10 % smaller than the catalogue says" in text
    assert "The result moves: x by −12.3 to 55.1 ± 1.9 um." in text
    assert "ALARM" in text
    assert "ALARM" not in words.verdict(outcome(one, quiet=0.3))
    mixed = replace(CHANGE, unit="1e-6 rad s-2 V-1, um", after=(39567.0, 2.0), sigma_after=(228.0, 1.0))
    text = words.verdict(outcome(one, change=mixed))
    assert "x by −0.01 to 39.57 ± 0.23 mrad s⁻² V⁻¹" in text
