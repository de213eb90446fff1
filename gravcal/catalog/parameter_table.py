"""Parameters of a calibration: every number a stage takes, each with its reason and its allowed range."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gravcal.catalog import files
from gravcal.errors import CatalogError, refuse

REQUIRED = ("value", "stage", "reason")
OPTIONAL = ("unit", "minimum", "maximum", "allowed")
WORDS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


@dataclass(frozen=True)
class Parameter:
    """One choice of ours: its value, what it may be, the stages that take it and why it is so."""

    name: str
    value: object
    stages: tuple[str, ...]
    reason: str
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    allowed: tuple | None = None


@dataclass(frozen=True)
class Parameters:
    """All parameters of a calibration; their values are attributes: ``chosen.lowpass_hz``.

    ``configuration`` is "operational" or the name of the experiment that they belong to.
    """

    calibration: str
    entries: Mapping[str, Parameter]
    configuration: str = "operational"

    def __getattr__(self, name):
        """Value of the parameter of that name."""
        if name.startswith("_"):
            raise AttributeError(name)
        return self.entry(name).value

    def entry(self, name):
        """Parameter with unit, range and reason."""
        if name not in self.entries:
            raise files.unknown("parameter", name, sorted(self.entries), where=self.calibration)
        return self.entries[name]

    def with_settings(self, settings):
        """Copy with some values replaced; texts, as from ``--set``, take the type of the catalogue's value."""
        changed = {}
        for name, given in settings.items():
            entry = self.entry(name)
            if isinstance(entry.value, tuple):
                items = given.split(",") if isinstance(given, str) else given
                value = tuple(_scalar(item, entry.value[0], entry, self.calibration) for item in items)
            else:
                value = _scalar(given, entry.value, entry, self.calibration)
            changed[name] = replace(entry, value=value)
            _check(changed[name], self.calibration)
        return replace(self, entries={**self.entries, **changed})

    def for_report(self):
        """All values by name, and the name of the configuration, as a report says them; no other stage takes both."""
        return {name: entry.value for name, entry in self.entries.items()} | {"configuration": self.configuration}

    def for_stage(self, stage):
        """Settings of one stage by name, sorted, ready as keyword arguments."""
        stages = sorted({known for entry in self.entries.values() for known in entry.stages})
        if stage not in stages:
            raise files.unknown("stage", stage, stages, where=self.calibration)
        return {name: entry.value for name, entry in sorted(self.entries.items()) if stage in entry.stages}


def parameters(calibration):
    """Parameters of a calibration from ``catalog/parameters/<calibration>.toml``."""
    path, content = files.read("parameters", calibration)
    entries = {name: _parameter(name, table, path) for name, table in content.items()}
    return Parameters(calibration, entries)


def _parameter(name, table, path):
    """Parameter from its TOML table."""
    if not isinstance(table, dict):
        files.wrong(path, name, table, "a table with value, stage and reason", f"Write [{name}] and its keys.")
    files.require(table, REQUIRED, f"{path}: [{name}]", OPTIONAL)
    if not isinstance(table["reason"], str) or not table["reason"].strip():
        files.wrong(path, f"{name}.reason", table["reason"], "a sentence", "Say why the value is what it is.")
    stages = (table["stage"],) if isinstance(table["stage"], str) else tuple(table["stage"])
    rest = {key: table[key] for key in ("unit", "minimum", "maximum") if key in table}
    allowed = tuple(_number(item, table) for item in table["allowed"]) if "allowed" in table else None
    value = _number(table["value"], table)
    parameter = Parameter(name, value, stages, table["reason"], allowed=allowed, **rest)
    _check(parameter, str(path))
    return parameter


def _number(value, table):
    """A number with a unit is a real number, one without keeps its type; lists become tuples."""
    if isinstance(value, list):
        return tuple(_number(item, table) for item in value)
    whole = isinstance(value, int) and not isinstance(value, bool)
    return float(value) if whole and "unit" in table else value


def _scalar(given, example, entry, where):
    """One given text or value in the type of the example."""
    kind = type(example)
    text = given.strip() if isinstance(given, str) else given
    try:
        if kind is bool:
            return WORDS[str(text).lower()]
        if kind is int and str(text) != str(int(text)):
            raise ValueError(text)
        return kind(text)
    except (KeyError, TypeError, ValueError):
        expected = {bool: "true or false", int: "a whole number", float: "a number"}.get(kind, "a text")
        return _refused(where, entry.name, given, expected)


def _check(entry, where):
    """The value lies in its range and among the allowed ones."""
    for item in entry.value if isinstance(entry.value, tuple) else (entry.value,):
        if entry.allowed is not None and item not in entry.allowed:
            _refused(where, entry.name, item, f"one of {', '.join(map(str, entry.allowed))}")
        if isinstance(item, float) and item != item:
            _refused(where, entry.name, item, "a number")
        if entry.minimum is not None and item < entry.minimum or entry.maximum is not None and item > entry.maximum:
            low = "-" if entry.minimum is None else f"{entry.minimum:g}"
            high = "-" if entry.maximum is None else f"{entry.maximum:g}"
            _refused(where, entry.name, item, f"between {low} and {high} {entry.unit or ''}".rstrip())


def _refused(where, name, found, expected):
    """Refuse a parameter's value."""
    remedy = f"Choose such a value, or leave {name} as it is."
    refuse(f"{where}: {name}", repr(found), expected, remedy, CatalogError, parameter=name)
