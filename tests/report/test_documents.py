"""What all result documents share: checks decide the status, the origin of the data stands first."""

import numpy as np
import pytest
import xarray as xr

from gravcal.calibrations import checks, schemas
from gravcal.report import documents
from gravcal.store import product

DOCUMENT = {"status": "delivered", "verdict": {"text": "Delivered: x 1.0 um."}, "settings": {}}
HEIGHT = checks.at_most("height", 3.0, 2.0, "km")
FIT = checks.at_least("probability of the fit", 0.2, 1e-3, "1")


def test_a_failed_check_makes_a_result_questionable():
    """Contract: status, checks and the first words of the verdict."""
    assert documents.judged(DOCUMENT, (), [FIT])["status"] == "delivered"
    judged = documents.judged(DOCUMENT, (), [FIT, HEIGHT])
    assert judged["status"] == "questionable"
    assert judged["checks"][1] == {"name": "height", "value": 3.0, "limit": 2.0, "unit": "km", "passed": False}
    assert judged["verdict"]["text"] == "QUESTIONABLE: height 3, limit 2 km. Delivered: x 1.0 um."


def test_without_a_result_a_failed_check_changes_no_status():
    """Contract: questionable says that there is a result."""
    assert documents.judged(DOCUMENT | {"status": "no_manoeuvre"}, (), [HEIGHT])["status"] == "no_manoeuvre"


@pytest.mark.parametrize(("found", "origin"), [("sm", "mixed"), ("ss", "simulated"), ("mm", "measured")])
def test_the_origin_stands_first(found, origin):
    """Contract: measured, simulated or mixed, and the verdict begins with it unless all is measured."""
    words = {"s": "simulated", "m": "measured"}
    products = [xr.Dataset(attrs={"origin": words[letter]}) for letter in found]
    judged = documents.judged(DOCUMENT, products, [])
    assert judged["origin"] == origin
    assert judged["verdict"]["text"].startswith("Delivered" if origin == "measured" else origin.upper())


def test_what_cannot_be_evaluated_does_not_pass():
    """Contract: NaN fails and is null in the document."""
    for check in (checks.at_most("a", np.nan, 1.0, "m"), checks.at_least("a", np.nan, 1.0, "m")):
        assert not check.passed
        assert checks.plain([check])[0]["value"] is None


def test_checks_travel_as_a_product(tmp_path):
    """Contract: a product of the shared schema gives the same checks back."""
    product.register("test.checks", schemas.of("shared.toml")["checks"])
    made = product.check(checks.product([HEIGHT, FIT]), "test.checks")
    assert checks.of_product(made) == [HEIGHT, FIT]
    assert checks.of_product(product.check(checks.product([]), "test.checks")) == []
