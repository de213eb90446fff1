"""Calibrations: observation equations and their solution; datasets in, datasets out, as the schema of a stage says."""

import importlib


def offered(package, **modules):
    """`__getattr__` of a package with names of its modules {name: module}, which commands load without."""

    def attribute(name):
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{modules[name]}"), name)

    return attribute
