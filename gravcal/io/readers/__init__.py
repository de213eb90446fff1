"""Readers of Level-1 files: one table per product, one way to read them all."""

from gravcal.io.archive import LevelOneFile, find, inventory
from gravcal.io.readers.dataset import read

__all__ = ["LevelOneFile", "find", "inventory", "read"]
