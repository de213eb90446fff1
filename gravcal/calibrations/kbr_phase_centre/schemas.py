"""Names along the dimensions of the products of this calibration, whose schemas are in kbr_phase_centre.toml."""

from gravcal.calibrations import schemas

SCHEMAS = schemas.of("kbr_phase_centre.toml")
PARAMETERS = ("x_a", "y_a", "z_a", "x_b", "y_b", "z_b")
OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = ("m", "m s-1", "m s-2")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")
MANOEUVRE = ("satellite_index", "axis_index", "sign", "start", "stop")  # variables of each


def of(stage: str, observable: str) -> dict:
    """Schema of the product of a stage with the units of one observable."""
    number = OBSERVABLES.index(observable)
    return {
        name: stated | {"units": stated["units"][number]} if isinstance(stated.get("units"), tuple) else stated
        for name, stated in SCHEMAS[stage].items()
    }
