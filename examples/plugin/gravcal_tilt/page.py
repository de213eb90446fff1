"""Document and page of tilt_scale."""

import numpy as np

from gravcal.calibrations.checks import at_most
from gravcal.report import documents
from gravcal.report.figures import grid
from gravcal.report.pages import Section, Table, figure, page

UNITS = {"scale": "1", "bias": "rad"}


def report(fitted, event, settings):
    """Report product and its files.

    Parameters
    ----------
    fitted : Dataset, "tilt_scale.fit"
    event : str
    settings : all parameters
    """
    sigma = np.sqrt(np.diag(fitted["covariance"].values))
    estimates = zip(UNITS.items(), fitted["value"].values, sigma, strict=True)
    parameters = {
        name: {"value": float(value), "sigma": float(error), "unit": unit} for (name, unit), value, error in estimates
    }
    body = {
        "status": "delivered",
        "parameters": parameters,
        "verdict": {"text": f"Scale {parameters['scale']['value']:.2e} +- {sigma[0]:.1e}."},
    }
    checks = [at_most("sigma of the scale", sigma[0], settings["sigma_limit"], "1")]
    document = documents.delivered("tilt_scale", body, {"fit": fitted}, checks, event=event, settings=settings)
    files = {"result.json": documents.text(document)}
    sections = [Section("Result", [table(parameters)], [residual])]
    files["report.html"] = page(document, sections, {"fit": fitted}, heading="Tilt meter")
    return fitted[["value"]], files


def table(parameters):
    """Table of the parameters."""
    rows = [[name, f"{one['value']:.3e}", f"{one['sigma']:.1e}", one["unit"]] for name, one in parameters.items()]
    return Table("Scale and bias.", ["parameter", "value", "sigma", "unit"], rows, ["fit"])


@figure("fit", caption="Residual of the reading.")
def residual(fitted):
    """Residual over time."""
    drawn, panels = grid(1, 1, 2.0, xlabel="time (min)", ylabels=["residual (µrad)"])
    panels[0, 0].plot((fitted["time"] - fitted["time"][0]) / 60.0, 1e6 * fitted["residual"], linewidth=0.5)
    return drawn
