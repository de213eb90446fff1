"""The result document of a centre-of-mass event."""

import copy
import json

import invented
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.calibrations.com_offset.page import vcm_line
from gravcal.errors import ProductError
from gravcal.io.vcm import read_line
from gravcal.store.schemas import validate


def test_a_delivered_document_fits_its_schema(document):
    """Contract: JSON Schema, no NaN, symmetric covariances."""
    assert document["status"] == "delivered"
    assert document["outliers"] == {"ACC1A": 1, "SCA1B": 0}
    validate(json.loads(json.dumps(document, allow_nan=False)))


def test_offsets_are_in_micrometres_with_their_errors(document):
    """Contract: um and um2 in the document, m in the product."""
    block = document["variants"]["mtq"]
    assert_allclose(block["offset_um"], 1e6 * invented.OFFSET, rtol=1e-12)
    assert_allclose(block["sigma_um"], 1e6 * invented.SIGMA, rtol=1e-12)
    assert block["sigma_total_um"][0] > block["sigma_um"][0]
    assert document["direction"] == "proof_mass_to_com"


def test_what_a_manoeuvre_does_not_determine_is_null(document):
    """Contract: null in value, sigma, row and column, numbers elsewhere."""
    pitch = document["manoeuvres"][0]
    block = pitch["variants"]["acc"]
    assert pitch["kind"] == "pitch"
    assert block["offset_um"][1] is None
    assert block["sigma_um"][1] is None
    assert [row[1] for row in block["covariance_um2"]] == [None] * 3
    assert block["covariance_um2"][1] == [None] * 3
    assert block["covariance_um2"][0][2] is not None


def test_an_undetermined_combination_moves_the_adoption_on(products, documented):
    """Contract: without z in any variant the best of what is there is adopted and z stays null."""
    changed = products | {"combine": invented.combine(3, undetermined=(2,))}
    document = documented(changed)
    validate(document)
    assert document["variants"]["mtq"]["offset_um"][2] is None
    assert document["verdict"]["requirement"][2] == "undetermined"
    assert document["verdict"]["accuracy_met"] is False
    assert vcm_line(document, "C") is None


def test_nothing_determined_is_not_delivered(products, documented):
    """Contract: status failed, no adopted variant, still a valid document."""
    document = documented(products | {"combine": invented.combine(3, undetermined=(0, 1, 2))})
    validate(document)
    assert document["status"] == "failed"
    assert document["adopted"]["variant"] is None


def test_a_record_without_manoeuvre_says_what_was_measured(quiet_document):
    """Contract: status no_manoeuvre, field check, attitude residual, roll response beside the expected one."""
    validate(quiet_document)
    assert quiet_document["status"] == "no_manoeuvre"
    assert quiet_document["manoeuvres"] == []
    assert_allclose(quiet_document["field_check"]["bias_nt"], [500, 0, -300], atol=1)  # noise of 1 nT
    assert_allclose(quiet_document["attitude"]["rms_urad"], 2, rtol=0.2)  # 180 samples
    assert quiet_document["roll_response"]["value"] == pytest.approx(0.00281)
    assert vcm_line(quiet_document, "C") is None
    assert quiet_document["roll_response"]["expected"] == {"value": 0.0028, "sigma": 0.0003}


def test_without_a_combination_there_is_still_a_document(quiet_products, documented):
    """Contract: products that cannot exist may be None."""
    document = documented(quiet_products | {"combine": None, "survey": None})
    validate(document)
    assert document["roll_response"] is None


def test_an_unknown_delay_is_null_in_value_and_error(document):
    """Contract: both or neither."""
    assert document["delays_s"]["sca"] == {"value": None, "sigma": None}
    assert document["delays_s"]["acc"] == {"value": -0.02, "sigma": 0.03}


def test_a_scale_that_repeats_its_prior_is_not_reported(document):
    """Contract: error of 0.1 is the prior, so z of the torque scale is null; x is the mean of three."""
    torque = document["scales"]["torque"]
    assert torque["value"][2] is None
    assert_allclose(torque["sigma"][0], 0.01 / np.sqrt(3))


@pytest.mark.parametrize(("chi2", "verdict"), [(5.0, "consistent"), (50.0, "not consistent")])
def test_the_agreement_of_the_manoeuvres_is_judged_at_its_level(products, documented, chi2, verdict):
    """Analytic: chi-square c of 6 degrees of freedom at a level of 1 %; p = exp(-c/2) (1 + c/2 + (c/2)^2 / 2)."""
    combined = copy.deepcopy(products["combine"])
    combined["chi2"].values[:] = chi2
    test = documented(products | {"combine": combined})["consistency"]["manoeuvres"]
    assert test["verdict"] == verdict
    assert test["p"] == pytest.approx(np.exp(-chi2 / 2) * (1 + chi2 / 2 + chi2**2 / 8), rel=1e-9)
    assert test["variant"] == "mtq"
    assert set(test["by_variant"]) == set(invented.VARIANTS)


def test_the_requirement_is_asked_with_the_error_in_mind(document):
    """Contract: 107 um with a total error of 10 um cannot be told from 100 um."""
    assert document["verdict"]["requirement"] == ["undecided", "within", "within"]
    assert document["verdict"]["accuracy_met"] is True


def test_the_smallest_total_error_is_adopted(products, documented):
    """Issue 20: whatever the noise alone says; a variant that leaves a component open only if all do."""
    combined = copy.deepcopy(products["combine"])
    combined["covariance_total"].values[:] *= np.array([9.0, 4.0, 2.0, 3.0])[:, None, None]
    combined["covariance"].values[3] *= 0.1
    assert documented(products | {"combine": combined})["adopted"]["variant"] == "acc"
    combined["determined"].values[:3, 2] = 0
    assert documented(products | {"combine": combined})["adopted"]["variant"] == "sca"


def test_the_adopted_offset_goes_into_a_vcm_line(document):
    """Analytic: round trip; in force from the whole second after the last manoeuvre."""
    record = read_line(vcm_line(document, "C"))
    adopted = document["variants"]["mtq"]["offset_um"]
    assert_allclose(record.values, 1e-6 * np.array(adopted), rtol=1e-12)
    assert record.time == np.ceil(invented.START[-1] + 180)
    assert record.satellite == "C"


@pytest.mark.parametrize("origin", ["simulated", "mixed"])
def test_what_was_not_measured_gives_no_vcm_line_that_can_be_read(document, origin):
    """Contract: the line is a comment that says why; a reader of the format refuses it."""
    line = vcm_line(document | {"origin": origin}, "C")
    assert line.startswith(f"# {origin.upper()} data")
    assert line.endswith(vcm_line(document, "C"))
    with pytest.raises(ProductError):
        read_line(line)
