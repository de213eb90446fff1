"""Result documents: good ones pass, bad ones say where and why."""

import json

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


def _estimate(value=0.1, sigma=0.01):
    return {"value": value, "sigma": sigma}


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
    delays_s={"sca": _estimate(), "acc": _estimate(None, None)},
    consistency={"manoeuvres": TEST, "variants": {"chi2": None, "dof": 0, "p": None}},
)
SOLUTION = {"phase_centre_mm": [1444.4, -0.1, 0.4], "sigma_mm": [0.5, 0.02, 0.02]}
KBR = _head(
    "kbr_phase_centre",
    satellites={"C": {"range_rate": {"ls": SOLUTION, "robust": SOLUTION}}, "D": {"range": {"ls": SOLUTION}}},
    adopted={"observable": "range_rate", "method": "ls"},
)
VECTOR = {"value": [1.0, None, 2.0], "sigma": [0.1, None, 0.2], "sigma_total": [0.2, None, 0.3]}
XYZ = {"x": _estimate(), "y": None, "z": _estimate()}
SENSOR = _head(
    "inertial_sensor",
    swing={"k": XYZ, "beta": XYZ, "com_to_test_mass_um": VECTOR, "delay_s": _estimate()},
    roll={"bias": VECTOR, "bias_volt": VECTOR, "segments": 300},
)
GRADIENT = _head(
    "gradient_torque",
    drag={"two_sensor": {"rms_error": None, "sigma_rms": 1e-13, "series": "034e646c4ecd"}},
    identifiability={"rank": 6, "unknowns": 8, "null_space": [[0.0] * 8]},
)
FINDING = {
    "cause": "timing.accelerometer_delay",
    "tied_with": ["timing.star_camera_delay"],
    "in_catalogue": True,
    "parameters": {"delay": {"value": 0.01, "sigma": 0.001, "unit": "s"}},
    "significance": 10.0,
    "heldout_gain": {"chi2": 30.0},
    "level": 0.005,
    "heldout": "manoeuvres",
}
DISCOVERY = _head(
    "com_offset",
    adequate_before=False,
    adequate_after=True,
    findings=[FINDING],
    indistinguishable_from_calibration=[],
    unexplained={},
    calibration_change={},
    gain={},
)
GOOD = {"com_offset": COM, "kbr_phase_centre": KBR, "inertial_sensor": SENSOR, "gradient_torque": GRADIENT}
GOOD["discovery"] = DISCOVERY
_NAMED = {"gain_x": {"value": 1.6, "sigma": 0.03, "unit": "1"}, "gain_y": None, "gain_z": None, "delay": None}
_MATRIX = {"parameters": list(_NAMED), "matrix": [[9e-4, None, None, None], *[[None] * 4] * 3]}
for _name in ("magnetometer", "ranging", "thrusters"):
    GOOD[_name] = _head(_name, parameters=_NAMED, covariance=_MATRIX, facts={}, verdict={"text": ""})
_BAND = {"band_mhz": [5.0, 10.0], "value": 1.0, "sigma": 0.2, "expected": 0.9, "range_um": {"none": 77.0}}
GOOD["ranging"] |= {"share": [_BAND]}
GOOD["thrusters"] |= {"heads": {"said": "no SCA1A", "parameters": None}}
_MISSING = {"status": "missing", "said": "no KBR1B", "proven_on": "simulated days"}
_PARTS = dict.fromkeys(("accelerometer", "magnetometer", "thrusters", "ranging"), _MISSING)
_FITTED = {"statistics": [], "causes": [], "adequate": None, "parameters": _NAMED, "covariance": _MATRIX, "facts": {}}
_HEADS = {"heads": {"said": "From 12 blocks.", "parameters": _NAMED, "covariance": _MATRIX}}
_PARTS["thrusters"] = _MISSING | {"status": "fitted"} | _FITTED | _HEADS
GOOD["routine"] = _head("routine", instruments=_PARTS, parameters={}, verdict={"text": ""})
_PARTS = {"events": [], "causes": [], "contradicting": [], "predicted": [], "motion": {}}
GOOD["joint"] = _head("com_offset", parameters=["x"], unit="um", level=0.005, tried=9, **_PARTS)


@pytest.mark.parametrize("name", schemas.names())
def test_schemas_are_valid_and_pass_a_good_document_before_and_after_it_is_written(name):
    """Contract: JSON Schema 2020-12; documents of the shape of contract.md are accepted."""
    for one in (name, "common"):
        meta.validate(schemas.schema(one))
    schemas.validate(GOOD[name])
    schemas.validate(json.loads(json.dumps(GOOD[name], allow_nan=False)), name)


@pytest.mark.parametrize("status", ["no_manoeuvre", "no_data", "failed"])
@pytest.mark.parametrize("name", schemas.names())
def test_without_a_result_only_the_head_is_asked_for(name, status):
    """Contract: nothing to calibrate is a document too."""
    calibration = "com_offset" if name in ("discovery", "joint") else name
    schemas.validate({**_head(calibration), "status": status}, name)


@pytest.mark.parametrize("name", schemas.names())
def test_a_delivered_document_has_all_its_parts(name):
    """Contract: each part of the head and of the result is asked for."""
    for key in ("schema_version", "status", "calibration", "event", "origin", "configuration", "checks", "provenance"):
        lacking = {k: v for k, v in GOOD[name].items() if k != key}
        with pytest.raises(ProductError, match=f'"{key}" is a required property|calibration: found'):
            schemas.validate(lacking, name)
    with pytest.raises(ProductError, match="expected"):
        schemas.validate(_head(GOOD[name]["calibration"]), name)


def _changed(document, path, value):
    """Copy of a document, nothing shared, with one place changed."""
    changed = json.loads(json.dumps(document))
    place = changed
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return changed


NAN = float("nan")
BAD = [
    (COM, ["variants", "mtq", "offset_um", 0], NAN, r"variants\.mtq\.offset_um\[0\]: found nan; expected a finite"),
    (COM, ["provenance", "seconds"], float("inf"), r"provenance\.seconds: found inf"),
    (COM, ["variants", "mtq", "offset_um", 0], None, r"sigma_um.*null exactly where offset_um is null"),
    (COM, ["variants", "mtq", "sigma_um", 0], -1.0, r"sigma_um\[0\]: found -1\.0; expected .*minimum of 0"),
    (COM, ["variants", "mtq", "sigma_um", 0], 1.1, r"covariance_um2\[0\]\[0\].*square of sigma"),
    (COM, ["variants", "mtq", "covariance_um2", 0, 1], 0.4, r"covariance_um2\[0\]\[1\].*symmetric"),
    (COM, ["manoeuvres", 0, "variants", "mtq", "covariance_um2", 0, 1], 0.0, r"\[0\]\[1\].*undetermined"),
    (COM, ["variants", "mtq", "offset_um"], [1.0, 2.0], r"offset_um.*less than 3 items"),
    (COM, ["variants", "gps"], FULL, r"variants.*'gps' was unexpected"),
    (COM, ["direction"], "com_to_proof_mass", r"direction: found 'com_to_proof_mass'; expected .*proof_mass_to_com"),
    (COM, ["manoeuvres", 0, "kind"], "wiggle", r"manoeuvres\[0\]\.kind: found 'wiggle'; expected .*is not one of"),
    (COM, ["status"], "perhaps", r"status: found 'perhaps'"),
    (COM, ["consistency", "manoeuvres", "p"], 1.5, r"consistency\.manoeuvres\.p"),
    (COM, ["calibration"], "com", r"calibration: found 'com'; expected one of com_offset"),
    (COM, ["schema_version"], 1, r"schema_version: found 1; expected"),
    (KBR, ["satellites", "E"], {}, r"satellites.*'E'"),
    (KBR, ["satellites", "C", "range_rate", "ls", "sigma_mm", 1], None, r"sigma_mm.*null exactly where"),
    (SENSOR, ["swing", "k", "x"], {"value": 1.0}, r"swing\.k\.x"),
    (SENSOR, ["roll", "segments"], 2.5, r'roll\.segments: found 2\.5; expected .*not of type "integer"'),
    (GRADIENT, ["drag", "three_sensor"], {}, r"drag.*'three_sensor'"),
    (
        GRADIENT,
        ["identifiability", "rank"],
        None,
        r'identifiability\.rank: found None; expected .*not of type "integer"',
    ),
    (DISCOVERY, ["findings", 0, "cause"], "delay", r"findings\[0\]\.cause: found 'delay'; expected .*does not match"),
    (DISCOVERY, ["findings", 0, "cause"], "unknown:currents", r"findings\[0\]\.in_catalogue: found True"),
    (DISCOVERY, ["findings", 0, "level"], 0.0, r"findings\[0\]\.level"),
    (DISCOVERY, ["findings", 0, "heldout"], "days", r"findings\[0\]\.heldout"),
]


@pytest.mark.parametrize(("document", "path", "value", "message"), BAD)
def test_a_bad_document_says_where_found_and_expected(document, path, value, message):
    """Contract: NaN, half-determined components, wrong names and types are refused."""
    with pytest.raises(ProductError, match=message):
        schemas.validate(_changed(document, path, value))
