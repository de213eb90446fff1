"""Why a product has to be made: its recipe beside that of the newest product of the same name."""

from gravcal.data import location, store

ABSENT = "(absent)"


def why(recipe, modules):
    """Reasons, the most telling first.

    Parameters
    ----------
    recipe : dict, of the product wanted; an input whose digest is None is not known yet
    modules : dict, part of the code -> digest

    Returns
    -------
    reasons : list of str, such as "lowpass_hz: 0.5 -> 0.7", "input com_offset.align changed", "never made"
    """
    stage = ".".join(part for part in (recipe["kind"], recipe["variant"]) if part)
    record = store.read_record(location.folder() / "latest" / recipe["event"] / stage)
    if record is None:
        return ["never made"]
    return compared(record, {"recipe": recipe, "modules": modules}, otherwise=())


def compared(old_record, new_record, otherwise=("event or variant",)):
    """What differs between two products of one stage.

    Parameters
    ----------
    old_record, new_record : dict, records of the products
    otherwise : reasons given where none is found

    Returns
    -------
    reasons : list of str, such as "lowpass_hz: 0.5 -> 0.7"
    """
    old, new = old_record["recipe"], new_record["recipe"]
    reasons = list(_differences(old["settings"], new["settings"], ""))
    if old["version"] != new["version"]:
        reasons.append(f"version {old['version']} -> {new['version']}")
    reasons += _input_reasons(old["inputs"], new["inputs"])
    if old["code"] != new["code"]:
        reasons.append(f"code changed: {', '.join(changed(old_record, new_record))}")
    return reasons or list(otherwise)


def _differences(old, new, name):
    """Settings that differ, named to the depth where they do."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(set(old) | set(new)):
            yield from _differences(old.get(key, ABSENT), new.get(key, ABSENT), f"{name}.{key}" if name else key)
    elif old != new or type(old) is not type(new):
        yield f"{name}: {_short(old)} -> {_short(new)}"


def _input_reasons(old, new):
    """Inputs that differ in content, by name."""
    before = {_input_name(item): item for item in old}
    after = {_input_name(item): item for item in new}
    reasons = [f"input {name} added" for name in after if name not in before]
    reasons += [f"input {name} removed" for name in before if name not in after]
    for name, item in after.items():
        if name in before and item["digest"] is not None and item["digest"] != before[name]["digest"]:
            reasons.append(f"input file {name} changed" if "file" in item else f"input {name} changed")
    return reasons


def _input_name(item):
    """Name of an input: file, or kind and variant."""
    return item.get("file") or ".".join(part for part in (item["kind"], item["variant"]) if part)


def changed(old_record, new_record):
    """Names of the parts of the code that changed, came or went between two records."""
    old, new = old_record.get("modules", {}), new_record.get("modules", {})
    return sorted(name for name in set(old) | set(new) if old.get(name) != new.get(name)) or ["(unknown)"]


def _short(value):
    """A value on one line."""
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
