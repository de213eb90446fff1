"""Result document and page of a centre-of-mass event, from the products of simulated records."""

import json
import re
from types import SimpleNamespace

import com_offset_chain as tools
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.calibrations.com_offset import page
from gravcal.calibrations.com_offset.align import OUTLIER
from gravcal.calibrations.com_offset.model import survey
from gravcal.errors import ProductError
from gravcal.io.vcm import read_line
from gravcal.report import documents
from gravcal.report.plain import plus_minus
from gravcal.store.schemas import validate
from tasks import common

EVENT = "grace-c-2020-02-01"
SETTINGS = catalog.parameters("com_offset").for_report() | tools.SATELLITE
PRINTED = {n: [SimpleNamespace(**one) for one in own] for n, own in common.printed_of("com_offset", EVENT).items()}


def made(**settings):
    """Products of a simulated record, by the names of the report."""
    found = tools.chain(tools.event(7, **settings)[0])
    of_variants = [(kind, found.pop(kind)) for kind in ("solve", "angular_acceleration")]
    named = {f"{kind}.{name}": one for kind, every in of_variants for name, one in every.items()}
    return found | named | {"survey": survey(found["align"], found["field"])}


@pytest.fixture(scope="module")
def products():
    """Products of a pitch, a roll and a yaw."""
    return made(manoeuvres=("pitch_high", "roll_high", "yaw_low"))


@pytest.fixture(scope="module")
def quiet_products():
    """Products of a record without manoeuvre."""
    return made(manoeuvres=(), quiet_s=120.0)


def document_of(products, event=EVENT):
    """Result document."""
    head = {"schema_version": "1.0", "calibration": "com_offset", "event": event}
    known = {"products": {"com_offset.combine": "ab" * 32}, "inputs": {"ACC1A_2020-02-01_C_04.txt": "cd" * 32}}
    found = head | page.result(products, SETTINGS) | {"settings": SETTINGS, "provenance": known}
    return documents.judged(json.loads(json.dumps(found, default=np.ndarray.tolist)), (), [])


@pytest.fixture(scope="module")
def document(products):
    """Document of the event with three manoeuvres."""
    return document_of(products)


def moved(products, stage, **changes):
    """Products with other values in some variables of one of them."""
    one = products[stage]
    values = {name: one[name].copy(data=np.broadcast_to(value, one[name].shape)) for name, value in changes.items()}
    return products | {stage: one.assign(values)}


def undetermined(products, axes):
    """Products whose combination leaves axes open."""
    known = ~np.isin(np.arange(3), axes) & np.ones((4, 1), dtype=bool)
    offset = np.where(known, products["combine"]["offset"].values, np.nan)
    return moved(products, "combine", offset=offset, determined=known.astype(int))


def test_a_document_is_in_micrometres_with_its_errors(products, document):
    """Contract: JSON Schema, no NaN; um of m, both errors; null in value, sigma, row and column without a lever."""
    validate(json.loads(json.dumps(document, allow_nan=False)))
    assert (document["status"], document["direction"]) == ("delivered", "proof_mass_to_com")
    combined = products["combine"]
    for k, block in enumerate(document["variants"].values()):
        assert_allclose(block["offset_um"], 1e6 * combined["offset"].values[k], rtol=1e-12)
        for name in ("", "_total"):
            sigma = 1e6 * np.sqrt(np.diag(combined[f"covariance{name}"].values[k]))
            assert_allclose(block[f"sigma{name}_um"], sigma, rtol=1e-9)
    (block,) = [one["variants"]["acc"] for one in document["manoeuvres"] if one["kind"] == "pitch"]
    assert block["offset_um"][1] is block["sigma_um"][1] is None
    assert [row[1] for row in block["covariance_um2"]] == block["covariance_um2"][1] == [None] * 3
    assert block["covariance_um2"][0][0] is not None
    flag = np.where(np.arange(products["align"].sizes["time_acc"]) == 7, OUTLIER, 0)
    assert document_of(moved(products, "align", acc_flag=flag, sca_flag=0))["outliers"] == {"ACC1A": 1, "SCA1B": 0}


def test_what_is_undetermined_is_not_delivered_and_what_repeats_its_prior_is_null(products):
    """Contract: without z the best of what is there is adopted and z stays null; without all status failed.

    Value and error both or neither; an error of 0.1 is the prior of a torque scale, x a mean of three.
    """
    document = document_of(undetermined(products, [2]))
    validate(document)
    assert document["variants"]["mtq"]["offset_um"][2] is None
    assert document["verdict"]["requirement"][2] == "undetermined"
    assert document["verdict"]["accuracy_met"] is False
    assert page.vcm_line(document, "C") is None
    document = document_of(undetermined(products, [0, 1, 2]))
    validate(document)
    assert (document["status"], document["adopted"]["variant"]) == ("failed", None)
    sigma = np.array([0.01, 0.02, 0.1])
    smoothed = moved(products, "attitude", sca_delay=np.nan, torque_scale=1.01, torque_scale_sigma=sigma)
    document = document_of(smoothed)
    assert document["delays_s"]["sca"] == {"value": None, "sigma": None}
    assert document["delays_s"]["acc"]["sigma"] == pytest.approx(float(products["attitude"]["acc_delay_sigma"]))
    torque = document["scales"]["torque"]
    assert torque["value"][2] is None
    assert_allclose(torque["sigma"][0], 0.01 / np.sqrt(3))


def test_a_record_without_manoeuvre_says_what_was_measured(quiet_products):
    """Contract: field check, attitude residual, roll response beside the expected one; no table of offsets."""
    document = document_of(quiet_products)
    validate(document)
    assert (document["status"], document["manoeuvres"]) == ("no_manoeuvre", [])
    assert_allclose(document["field_check"]["bias_nt"], 1e9 * quiet_products["field"]["bias"].values)
    rms = np.sqrt(np.mean(quiet_products["attitude"]["sca_residual_b"].values ** 2, axis=0))
    assert_allclose(document["attitude"]["rms_urad"], 1e6 * rms)
    assert document["roll_response"]["value"] == pytest.approx(float(quiet_products["survey"]["slope"]))
    assert document["roll_response"]["expected"] == {"value": 0.0028, "sigma": 0.0003}
    assert page.vcm_line(document, "C") is None
    html = page.html(document, quiet_products, {})
    assert "No manoeuvre in the torquer currents" in html
    assert html.count("<figure ") == 3
    assert "Every manoeuvre" not in html


def test_the_smallest_total_error_is_adopted_and_the_requirement_is_asked_with_it(products):
    """Issue 20: whatever the noise alone says; 107 um with a total error of 10 um cannot be told from 100 um."""
    total = np.diag([1e-10, 1e-12, 1e-12]) * np.array([9.0, 4.0, 1.0, 3.0])[:, None, None]
    offset, noise = np.array([107.0, 3.7, -12.4]) * 1e-6, total * np.array([1.0, 1.0, 1.0, 0.01])[:, None, None]
    known = moved(products, "combine", offset=offset, determined=1, covariance=noise, covariance_total=total)
    document = document_of(known)
    assert document["adopted"]["variant"] == "acc"
    assert document["verdict"]["requirement"] == ["undecided", "within", "within"]
    assert document["verdict"]["accuracy_met"] is True
    determined = np.where(np.arange(4)[:, None] < 3, [1, 1, 0], 1)
    assert document_of(moved(known, "combine", determined=determined))["adopted"]["variant"] == "sca"


def test_the_adopted_offset_goes_into_a_vcm_line(document):
    """Analytic: round trip, in force from the second after the last manoeuvre; a comment if it was not measured."""
    line = page.vcm_line(document, "C")
    record, adopted = read_line(line), document["variants"][document["adopted"]["variant"]]["offset_um"]
    assert_allclose(record.values, 1e-6 * np.array(adopted), rtol=1e-12)
    assert record.time == np.ceil(document["manoeuvres"][-1]["stop"])
    assert record.satellite == "C"
    marked = page.vcm_line(document | {"origin": "mixed"}, "C")
    assert (marked[:12], marked[-len(line) :]) == ("# MIXED data", line)
    with pytest.raises(ProductError):
        read_line(marked)


@pytest.fixture(scope="module")
def html(document, products):
    """Page of the event, which all tests look at."""
    return page.html(document, products, PRINTED, page.vcm_line(document, "C"))


def test_the_page_says_the_numbers_of_the_document(html, document, products):
    """Contract: every combined offset with both errors, the printed, 7 figures; beside a simulated event a remark."""
    body = html[html.index("<body>") :]
    for block in document["variants"].values():
        for value, sigma, total in zip(*(block[n] for n in ("offset_um", "sigma_um", "sigma_total_um")), strict=True):
            assert plus_minus(value, sigma, total) in body
    assert "113.5 ± 0.5" in body  # Table 6, acc_calibrated
    assert page.vcm_line(document, "C") in body
    assert [int(n) for n in re.findall(r"<b>Figure (\d+)\.</b>", html)] == list(range(1, 8))
    simulated = documents.judged(document, [xr.Dataset(attrs={"origin": "simulated"})], [])
    text = page.html(simulated, dict.fromkeys(products), PRINTED)
    mark = "What is printed belongs to measured data, this event is simulated."
    assert (text.count(mark), html.count(mark)) == (3, 0)


def test_what_is_missing_is_left_out_and_printed_manoeuvres_are_matched_by_kind_and_latitude(products, document):
    """Contract: no figure without its product, the gap of a manoeuvre, names as text; Table 7 by kind and latitude."""
    smoothed = moved(products, "attitude", gap=[0, 1, 0])
    known = dict.fromkeys(products) | {"attitude": smoothed["attitude"]}
    html = page.html(document_of(smoothed, "<b>x</b>"), known, {})
    assert html.count("<figure ") == 2  # estimates, from the document; attitude
    assert html.count("not used: gap in orbit") == 1
    assert "<b>x</b>" not in html
    found = page.printed_manoeuvres(document, PRINTED)
    kinds = [one["kind"] for one in document["manoeuvres"]]
    assert found[kinds.index("pitch"), "mtq"].value == (109.5, None, 22.9)
    assert found[kinds.index("yaw"), "mtq"].value == (-6.0, 1.8, 8.8)
