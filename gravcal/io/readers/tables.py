"""The tables of the Level-1 products as frozen records: what a file of each product holds, column by column."""

import tomllib
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

from gravcal.errors import refuse

PRODUCTS = Path(__file__).with_name("products")
SI_UNITS = {
    "": "1",
    "seconds": "s",
    "second": "s",
    "microseconds": "us",
    "nanoseconds": "ns",
    "milliseconds": "ms",
    "m/s": "m s-1",
    "m/s2": "m s-2",
    "rad/s2": "rad s-2",
    "s/s": "s s-1",
    "microTesla": "uT",
    "microrad": "urad",
    "degrees": "degree",
    "degrees N": "degree",
    "degrees E": "degree",
    "degrees C": "degC",
    "V/V": "V V-1",
    "0.1 db-Hz": "0.01 lg(re 1 Hz)",
    "db-Hz": "0.1 lg(re 1 Hz)",
}
BITS = {"b8": "u1", "b16": "u2", "b32": "u4"}
INTEGERS = ("i1", "i4", "u1", "u2", "u4")
FLOATS = ("f4", "f8")


@dataclass(frozen=True)
class Column:
    """One column: ``kind`` is a number (i1 i4 u1 u2 u4 f4 f8), c(haracter), b8 b16 b32 (bits) or text (to the end)."""

    name: str
    kind: str
    unit: str = ""
    frame: str = ""
    meaning: str = ""
    range: tuple = ()
    bit: int | None = None
    gap: int = 1
    file: str = ""
    header_unit: str = ""
    default: float | str | None = None

    @property
    def file_name(self) -> str:
        """Name in the header of a file."""
        return self.file or self.name

    @property
    def units(self) -> str:
        """Unit in SI spelling."""
        return SI_UNITS.get(self.unit, self.unit)


@dataclass(frozen=True)
class Product:
    """The table of one product for one mission (``"GRACE"`` or ``"GRACE-FO"``)."""

    name: str
    mission: str
    title: str
    columns: tuple[Column, ...]
    time: tuple[str, ...]
    time_scale: str
    summary: str = ""
    source: str = ""
    instrument: str = ""
    header: str = "yaml"
    file_type: str = ""
    sampled: bool = True
    constant: bool = False
    keys: tuple[str, ...] = ()
    quaternion: tuple[str, ...] = ()
    to_srf: tuple[tuple[str, ...], ...] = ()
    optional: tuple[Column, ...] = ()
    repeated: tuple[Column, ...] = ()
    header_only: tuple[str, ...] = ()
    swapped_in_header: tuple[str, ...] = ()
    swapped_in_binary: tuple[str, ...] = ()
    current_b_sign: int = 0
    receiver_time: tuple[str, ...] = ()
    flags: dict | None = None
    values: dict | None = None

    @property
    def id_name(self) -> str:
        """Column that names the satellite, empty for combined products."""
        return next((c.name for c in self.columns if c.name in ("GRACEFO_id", "GRACE_id")), "")

    @property
    def layout_key(self) -> str:
        """Column that decides which values follow, empty where all records are alike."""
        return "prod_flag" if self.optional else "n_prns" if self.repeated else ""

    @property
    def is_text(self) -> bool:
        """True if the last column runs to the end of the record."""
        return self.columns[-1].kind == "text"

    def column(self, name: str) -> Column:
        """The column of that name."""
        return next(c for c in (*self.columns, *self.optional, *self.repeated) if c.name == name)

    def following(self, key: int) -> tuple[Column, ...]:
        """Columns after the fixed ones where the layout key has this value."""
        if self.repeated:
            return self.repeated * key
        return tuple(c for c in self.optional if key >> c.bit & 1)

    def undefined_bits(self, key: int) -> list[int]:
        """Bits of a product flag that stand for no column of this table."""
        known = {c.bit for c in self.optional}
        return [bit for bit in range(32) if self.optional and key >> bit & 1 and bit not in known]


@cache
def names() -> tuple[str, ...]:
    """All products that have a table."""
    return tuple(sorted(path.stem for path in PRODUCTS.glob("*.toml")))


@cache
def product(name: str, mission: str = "GRACE-FO") -> Product:
    """Table of a product ("ACC1A") for a mission: "GRACE" (satellites A, B, X) or "GRACE-FO" (C, D, Y)."""
    if name not in names():
        refuse(name, "no table for this product", f"one of {', '.join(names())}", "Check the product name.")
    table = _loaded(name)
    grace = table.pop("grace", {})
    if mission == "GRACE":
        table = _for_grace(table, grace)
    known = {f.name for f in fields(Product)}
    kinds = ("columns", "optional", "repeated")
    columns = {k: tuple(Column(**c | {"range": tuple(c.get("range", ()))}) for c in table.get(k, ())) for k in kinds}
    rest = {k: _frozen(v) for k, v in table.items() if k in known and k not in columns}
    return Product(name=name, mission=mission, **rest, **columns)


def _loaded(name):
    table = tomllib.loads((PRODUCTS / f"{name}.toml").read_text(encoding="utf-8"))
    if "like" in table:
        table = {**_loaded(table["like"]), **table}
    return table


def _for_grace(table, grace):
    changed = {**table, **{k: v for k, v in grace.items() if k not in ("flags", "ranges", "units")}}
    changed["flags"] = {**table.get("flags", {}), **grace.get("flags", {})}
    for key in ("columns", "optional", "repeated"):
        changed[key] = [dict(column) for column in changed.get(key, [])]
        for column in changed[key]:
            if column["name"] == "GRACEFO_id":
                column |= {"name": "GRACE_id", "meaning": "GRACE satellite identifier", "range": ["A", "B"]}
            for given, what in (("ranges", "range"), ("units", "unit")):
                if column["name"] in grace.get(given, {}):
                    column[what] = grace[given][column["name"]]
    if "optional_of" in grace:
        other = _loaded(grace["optional_of"])
        changed["optional"] = other["optional"] + other["grace"]["extra_optional"]
    changed["optional"] = sorted(changed["optional"] + grace.get("extra_optional", []), key=lambda c: c["bit"])
    changed["swapped_in_binary"] = [
        "GRACE_id" if n == "GRACEFO_id" else n for n in changed.get("swapped_in_binary", [])
    ]
    changed["title"] = table["title"].replace("GRACE-FO", "GRACE")
    return changed


def _frozen(value):
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


def mission_of(satellite: str) -> str:
    """Mission a satellite letter belongs to."""
    return "GRACE" if satellite in tuple("ABX") else "GRACE-FO"


def reordered(table: Product, swapped: tuple[str, ...]) -> Product:
    """The same table with two columns exchanged."""
    if not swapped:
        return table
    other = dict(zip(swapped, reversed(swapped), strict=True))
    return replace(table, columns=tuple(table.column(other.get(c.name, c.name)) for c in table.columns))
