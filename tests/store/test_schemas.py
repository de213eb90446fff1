"""Result documents: good ones pass, bad ones say where and why."""

import functools
import json
import operator

import pytest
from jsonschema_rs import meta

from gravcal.errors import ProductError
from gravcal.store import schemas


def _head(calibration, **rest):
    """The part that all documents share."""
    return {
        "schema_version": schemas.VERSION,
        "status": "delivered",
        "calibration": calibration,
        "event": "demo",
        "origin": "simulated",
        "configuration": "operational",
        "checks": [{"name": "height", "value": None, "limit": 1.0, "unit": "km", "passed": False}],
        "provenance": {},
        **rest,
    }


FULL = {
    "offset_um": [1.0, 2.0, 3.0],
    "sigma_um": [1.0, 2.0, 3.0],
    "covariance_um2": [[1.0, 0.5, 0.0], [0.5, 4.0, 0.0], [0.0, 0.0, 9.0]],
}
PITCH = {
    "offset_um": [1.0, None, 3.0],
    "sigma_um": [1.0, None, 3.0],
    "covariance_um2": [[1.0, None, 0.1], [None, None, None], [0.1, None, 9.0]],
}
TEST = {"chi2": 3.0, "dof": 4, "p": 0.5}
COM = _head(
    "com_offset",
    direction="proof_mass_to_com",
    variants={"mtq": FULL, "sca": FULL},
    manoeuvres=[{"kind": "pitch", "start": 1.0, "stop": 181.0, "variants": {"mtq": PITCH}}],
    delays_s={"sca": {"value": 0.1, "sigma": 0.01}, "acc": {"value": None, "sigma": None}},
    consistency={"manoeuvres": TEST, "variants": {"chi2": None, "dof": 0, "p": None}},
)


@pytest.mark.parametrize("name", schemas.names())
def test_schemas_are_valid_and_ask_for_the_head_alone_where_there_is_no_result(name):
    """Contract: JSON Schema 2020-12; nothing to calibrate is a document too, a delivered one needs its result."""
    for one in (name, "common"):
        meta.validate(schemas.schema(one))
    head = _head("com_offset" if name in ("discovery", "joint") else name)
    for status in ("no_manoeuvre", "no_data", "failed"):
        schemas.validate(head | {"status": status}, name)
    with pytest.raises(ProductError, match="expected"):
        schemas.validate(head, name)


def test_a_document_passes_and_needs_each_part_of_its_head():
    """Contract: documents of the shape of contract.md; those of all calibrations are checked when they are written."""
    schemas.validate(COM)
    for key in ("schema_version", "status", "calibration", "event", "origin", "configuration", "checks", "provenance"):
        with pytest.raises(ProductError, match=f'"{key}" is a required property|calibration: found'):
            schemas.validate({k: v for k, v in COM.items() if k != key})


BAD = [
    (["variants", "mtq", "offset_um", 0], float("nan"), r"variants\.mtq\.offset_um\[0\]: found nan; expected a finite"),
    (["provenance", "seconds"], float("inf"), r"provenance\.seconds: found inf"),
    (["variants", "mtq", "offset_um", 0], None, r"sigma_um.*null exactly where offset_um is null"),
    (["variants", "mtq", "sigma_um", 0], -1.0, r"sigma_um\[0\]: found -1\.0; expected .*minimum of 0"),
    (["variants", "mtq", "sigma_um", 0], 1.1, r"covariance_um2\[0\]\[0\].*square of sigma"),
    (["variants", "mtq", "covariance_um2", 0, 1], 0.4, r"covariance_um2\[0\]\[1\].*symmetric"),
    (["manoeuvres", 0, "variants", "mtq", "covariance_um2", 0, 1], 0.0, r"\[0\]\[1\].*undetermined"),
    (["direction"], "com_to_proof_mass", r"direction: found 'com_to_proof_mass'; expected .*proof_mass_to_com"),
    (["calibration"], "com", r"calibration: found 'com'; expected one of com_offset"),
]


@pytest.mark.parametrize(("path", "value", "message"), BAD)
def test_a_bad_document_says_where_found_and_expected(path, value, message):
    """Contract: NaN, half-determined components, wrong names and types are refused."""
    changed = json.loads(json.dumps(COM))
    functools.reduce(operator.getitem, path[:-1], changed)[path[-1]] = value
    with pytest.raises(ProductError, match=message):
        schemas.validate(changed)
