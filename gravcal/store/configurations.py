"""Configurations of a calibration: the operational one, and experiments that never take its place by themselves.

    configurations/<calibration>/<NAME>.json       an experiment: the settings in which it differs from the catalogue
    configurations/<calibration>/promotions.jsonl  who made which operational, when and why; the last line holds

The operational configuration is the catalogue as it stands until another is promoted. Settings given to a run are added
to those of the operational configuration; where that changes anything, the run is an experiment with a name of its own.
"""

import dataclasses
import datetime
import getpass
import hashlib
import json
import re

from gravcal.catalog import parameters
from gravcal.errors import CatalogError, refuse
from gravcal.store import location
from gravcal.store.location import OPERATIONAL

CATALOGUE = "catalogue"  # name of the configuration that is operational before any promotion
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._,+-]{0,79}")
#: Formats of value and sigma of a model parameter, from few to all digits; the first that shows two models to differ.
SHOWN = ("{0:#.3g}", "{0:#.6g}", "{0!r}", "{0!r} +- {1:.3g}")
MOST = 6  # parameters of a model that a text names
OF_ONE_DAY = {"truth"}  # settings that name a file of one day: no choice of processing


def chosen(calibration, settings, name=None):
    """Parameters of a run, with its settings and the name of its configuration; nothing is written.

    settings : {name: text or value} as of ``--set`` and ``--model``; {}: those of the recorded experiment ``name``.
    """
    catalogue, used = parameters(calibration), operational(calibration)["settings"]
    if name not in (None, OPERATIONAL):
        _check_name(name)
        if not set(settings) - OF_ONE_DAY:
            recorded = settings_of(calibration, name)
            return dataclasses.replace(_with(catalogue, recorded | settings, name), configuration=name)
    choice = _with(catalogue, used, OPERATIONAL).with_settings(settings)
    changed = changes(choice)
    if changed == used:
        if name not in (None, OPERATIONAL):
            remedy = "Leave --as out, or give --set or --model."
            _refuse(calibration, name, "the settings of the operational configuration", "others", remedy)
        return choice
    if name == OPERATIONAL:
        remedy = "They make an experiment: give it another name, and make it operational with gravcal promote."
        _refuse(calibration, name, "--set or --model", "none", remedy)
    if not name and changed:  # readable, and the same for the same change
        digest = hashlib.sha256(json.dumps(changed, sort_keys=True).encode()).hexdigest()[:8]
        causes = lambda model: "+".join(dict.fromkeys(one["cause"] for one in json.loads(model)))  # noqa: E731
        parts = {n: causes(v) if n == "model" else json.dumps(v).strip('"') for n, v in changed.items()}
        label = ",".join(f"{n}-{text}" for n, text in parts.items())
        safe = re.sub(r"[^A-Za-z0-9._,+-]+", "_", label)[:60].rstrip("_,")
        name = safe if safe == label and "model" not in changed else f"{safe}-{digest}"
    name = name or CATALOGUE
    known = _recorded(calibration, name)
    if known is not None and known["settings"] != changed or name == CATALOGUE and changed:
        meaning = ", ".join(said(known["settings"] if known else {}))
        prune = f"gravcal products prune --configuration {name} --older-than-h 0 --remove"
        remedy = f"Give another name with --as, or remove it: {prune}."
        _refuse(calibration, name, ", ".join(said(changed)), f"{meaning}, for which it stands", remedy)
    return dataclasses.replace(choice, configuration=name)


def changes(chosen):
    """{setting: JSON value} in which chosen Parameters differ from the catalogue, sorted."""
    before = parameters(chosen.calibration).entries
    different = {n: e.value for n, e in chosen.entries.items() if e.value != before[n].value and n not in OF_ONE_DAY}
    return {name: list(value) if isinstance(value, tuple) else value for name, value in sorted(different.items())}


def record(chosen):
    """Write the settings of an experiment to its file, unless it is there already; returns the same Parameters."""
    name = chosen.configuration
    if name not in (OPERATIONAL, CATALOGUE) and _recorded(chosen.calibration, name) is None:
        kept = {"calibration": chosen.calibration, "name": name, "settings": changes(chosen), "recorded": _now()}
        location.write_json(_path(chosen.calibration, name), kept, indent=1)
    return chosen


def names(calibration):
    """Names of the recorded experiments of a calibration, sorted."""
    return sorted(path.stem for path in _path(calibration, "x").parent.glob("[!.]*.json"))


def settings_of(calibration, name):
    """{setting: value} in which a recorded experiment, "operational" or "catalogue" differs from the catalogue."""
    if name == CATALOGUE:
        return {}
    if name == OPERATIONAL:
        return operational(calibration)["settings"]
    _check_name(name)
    recorded = _recorded(calibration, name)
    if recorded is None:
        known = ", ".join([OPERATIONAL, CATALOGUE, *names(calibration)])
        fault = f"that it was never run in {location.folder()}"
        _refuse(calibration, name, fault, f"one of {known}", "Or say with --set or --model what it is.")
    return recorded["settings"]


def operational(calibration):
    """The last promotion: {"name", "settings", "who", "when", "why"}, of the catalogue where there was none."""
    return ([{"name": CATALOGUE, "settings": {}, "who": "", "when": "", "why": ""}] + promotions(calibration))[-1]


def promotions(calibration):
    """Promotions of a calibration, list of dict as of `operational`, the oldest first."""
    path = _path(calibration, "promotions").with_suffix(".jsonl")
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        promoted = [json.loads(line) for line in lines]
    except (OSError, ValueError) as error:
        raise _broken(path, error) from error
    if not all(isinstance(one, dict) and isinstance(one.get("settings"), dict) and "name" in one for one in promoted):
        raise _broken(path, "a line without name and settings")
    return promoted


def promoted():
    """Names of the operational configurations of all calibrations that ever had a promotion."""
    journals = (location.folder() / "configurations").glob("*/promotions.jsonl")
    return {operational(path.parent.name)["name"] for path in journals}


def promote(calibration, name, why, who=None):
    """Make a configuration operational and return the promotion (dict); "catalogue" reverts all promotions."""
    settings = settings_of(calibration, name)
    _with(parameters(calibration), settings, name)
    if not why.strip():
        _refuse(calibration, name, "no reason", "one", "Say why with --why TEXT.")
    if operational(calibration)["settings"] == settings:
        _refuse(calibration, name, "settings that are operational already", "others", "There is nothing to promote.")
    line = {"name": name, "settings": settings, "who": who or getpass.getuser(), "when": _now(), "why": why.strip()}
    path = _path(calibration, "promotions").with_suffix(".jsonl")
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as journal:
        journal.write(json.dumps(line) + "\n")
    return line


def said(settings):
    """Settings {name: value} as short texts, ["noise_order=25", ...]; a model by its parameters."""
    return [f"{n}={_model(v) if n == 'model' and v else v}" for n, v in settings.items()] or ["the catalogue"]


def models_apart(old, new):
    """[(parameter "torque.dipole_gain rod_y ", old text, new text)] in which two models, JSON or "", differ."""
    if not (old and new):
        return [("", _model(old), _model(new))]
    texts, differences = [(_values(old, shown), _values(new, shown)) for shown in SHOWN], []
    for name in dict.fromkeys([*texts[0][0], *texts[0][1]]):
        pairs = [(a.get(name, "none"), b.get(name, "none")) for a, b in texts]
        differences += [(f"{name} ", *pair) for pair in pairs if pair[0] != pair[1]][:1]
    return differences or [("", "the same values", "other correlations, shapes or result")]


def _model(model):
    """Text "torque.dipole_gain rod_y 0.0298 unit, ..." of a model (JSON), "none" of ""."""
    words = [f"{name} {value}" for name, value in _values(model).items()]
    return ", ".join(words[:MOST] + [f"{len(words) - MOST} more"] * (len(words) > MOST)) or "none"


def _values(model, shown=SHOWN[0]):
    """{"cause parameter days": "value unit"} of a model (JSON or ""); shown: format of value and sigma."""
    texts = {}
    for effect in json.loads(model or "[]"):
        days = "".join(f" {word} {effect[word]}" for word in ("from", "to") if word in effect)
        values = {
            f" {name}": f"{shown.format(p['value'], p.get('sigma', 0.0))} {p.get('unit', '1')}".removesuffix(" 1")
            for name, p in effect["parameters"].items()
        }
        for name, value in (values or {"": "by its shape"}).items():
            texts.setdefault(effect["cause"] + name + days, []).append(value)
    return {name: " + ".join(values) for name, values in texts.items()}


def _with(catalogue, settings, name):
    """Parameters of the catalogue with the settings of a configuration; refused if it no longer takes them."""
    try:
        return catalogue.with_settings(settings)
    except CatalogError as error:
        remedy = f"Or promote the catalogue: gravcal promote {catalogue.calibration} {CATALOGUE} --why TEXT."
        _refuse(catalogue.calibration, name, str(error), "settings of this catalogue", remedy)


def _check_name(name):  # CatalogError unless the name of an experiment fits `NAME`
    if not NAME.fullmatch(name):
        expected = "expected letters, digits and . _ , + -, at most 80, a letter or digit first"
        raise CatalogError(f"--as {name!r}: {expected}.", found=name)


def _recorded(calibration, name):  # {"settings": ...} of the file of an experiment, None without a file
    path = _path(calibration, name)
    try:
        recorded = json.loads(path.read_bytes()) if path.exists() else None
    except (OSError, ValueError) as error:
        raise _broken(path, error) from error
    if recorded is not None and not (isinstance(recorded, dict) and isinstance(recorded.get("settings"), dict)):
        raise _broken(path, "no settings")
    return recorded


def _refuse(calibration, name, fault, expected, remedy):  # CatalogError on the configuration ``name``
    where = f"configuration {name} of {calibration}"
    refuse(where, fault, expected, remedy, CatalogError, configuration=name)


def _broken(path, fault):
    """CatalogError (to raise) for a configuration file that cannot be read."""
    return CatalogError(f"{path}: {fault}; expected a record as gravcal writes it. Put it back, or remove the file.")


def _path(calibration, name):  # file of an experiment, whether it exists or not
    return location.folder() / "configurations" / calibration / f"{name}.json"


def _now():  # UTC, ISO 8601
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
