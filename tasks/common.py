"""What every calibration begins with: where its Level-1 files are, and reading them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gravcal.data import product
from gravcal.errors import ProductError
from tasks.stage import lazy, stage

readers = lazy("gravcal.data.readers")
align_science = lazy("gravcal.calibrations.align")

product.register("ingest", product.ANY)


@dataclass(frozen=True)
class Source:
    """Where the Level-1 files of an event are.

    Attributes
    ----------
    event : name of the event
    satellite : letters, such as "C" or "CD"
    date : YYYY-MM-DD
    folder : holds the files, loose or in archives
    """

    event: str
    satellite: str
    date: str
    folder: Path

    def file(self, *products: str, satellite: str | None = None):
        """The first of these products that the folder holds.

        Parameters
        ----------
        *products : product names, most wanted first
        satellite : letter, by default the only one of the source
        """
        letter = satellite or self.satellite
        for name in products:
            for found in readers.inventory(self.folder):
                if (found.product, found.satellite, found.date) == (name, letter, self.date):
                    return readers.find(self.folder, name, letter, self.date)
        raise ProductError(
            f"{self.folder}: found no {' or '.join(products)} of satellite {letter} on {self.date}, expected one. "
            f"Put the file or its daily archive there, or give another --data, --satellite or --date.",
            folder=str(self.folder),
            products=products,
        )


def read_file(file):
    """Level-1 file as a dataset; the names of satellite and clock in every row are left to the attributes."""
    observed = readers.read(file, expect_satellite=file.satellite, expect_date=file.date)
    return observed.drop_vars([name for name in observed if observed[name].dtype.kind == "S"])


@stage(reads=["file"], writes="ingest", version=1)
def ingest(file):
    """Units, time tags and names of one Level-1 file."""
    return read_file(file)


def settings_of(satellite: Mapping, *names: str) -> dict:
    """Numbers of a satellite that a stage takes, by name."""
    return {name: satellite[name] for name in names}
