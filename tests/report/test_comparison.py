"""Two configurations beside each other."""

import json

import numpy as np
import pytest

from flows.calibration import load
from gravcal.report import comparison
from gravcal.store.results import Value

HEAD = {"calibration": "com_offset", "configurations": ("a", "b"), "only_in": {"a": [], "b": ["e"]}}


def document(calibration="com_offset", **more):
    """Result document with what a comparison reads."""
    head = {"calibration": calibration, "status": "delivered", "origin": "simulated"}
    return head | {"settings": {"noise_order": 20, "configuration": "a"}, "verdict": {"text": "t"}, "checks": []} | more


def adopted(offset, sigma):
    """Block of an adopted offset."""
    return {"adopted": {"variant": "mtq"}, "variants": {"mtq": {"offset_um": offset, "sigma_um": sigma}}}


def test_the_difference_of_nested_solutions_has_a_sigma_and_equal_errors_none():
    """Recovery: half of the data against all, rms of in_sigma one within 3 errors; null, never divided by nothing."""
    rng, found = np.random.default_rng(1), []
    for _ in range(1000):
        data = rng.normal(size=40)
        half, whole = (Value("", "x", "m", d.mean(), d.size**-0.5, None) for d in (data[:20], data))
        found.append(comparison.difference(half, whole)["in_sigma"])
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1, abs=3 / np.sqrt(2000))
    same = comparison.difference(Value("", "x", "um", 1.0, 2.0, 9.0), Value("", "x", "um", 2.0, 2.001, 9.0))
    assert (same["difference"], same["sigma"], same["in_sigma"], same["in_sigma_of_first"]) == (1.0, None, None, 0.5)
    for unknown in (Value("", "x", "um", None, None, None), Value("", "x", "um", 1.0, None, None)):
        found = comparison.difference(unknown, Value("", "x", "um", 1.0, 2.0, None))
        assert (found["in_sigma"], found["in_sigma_of_first"]) == (None, None)
    assert comparison.difference(*[Value("", "x", "um", 0.0, 0.0, None)] * 2)["in_sigma"] is None


def test_changed_settings_verdicts_statuses_and_checks_are_named():
    """Contract: from both documents; the name of the configuration and the text of the verdict are no change."""
    checks = [{"name": "manoeuvres agree", "value": 1.0, "limit": 2.0, "unit": "1", "passed": True}]
    first = document(**adopted([1.0, 2.0, None], [0.5, 0.5, None]), verdict={"text": "a", "met": True}, checks=checks)
    second = first | adopted([1.5, 2.0, 7.0], [0.3, 0.5, 1.0]) | {"status": "questionable"}
    second |= {"settings": {"noise_order": 25, "configuration": "b"}, "verdict": {"text": "b", "met": False}}
    second["checks"] = [checks[0] | {"passed": False}]
    event = comparison.of_event(load("com_offset"), "grace-c-2020-02-01", first, second)
    assert event["settings"] == {"noise_order": [20, 25]}
    assert event["verdict"] == {"met": [True, False]}
    assert event["checks"] == {"manoeuvres agree": [True, False]}
    assert event["status"] == ["delivered", "questionable"]
    x, _, z = event["values"]
    assert (x["difference"], x["sigma"], x["in_sigma"]) == (0.5, pytest.approx(0.4), pytest.approx(1.25))
    assert (z["difference"], z["in_sigma"]) == (None, None)
    assert "+1.25" in comparison.page(HEAD | {"events": [event]})


def model(*values, sigma=1e-12, more=()):
    """Model of as many entries of one cause as there are values."""
    rows = [{"z_from_x": {"value": v, "sigma": sigma, "unit": "m s-2 A-1 m-2"}} for v in values]
    known = {"cause": "accelerometer.current_leak", "form": ""} | dict(more)
    return json.dumps([known | {"parameters": one} for one in rows])


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        ("", model(3e-11), [("none", "accelerometer.current_leak z_from_x 3.00e-11 m s-2 A-1 m-2")]),
        (model(3e-11), model(3.0001e-11), [("3.00000e-11", "3.00010e-11")]),
        (model(3e-11), model(3e-11, sigma=2e-12), [("3e-11 +- 1e-12 m s-2", "+- 2e-12 m s-2")]),
        (model(3e-11), model(1e-11, 2e-11), [("3.00e-11", "1.00e-11 m s-2 A-1 m-2 + 2.00e-11")]),
        (model(3e-11, more={"to": "2020-03-01"}), model(3e-11), [("3.00e-11", "none"), ("none", "3.00e-11")]),
        ("x" * 70 + "1", "x" * 70 + "2", [("xxx1", "xxx2")]),
    ],
)
def test_models_and_long_settings_show_where_they_differ(first, second, said):
    """Contract: as many digits as it takes, errors, days, several of one cause; never the same text on both sides."""
    pair = (document(settings={"model": one}) for one in (first, second))
    rows = comparison.tables(HEAD | {"events": [comparison.of_event(load("com_offset"), "e", *pair)]})[0][1]
    assert len(rows) == len(said)
    assert all(name == "model" and a != b for name, a, b in rows)
    for before, after in said:
        assert any(before in a and after in b for _, a, b in rows), rows
