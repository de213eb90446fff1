"""The catalogue: what it holds, how it is asked, what it says when asked wrongly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.errors import CatalogError


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A user's own catalogue, empty."""
    for kind in ("satellites", "events", "parameters"):
        (tmp_path / kind).mkdir()
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    return tmp_path


HEADING = 'letter = "Z"\nmission = "none"\nplatform = "ZED 1"\nlaunched = 2030-01-01\n'
MASS = '[mass]\nvalue = 100.0\nunit = "kg"\nframe = "none"\nsigma = 1.0\nsource = "invented"\n'


@pytest.mark.parametrize("name", ["C", "c", "grace-c", "GRACE-C", "GRACE C", "grace_c"])
def test_a_satellite_answers_to_its_letter_and_its_names(name):
    """Contract: all spellings lead to one satellite."""
    assert catalog.satellite(name).name == "grace-c"


def test_every_quantity_of_every_satellite_has_unit_frame_sigma_and_source():
    """Contract: value, unit, frame, sigma, source, always in this order."""
    for name in catalog.names("satellites"):
        _, content = catalog.read("satellites", name)
        tables = {key: table for key, table in content.items() if isinstance(table, dict)}
        assert tables
        for key, table in tables.items():
            assert tuple(table) == ("value", "unit", "frame", "sigma", "source"), f"{name}.{key}"
        assert set(catalog.satellite(name).quantities) == set(tables)


def test_a_quantity_is_read_only():
    """Contract: nobody changes a constant in passing."""
    value = catalog.satellite("C").com_to_antenna.value
    with pytest.raises(ValueError, match="read-only"):
        value[0] = 0.0


def test_settings_are_plain_numbers_with_sigmas_beside_them():
    """Contract: settings of a stage are floats and lists, so that they can stand in a key."""
    settings = catalog.satellite("C").settings("inertia", "mass_at_launch")
    assert settings["mass_at_launch"] == 600.2
    assert settings["inertia"][1][1] == 580.67
    assert sorted(settings) == ["inertia", "inertia_sigma", "mass_at_launch", "mass_at_launch_sigma"]
    assert isinstance(settings["inertia"][0], list)


def test_inertia_says_that_it_is_assumed():
    """Contract: what no source gives says so, with a prior."""
    for letter in "CD":
        inertia = catalog.satellite(letter).inertia
        assert inertia.source.startswith("assumed, no source reached")
        assert np.all(inertia.sigma > 0)
        assert_allclose(inertia.value, inertia.value.T, atol=0)


def test_star_camera_mountings_are_unit_quaternions():
    """Published: QSA1B, rounding of its last digit 1e-15 (C) and of stored numbers 1e-14."""
    for letter in "CD":
        assert_allclose(np.linalg.norm(catalog.satellite(letter).star_camera_mounting.value, axis=1), 1, atol=1e-9)


def test_nearest_names_are_offered_for_an_unknown_satellite_and_quantity():
    """Contract: an error says what may have been meant."""
    with pytest.raises(CatalogError, match=r"'grace-x'.*Nearest:.*grace-"):
        catalog.satellite("grace-x")
    with pytest.raises(CatalogError, match="com_to_antena.*Nearest: com_to_antenna"):
        _ = catalog.satellite("C").com_to_antena


def test_a_users_own_satellite_is_found_first(own_folder):
    """Contract: GRAVCAL_CATALOG adds and overrides."""
    (own_folder / "satellites" / "zed.toml").write_text(HEADING + MASS)
    (own_folder / "satellites" / "grace-c.toml").write_text(HEADING.replace("Z", "C", 1) + MASS)
    assert catalog.satellite("Z").mass.value == 100.0
    assert catalog.satellite("C").mission == "none"
    assert catalog.satellite("D").mission == "GRACE-FO"


def test_a_missing_own_folder_is_an_error(tmp_path, monkeypatch):
    """Contract: a wrong GRAVCAL_CATALOG is not passed over."""
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path / "nowhere"))
    with pytest.raises(CatalogError, match=r"GRAVCAL_CATALOG.*expected a folder.*unset"):
        catalog.satellite("C")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADING + MASS.replace('source = "invented"\n', ""), r'zed\.toml: mass: found "source" is a required'),
        (HEADING + MASS + "colour = 1\n", r"mass: .*'colour' was unexpected"),
        (HEADING + MASS.replace('"none"', '"srf"'), r'mass\.frame: found "srf" is not one of'),
        (HEADING + MASS.replace("100.0", "nan"), r"mass\.value: found nan; expected finite numbers"),
        (HEADING + MASS.replace("100.0", "[[1, 2], [3]]"), r"mass\.value.*expected a full list"),
        (HEADING + MASS.replace("sigma = 1.0", "sigma = [1.0, 2.0]"), r"mass\.sigma.*shape of the value"),
        (HEADING + MASS.replace("sigma = 1.0", "sigma = -1.0"), r"mass\.sigma.*no negative"),
        (HEADING + MASS.replace('"kg"', '""'), r'mass\.unit: found ""'),
        (HEADING.replace("2030-01-01", '"2030"') + MASS, r'launched: found "2030" does not match'),
        (HEADING + "weight = 3\n" + MASS, r"weight: found 3 is not of type"),
        (MASS, r'"letter" is a required'),
        ("letter = \n", r"zed\.toml: .*not valid TOML.*line 1"),
    ],
)
def test_a_broken_satellite_file_says_file_key_found_and_expected(own_folder, text, message):
    """Contract: every departure from the form is named."""
    (own_folder / "satellites" / "zed.toml").write_text(text)
    with pytest.raises(CatalogError, match=message):
        catalog.satellite("zed")
