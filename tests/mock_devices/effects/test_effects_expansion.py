"""Parts that do not expand as stated, by hand calculation."""

from __future__ import annotations

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, Alone

WARM_K = 3.0


class PartsWarm(Alone):
    """Alone, with the recorded temperatures of a test."""

    def __init__(self, name, size, warm_k=WARM_K, **kinds):
        super().__init__(name, size, **kinds)
        self.warm_k = warm_k

    def motion_states(self, *args, **kinds):
        state = super().motion_states(*args, **kinds)
        for part in state.parts_c:
            warm_k = self.warm_k[part] if isinstance(self.warm_k, dict) else self.warm_k
            state.parts_c[part] = np.full(len(state), FILE.reference_temperature_c + warm_k)
        return state


def test_screws_of_another_coefficient_grow_from_their_zero():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="screws")
    d = one.deviation(q=[[0.8, 1.4]])
    assert d.travel_m[0] == pytest.approx([4e-6 * WARM_K * 0.8, 4e-6 * WARM_K * 1.4])
    assert not np.any(d.base_joint_m)


def test_a_frame_of_another_coefficient_grows_about_the_origin_with_all_that_it_carries():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="frame")
    d = one.deviation(q=[[0.8, 1.4]])
    strain = 4e-6 * WARM_K
    # Joints of the left column are 1.2 m to the left: its slider goes left, which is +90 degrees from up.
    assert d.sideways_m[0] == pytest.approx([1.2 * strain, -1.2 * strain])
    assert d.travel_m[0] == pytest.approx([0.8 * strain, 1.4 * strain])
    assert d.base_joint_m[0] == pytest.approx([0.125j * strain, -0.125j * strain] * 2)


def test_a_frame_between_two_sensors_goes_by_their_mean():
    warm_k = {"base": 1.0, "columns": 3.0, "struts": 0.0, "platform": 0.0}
    one = PartsWarm("expansion_coefficient", 4e-6, warm_k, variant="mean_of_sensors")
    d = one.deviation(q=[[0.8, 1.4]])
    assert d.sideways_m[0, 0] == pytest.approx(1.2 * 4e-6 * 2.0)
    assert d.travel_m[0] == pytest.approx([0.0, 0.0], abs=1e-18)


def test_two_bonded_layers_bend_as_timoshenko_says():
    one = PartsWarm("expansion_coefficient", 4e-6, variant="bimetal")
    low = FILE.sliders[0].travel_m[0]
    d = one.deviation(t_s=[0.0] * 3, q=[[low, low], [low + 0.4, low], [low + 0.8, low]])
    m = n = 1.0  # thickness and stiffness of one layer over the other's
    timoshenko = (
        6.0 * 4e-6 * WARM_K * (1.0 + m) ** 2
        / (0.2 * (3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n))))
    )  # fmt: skip
    assert d.yaw_rad[:, 0] == pytest.approx([0.0, 0.4 * timoshenko, 0.8 * timoshenko])
    assert d.sideways_m[:, 0] == pytest.approx([0.0, 0.08 * timoshenko, 0.32 * timoshenko])
