"""pytest plugin: a mock rig behind its real protocols, for tests of controllers that are not ours.

docs/how-to/test-a-controller.md. Nothing is imported before the fixture is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Protocol

import pytest

if TYPE_CHECKING:
    from pkm_rig.virtual.hil_rig import HilRig


class MockRigFactory(Protocol):
    """Starts a mock rig; it is stopped after the test."""

    def __call__(
        self, machine: str = ..., effects: Any = ..., faults: Any = ..., seed: int = ..., **options: Any
    ) -> HilRig:
        """machine: a shipped one; effects and faults: as for `pkm-rig mock`; seed: which machine of that kind."""
        ...


@pytest.fixture
def mock_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MockRigFactory]:
    """Starts mock rigs: `rig = mock_rig("planar4", effects=["backlash=2e-5,place=left"], seed=3)`.

    A rig has the addresses of its three devices and methods that change it while it runs
    (`pkm_rig.virtual.hil_rig.HilRig`).
    """
    with ExitStack() as stack:

        def start(
            machine: str = "planar4", effects: Any = (), faults: Any = (), seed: int = 1, **options: Any
        ) -> HilRig:
            from pkm_rig.virtual.hil_rig import start_rig  # noqa: PLC0415  # not before it is used

            folder = tmp_path_factory.mktemp("mock-rig")
            return stack.enter_context(start_rig(folder, machine, tuple(effects), tuple(faults), seed, **options))

        yield start
