"""What the commands do, without reading arguments and without printing."""

import dataclasses
import difflib
import importlib
import importlib.util
import json
import shutil

import typer

from flows import cli_progress, engine
from gravcal.data import location
from gravcal.errors import CatalogError, GravcalError, ProductError

EXIT = {"delivered": 0, "no_manoeuvre": 3, "failed": 1}


def flow_module(calibration):
    """Module of a calibration's flow; an unknown name is wrong usage."""
    if not calibration.isidentifier() or importlib.util.find_spec(f"flows.{calibration}") is None:
        known = [name for name in calibrations() if name]
        near = difflib.get_close_matches(calibration, known, 1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise typer.BadParameter(f"no calibration {calibration!r}; there is {', '.join(known)}.{hint}")
    return importlib.import_module(f"flows.{calibration}")


def calibrations():
    """Names of the calibrations that have a flow."""
    from gravcal.data.catalog_events import CALIBRATIONS

    return [name for name in CALIBRATIONS if importlib.util.find_spec(f"flows.{name}")]


def chosen(calibration, settings, model=None):
    """Parameters of a calibration with those given as key=value replaced, and the extended model of a file."""
    from gravcal.data import catalog

    flow_module(calibration)
    given = pairs(settings)
    if model is not None:
        from flows import models

        given["model"] = models.text_of(model)
    try:
        return catalog.parameters(calibration).with_settings(given)
    except CatalogError as error:
        if settings:
            raise typer.BadParameter(f"--set: {error}") from error
        raise


def pairs(texts):
    """Mapping of key=value texts; a text without "=" is wrong usage."""
    found = {}
    for text in texts or []:
        key, equals, value = text.partition("=")
        if not (key and equals):
            raise typer.BadParameter(f"{text!r}: expected KEY=VALUE")
        found[key.strip()] = value
    return found


def source(calibration, event, data, satellite, date):
    """Where the Level-1 files come from: an event of the catalogue or a folder."""
    if (event is None) == (data is None):
        raise typer.BadParameter("give an EVENT of the catalogue or a folder with --data, one of the two")
    if event is not None and (satellite or date):
        raise typer.BadParameter("--satellite and --date belong to --data; an EVENT says them itself")
    return flow_module(calibration).source(event=event, data=data, satellite=satellite, date=date)


def name_of(source):
    """Name of the event of a source."""
    return getattr(source, "event", None)


def calibrate(calibration, source, chosen, engine_name, server=None):
    """Result document and report product of one event."""
    if engine_name not in engine.ENGINES:
        raise typer.BadParameter(f"--engine {engine_name}: expected one of {', '.join(engine.ENGINES)}")
    module = flow_module(calibration)
    with cli_progress.progress(module.calibrate.flow_name) as listener:
        ref = engine.run(module.calibrate, source, chosen, engine=engine_name, listener=listener, server=server)
    return module.document(ref), ref


def discover(calibration, source, chosen, engine_name):
    """Result document of a discovery and its files."""
    from flows import discover as flow

    if engine_name not in engine.ENGINES:
        raise typer.BadParameter(f"--engine {engine_name}: expected one of {', '.join(engine.ENGINES)}")
    if calibration not in flow.FLOWS:
        known = ", ".join([*flow.FLOWS, *flow.measured_views()])
        raise typer.BadParameter(f"no discovery for {calibration!r} yet; there is {known}")
    with cli_progress.progress(flow.FLOWS[calibration].flow_name) as listener:
        ref = engine.run(flow.FLOWS[calibration], source, chosen, engine=engine_name, listener=listener)
    return flow.document(ref), [path for path in sorted(ref.folder.iterdir()) if path.suffix in (".html", ".toml")]


def plan(calibration, source, chosen):
    """Steps of the plan for one event."""
    return engine.plan(flow_module(calibration).calibrate, source, chosen)[0]


def sources(calibration, event, data, satellite, date):
    """The source given, or those of all events of the store that say where their files were."""
    if event is not None or data is not None:
        return [source(calibration, event, data, satellite, date)]
    from gravcal.data import lineage

    found = lineage.level_one_folders(calibration)
    if not found:
        raise ProductError(
            f"product store {location.folder()}: no event of {calibration} was ever run. Give an EVENT or --data DIR."
        )
    made = [_source_again(flow_module(calibration), *one) for one in found]
    return [source for source in made if source is not None]


def _source_again(module, event, folder, satellite, date):
    """Source of an event of the store; None, with a warning, where its files are no more."""
    try:
        source = module.source(event=None, data=folder, satellite=satellite, date=date)
    except GravcalError as error:
        engine.warn(f"{event} left out: {error}")
        return None
    return dataclasses.replace(source, event=event)


def detect(calibration, source, chosen):
    """Document with the manoeuvres found in the data."""
    module = flow_module(calibration)
    with cli_progress.progress(module.detect.flow_name) as listener:
        return module.detected(engine.run(module.detect, source, chosen, engine="inline", listener=listener))


def simulate(calibration, out, seed_truth, effects, settings):
    """Write an invented event; its truth document."""
    seed, truth = seed_truth
    try:
        strengths = {name: float(value) for name, value in pairs(effects).items()}
    except ValueError as error:
        raise typer.BadParameter(f"--effect: {error}; expected SLUG.PARAMETER=NUMBER") from error
    with cli_progress.waiting(f"simulating {calibration}"):
        return flow_module(calibration).simulate(
            out, seed=seed, truth=truth, effects=strengths, settings=pairs(settings)
        )


def demo(out, seed, engine_name):
    """Result document, report product and truth of an invented event."""
    from flows import prefect_server

    folder = out or location.folder() / "demo" / f"seed-{seed}"
    first = engine_name == "prefect" and not (location.folder() / "prefect").exists()  # a first start takes ten seconds
    with prefect_server.early(first) as server:
        truth = simulate("com_offset", folder, (seed, folder / "truth.json"), None, None)
        made = source("com_offset", None, folder, truth["satellite"], truth["date"])
        document, ref = calibrate("com_offset", made, chosen("com_offset", None), engine_name, server)
    return document, ref, truth


def report_files(event, out):
    """Files of the last report of an event, copied to a folder if one is given."""
    folders = sorted((location.folder() / "latest" / event).glob("*.report"))
    if not folders:
        near = difflib.get_close_matches(event, [path.name for path in (location.folder() / "latest").glob("*")], 3)
        hint = f" Did you mean {', '.join(near)}?" if near else ""
        raise ProductError(f"event {event}: there is no report in {location.folder()}.{hint} Make it with gravcal run.")
    files = [path for folder in folders for path in sorted(folder.iterdir()) if path.name != "meta.json"]
    if out is None:
        return files
    out.mkdir(parents=True, exist_ok=True)
    return [shutil.copy(path, out / path.name) for path in files]


def failed(calibration, event, error):
    """Result document of a run that failed."""
    from gravcal import __version__
    from gravcal.data.schemas import VERSION

    facts = {name: value for name, value in getattr(error, "facts", {}).items() if _is_plain(value)}
    return {
        "schema_version": VERSION,
        "status": "failed",
        "calibration": calibration,
        "event": event,
        "error": {"kind": type(error).__name__, "message": str(error), "facts": facts},
        "provenance": {"gravcal": __version__},
    }


def _is_plain(value):
    """Whether JSON can hold a fact as it is."""
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        return False
    return True
