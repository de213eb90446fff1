"""Headers of Level-1 files: the YAML one of GRACE-FO RL04 and the 80-column one of GRACE and the constants."""

import re
from dataclasses import dataclass, field

from gravcal.errors import refuse

YAML_END = b"# End of YAML header\n"
LABEL_END = re.compile(rb"END OF HEADER *\r?\n")
LIMIT = 8_000_000  # bytes in which the end of a header has to come
DEEPEST = 20  # levels; headers have five
KEPT = ("title", "summary", "source", "institution", "processing_level", "product_version", "software_version")


@dataclass(frozen=True)
class Header:
    """What the header of a file says; ``names`` are its columns in order, empty where it lists none."""

    form: str
    binary: bool
    size: int
    lines: int
    satellite: str = ""
    declared: int | None = None
    names: tuple[str, ...] = ()
    product: str = ""
    notes: dict = field(default_factory=dict)


def parse(data: bytes, where) -> Header:
    """Header at the start of a Level-1 file.

    Raises
    ------
    ProductError : no end of header, or a header that cannot be understood
    """
    if data.startswith(b"header:"):
        return _yaml_header(data, where)
    return _label_header(data, where)


def _yaml_header(data, where):
    end = data.find(YAML_END, 0, LIMIT)
    if end < 0:
        refuse(where, "no end of the YAML header", repr(YAML_END.decode().strip()), "The file is cut or foreign.")
    size = end + len(YAML_END)
    tree = _yaml(data[:end], where)
    try:
        loose = {**(tree.get("global_attributes") or {}), **(tree.get("non-standard_attributes") or {})}
        names = tuple(v if isinstance(v, str) else str(next(iter(v))) for v in tree.get("variables") or ())
        declared = (tree.get("dimensions") or {}).get("num_records")
        declared = None if declared is None else int(declared)
    except (KeyError, TypeError, ValueError, AttributeError) as reason:
        refuse(where, f"a header without {reason}", "attributes and variables as YAML", "The file is damaged.")
    notes = {k: str(loose[k]) for k in KEPT if k in loose and not isinstance(loose[k], (dict, list))}
    satellite = _letter(str(loose.get("platform", "")))
    return Header("yaml", False, size, data.count(b"\n", 0, size), satellite, declared, names, "", notes)


def _yaml(text, where):
    import yaml

    loader, depth = getattr(yaml, "CSafeLoader", yaml.SafeLoader), 0
    try:
        for event in yaml.parse(text, loader):  # the loader below recurses, and crashes where it goes too deep
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
                refuse(where, "a header nested too deep, or with aliases", "attributes as YAML", "The file is damaged.")
        return yaml.load(text.decode("utf-8"), loader)["header"]  # noqa: S506 - both loaders are safe ones
    except UnicodeDecodeError as reason:
        line = text.count(b"\n", 0, reason.start) + 1
        return refuse(f"{where}, line {line}", "bytes that are not UTF-8", "a text header", "The file is damaged.")
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as reason:
        return refuse(where, f"a header that is not YAML ({reason})", "a YAML header", "The file is damaged.")


def _label_header(data, where):
    end = LABEL_END.search(data, 0, LIMIT)
    if not end:
        refuse(
            where,
            f"a start of {data[:20]!r}",
            "a YAML or an 80-column header",
            "This is no Level-1 file, or a cut one.",
        )
    labels = {}
    for line in data[: end.start()].decode("latin-1").splitlines():
        label, _, value = line.partition(":")
        labels.setdefault(label.strip(), value.strip())
    declared = labels.get("NUMBER OF DATA RECORDS", "")
    binary = labels.get("FILE FORMAT 0=BINARY 1=ASCII") == "0"
    notes = {"software_version": labels.get("SOFTWARE VERSION", ""), "institution": _institution(labels)}
    return Header(
        "label",
        binary,
        end.end(),
        data.count(b"\n", 0, end.end()),
        _letter(labels.get("SATELLITE NAME", "")),
        int(declared) if re.fullmatch("[0-9]{1,18}", declared) else None,
        product=labels.get("FILENAME", "").rpartition("/")[2][:5],
        notes={k: v for k, v in notes.items() if v},
    )


def _institution(labels):
    parts = (labels.get(f"PRODUCER {x}") for x in ("AGENCY", "INSTITUTION"))
    return "/".join(p for p in parts if p)


def _letter(platform):
    found = re.fullmatch(r"GRACE ([A-D])(\+[A-D])?", platform.strip())
    if not found:
        return ""
    return {"A": "X", "C": "Y"}.get(found[1], "") if found[2] else found[1]
