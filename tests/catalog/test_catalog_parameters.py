"""Parameters: values, types, ranges, settings of stages."""

import dataclasses
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.effects import effect
from gravcal.errors import CatalogError

DEMO = """
[lowpass_hz]
value = 1
unit = "Hz"
minimum = 0.1
maximum = 2
stage = "solve"
reason = "invented for this test"
[drift_degree]
value = 2
stage = ["solve", "combine"]
reason = "invented for this test"
[estimate_scale]
value = true
stage = "solve"
reason = "invented for this test"
[dynamics]
value = "full"
allowed = ["full", "published"]
stage = "attitude"
reason = "invented for this test"
[variants]
value = ["mtq", "acc", "sca"]
allowed = ["mtq", "acc", "sca"]
stage = "combine"
reason = "invented for this test"
"""


@pytest.fixture
def demo(tmp_path, monkeypatch):
    """Parameters of an invented calibration."""
    (tmp_path / "parameters").mkdir()
    (tmp_path / "parameters" / "demo.toml").write_text(DEMO)
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    return catalog.parameters("demo")


TYPED = [
    ("lowpass_hz", "0.7", 0.7),
    ("drift_degree", "3", 3),
    ("estimate_scale", "false", False),
    ("dynamics", "published", "published"),
    ("variants", "mtq,sca", ("mtq", "sca")),
    ("lowpass_hz", 1, 1.0),
    ("drift_degree", 1, 1),
]


@pytest.mark.parametrize(("name", "text", "value"), TYPED)
def test_a_text_takes_the_type_of_the_parameter(demo, name, text, value):
    """Contract: `--set name=text` gives the type of the catalogue's value."""
    found = getattr(demo.with_settings({name: text}), name)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("lowpas_hz", "1", "no parameter named 'lowpas_hz'.*Nearest: lowpass_hz"),
        ("lowpass_hz", "7", r"lowpass_hz: found 7\.0; expected between 0\.1 and 2 Hz"),
        ("lowpass_hz", "nan", r"lowpass_hz: found nan; expected a number"),
        ("lowpass_hz", "fast", "found 'fast'; expected a number"),
        ("drift_degree", "2.5", "found '2.5'; expected a whole number"),
        ("estimate_scale", "perhaps", "found 'perhaps'; expected true or false"),
        ("dynamics", "rough", "found 'rough'; expected one of full, published"),
        ("variants", "mtq,gps", "found 'gps'; expected one of"),
    ],
)
def test_a_wrong_setting_is_refused_with_what_was_expected(demo, name, text, message):
    """Contract: unknown name, wrong type, value out of range."""
    with pytest.raises(CatalogError, match=message):
        demo.with_settings({name: text})


def test_every_parameter_has_a_reason_and_a_stage():
    """Contract: no number without its reason, in every parameter file."""
    for calibration in catalog.names("parameters"):
        chosen = catalog.parameters(calibration)
        assert chosen.entries
        for entry in chosen.entries.values():
            assert entry.reason.strip()
            assert entry.stages


def test_names_of_dimensional_parameters_carry_their_unit():
    """Contract: settings carry the unit in the name; composed units, as of noise densities, are left to `unit`."""
    for calibration in catalog.names("parameters"):
        for name, entry in catalog.parameters(calibration).entries.items():
            if re.fullmatch("[A-Za-z]+", entry.unit or ""):
                assert entry.unit.lower() in name.lower().split("_"), name


def test_a_stage_gets_its_own_settings_only(demo):
    """Contract: the label of a stage holds what it takes."""
    assert demo.for_stage("combine") == {"drift_degree": 2, "variants": ("mtq", "acc", "sca")}
    with pytest.raises(CatalogError, match="no stage named 'atitude'.*Nearest: attitude"):
        demo.for_stage("atitude")


def test_changed_settings_leave_the_catalogue_as_it_was(demo):
    """Contract: parameters are frozen; with_settings gives a new record."""
    changed = demo.with_settings({"drift_degree": "1"})
    assert (demo.drift_degree, changed.drift_degree) == (2, 1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        demo.calibration = "other"


def test_the_prior_of_the_torque_scale_covers_those_of_dipole_and_inertia():
    """Contract: the stage's prior is the catalogue's, rounded to 0.01."""
    for letter in "CD":
        satellite = catalog.satellite(letter)
        dipole = satellite.dipole_per_current.sigma / satellite.dipole_per_current.value
        inertia = np.diag(satellite.inertia.sigma) / np.diag(satellite.inertia.value)
        assert_allclose(catalog.parameters("com_offset").torque_scale_sigma, np.hypot(dipole, inertia), atol=0.01)


def test_the_prior_of_the_angular_scale_is_the_plausible_size_of_its_effect():
    """Contract: estimator and discovery take the scale of the angular accelerometer for as uncertain."""
    sizes = {one.prior_sigma for one in effect("accelerometer.angular_scale").parameters}
    assert sizes == {catalog.parameters("com_offset").angular_scale_sigma}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lowpass_hz = 1.0\n", 'lowpass_hz: found 1.0 is not of type "object"'),
        ("[a_s]\nvalue = 1\nstage = 'x'\n", '"reason" is a required'),
        ("[a_s]\nvalue = 1\nstage = 'x'\nreason = ''\n", r"a_s\.reason"),
        (
            "[a_s]\nvalue = 1\nunit = 's'\nmaximum = 0.5\nstage = 'x'\nreason = 'r'\n",
            r"a_s: found 1\.0; expected between",
        ),
        ("[a_s]\nvalue = 1\nstage = 'x'\nreason = 'r'\ndefault = 3\n", "'default' was unexpected"),
    ],
)
def test_a_broken_parameter_file_says_file_key_found_and_expected(tmp_path, monkeypatch, text, message):
    """Contract: the file is checked when it is read."""
    (tmp_path / "parameters").mkdir()
    (tmp_path / "parameters" / "com_offset.toml").write_text(text)
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    with pytest.raises(CatalogError, match=message):
        catalog.parameters("com_offset")
