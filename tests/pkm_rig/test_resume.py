"""A campaign that broke off goes on: what is stored is not measured again."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.toml_file import InputError
from drivers.errors import DeviceError
from pkm_rig import calibrate as job
from pkm_rig.store import Store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file


def silent(*_):
    return None


def test_a_campaign_that_broke_off_goes_on(tmp_path):
    file, machine = short_rig_file(seed=4)
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (mock, rig):
        left = iter(range(60))

        def breaks(_advance, _total, what):
            if what == "calibration" and next(left, None) is None:
                mock.drives[0].inject_fault()

        with pytest.raises(DeviceError, match="0x2310"):
            job.measure(rig, store, silent, breaks)
        campaign = store.campaigns()[0][0]
        said = store.events(campaign, "failed")[0].data["emergencies"][0]
        assert (said["drive"], said["code"]) == ("left", 0x2310)
        assert 0.0 < said["t_rig_s"] <= rig.clock.now_s()
        before = store.recording(campaign)
        rig.drives.clear_stop()
        rig.drives.fault_reset()
        job.measure(rig, store, silent, silent, resume=campaign)
        after = store.recording(campaign)
        with pytest.raises(InputError, match="not measured here"):
            job.measure(rig, store, silent, silent, resume="nothing")
        rig.file = file.model_copy(update={"campaign": file.campaign.model_copy(update={"seed": 9})})
        with pytest.raises(InputError, match="another rig file"):
            job.measure(rig, store, silent, silent, resume=campaign)
    assert after["uid"].tolist()[: len(before)] == before["uid"].tolist()
    calibration = np.asarray(after["phase"]) == "calibration"
    keys = [
        (int(pose), int(pass_), str(smr))
        for pose, pass_, smr in zip(
            after["pose"][calibration], after["pass"][calibration], after["smr"][calibration], strict=True
        )
    ]
    assert len(keys) == len(set(keys)) == 12 * 4 * 5
    store.close()
