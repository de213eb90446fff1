"""The rules of the house that a machine can check, one test a rule."""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import seeds

from flows.calibration import known

ROOT = Path(__file__).parent.parent
PREFECT = ("flows", "tasks")
XARRAY = ("calibrations", "catalog", "io", "store", "discovery", "report", "simulation", "tasks")
OURS = ("gravcal", "tasks", "flows", "catalog")


def modules():
    """Names and paths of all modules that the wheel ships."""
    paths = [path for top in ("gravcal", "tasks", "flows") for path in sorted((ROOT / top).rglob("*.py"))]
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}


@cache
def imports(path):
    """Full names that a file imports, at any depth; relative ones made absolute; lazy("...") counts."""
    package, found = path.relative_to(ROOT).parent.parts, set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) + 1 - node.level]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            found |= {f"{module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "lazy" and node.args:
            found.add(node.args[0].value)
    return found


def layer(name):
    """Layer of a module: its top package, inside gravcal the next one; the page of a calibration is one."""
    parts = name.removesuffix(".__init__").split(".")
    if parts[:2] == ["gravcal", "calibrations"] and parts[3:4] == ["page"]:
        return "pages"
    return parts[1] if parts[0] == "gravcal" and len(parts) > 1 else parts[0]


def test_imports_are_those_of_the_table_and_point_down():
    """Contract: as in the table of docs/architecture.md; Prefect is for flows and tasks, xarray for datasets."""
    rows = re.findall(r"^\| `(\w+)` \|.*\|([\w, ]*)\|$", (ROOT / "docs" / "architecture.md").read_text(), re.MULTILINE)
    stated = {name: set(filter(None, map(str.strip, below.split(",")))) for name, below in rows}
    found = {name: set() for name in stated}
    for name, path in modules().items():
        if layer(name) in found:  # not the interface: what it imports, it imports when it is asked
            ours = {layer(one) for one in imports(path) if one.split(".")[0] in OURS}
            found[layer(name)] |= ours & stated.keys() - {layer(name)}
    assert found == stated
    order = list(stated)
    up = {(own, one) for own in order for one in stated[own] if order.index(one) <= order.index(own)}
    assert up == {("store", "io")}
    layers = {"prefect": set(), "xarray": set()}
    for name, path in modules().items():
        for top in layers.keys() & {imported.split(".")[0] for imported in imports(path)}:
            layers[top].add(layer(name))
    assert layers["prefect"] <= set(PREFECT)
    assert layers["xarray"] <= set(XARRAY)


def test_a_calibration_imports_no_other():
    """Contract: what two calibrations share moves right."""
    for name, path in modules().items():
        if name.startswith("gravcal.calibrations."):
            others = {one.split(".")[2] for one in imports(path) if layer(one) == "calibrations"}
            assert not (others - {name.split(".")[2]}) & set(known()), name


def test_every_calibration_has_its_files():
    """Contract: one name for science, stages, flow, parameters and tests."""
    science, tests = ROOT / "gravcal" / "calibrations", ROOT / "tests" / "calibrations"
    for name in known():
        if (ROOT / "flows" / f"{name}.py").exists():
            assert (science / f"{name}.py").exists() or (science / name / "__init__.py").exists()
            assert (ROOT / "tasks" / f"{name}.py").exists()
            assert (ROOT / "catalog" / "parameters" / f"{name}.toml").exists()
            assert [*tests.glob(f"test_{name}*.py"), *(tests / name).glob("test_*.py")]


def test_the_false_alarms_of_the_suite_are_stated():
    """Contract: every draw has its level, and their sum is not above what docs/architecture.md says."""
    stated = seeds.levels()
    assert len(stated) > 25
    assert sum(stated.values()) < 0.009
    assert "add up to less than 0.9 %" in (ROOT / "docs" / "architecture.md").read_text()


def test_every_mutant_of_the_benchmark_changes_a_line_that_stands_there_once():
    """Rule: what is gone is no mutant; `python -m benchmarks mutants` would count it as missed."""
    for path, entry in tomllib.loads((ROOT / "benchmarks" / "mutants.toml").read_text()).items():
        text = (ROOT / "gravcal" / path).read_text()
        assert [old for old, *_ in entry["mutants"] if text.count(old) != 1] == [], path


def test_variables_are_named_for_the_quantity_that_they_hold():
    """Contract: how a value was come by is none; but for what a user gives, and the words of an error."""
    bound = {}
    for name, path in modules().items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                bound.setdefault(node.id, set()).add(name)
            elif isinstance(node, ast.arg):
                bound.setdefault(node.arg, set()).add(name)
    known = {"found": {"gravcal.errors", "gravcal.catalog"}, "given": {"gravcal.calibrations.kbr_phase_centre.model"}}
    assert {one: bound[one] for one in ("told", "seen", "felt", "found", "given") if one in bound} == known
