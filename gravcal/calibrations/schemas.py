"""What products hold: the schemas of a calibration, read from the TOML file of its name in its folder."""

import functools
import tomllib
from pathlib import Path

HERE = Path(__file__).parent


@functools.cache
def of(file: str) -> dict[str, dict[str, dict]]:
    """Schemas of the products of a calibration by stage, as `gravcal.store.product` has them.

    Tables that begin with "_" are no products: others include them. Every calibration has the products "checks" and
    "report" of the file that all share, unless it has its own. Where units differ between variants they are a tuple.
    """
    shared = tomllib.loads((HERE / "shared.toml").read_text())
    own = tomllib.loads((HERE / Path(file).stem / file).read_text()) if file != "shared.toml" else {}
    tables = own | shared | own  # its own first
    for table in tables.values():
        for one in table.pop("include", ()):
            table |= tables[one]
        for stated in table.values():
            if isinstance(stated.get("units"), list):
                stated["units"] = tuple(stated["units"])
    return {name: table for name, table in tables.items() if not name.startswith("_")}
