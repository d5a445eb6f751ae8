"""Each package says in `__all__` what it holds."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = sorted(
    ".".join(init.parent.relative_to(ROOT).parts)
    for top in ("calibration", "drivers", "mock_devices", "pkm_rig")
    for init in (ROOT / top).rglob("__init__.py")
)
WITH_NAMES = ("pkm_rig", "pkm_rig.cli", "mock_devices.effects")  # these offer functions and classes, not modules


@pytest.mark.parametrize("name", [name for name in PACKAGES if name not in WITH_NAMES])
def test_a_package_names_its_modules(name):
    package = importlib.import_module(name)
    folder = Path(package.__path__[0])
    modules = {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}
    assert sorted(package.__all__) == sorted(modules - {"__init__", "__main__"})


@pytest.mark.parametrize("name", WITH_NAMES)
def test_a_package_has_the_names_that_it_offers(name):
    package = importlib.import_module(name)
    assert package.__all__
    assert all(hasattr(package, offered) for offered in package.__all__)
