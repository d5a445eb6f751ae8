"""What tables leave of the tool's predicted error is told, however little they leave of the drives' corrections."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.compensation.correction import Correction
from calibration.compensation.decomposition import Loss, corrections_at
from calibration.compensation.formats.catalogue import FORMATS
from calibration.compensation.formats.control import Order
from calibration.compensation.remaining_error import NEGLIGIBLE, Change, RemainingError
from tests.calibration.compensation.drawn_machine import DrawnMachine


def corrected_by(name, seed, form_name):
    """A drawn machine's tool errors (n, 6) without and with a format's tables, what is said of them, and the loss."""
    drawn, form = DrawnMachine.of(name, seed), FORMATS[form_name]
    machine, error = drawn.machine, drawn.tool_error_free()
    correction = Correction.sampled(machine, error)
    made = form.build(Order(correction, form.controls[0], tuple("XYZABCUV"[: len(machine.drive_names)])))
    check = correction.check
    corrected = check.drives + corrections_at(made.tables, check.drives)
    errors = error(check.drives, check.target_m), error(corrected, check.target_m)
    remaining = RemainingError.of(machine, error, check, corrected)
    return errors, remaining, Loss.of(made.tables, check.drives, check.correction)


def test_it_is_the_rms_of_what_is_commanded():
    (before, after), remaining, _ = corrected_by("prs3", 1, "heidenhain-com")  # z, rx and ry are commanded
    for change, columns in ((remaining.position_m, [2]), (remaining.rotation_rad, [3, 4])):
        assert change.before == pytest.approx(np.sqrt(np.sum(before[:, columns] ** 2) / len(before)), rel=1e-12)
        assert change.after == pytest.approx(np.sqrt(np.sum(after[:, columns] ** 2) / len(after)), rel=1e-12)
    assert "; rotation " in remaining.in_words
    assert corrected_by("planar4", 1, "linuxcnc-comp")[1].rotation_rad is None


def test_tables_that_hold_more_than_half_of_the_drives_corrections_can_make_the_tool_worse():
    _, remaining, loss = corrected_by("prs3", 4, "beckhoff-plane")
    assert loss.remaining_share < 0.5
    assert remaining.position_m.removed_share < -0.2


def test_a_share_is_of_what_was_there_and_what_is_negligible_counts_as_removed():
    assert Change(4e-5, 1e-5).removed_share == pytest.approx(0.75)
    assert Change(2e-5, 3e-5).removed_share == pytest.approx(-0.5)
    assert Change(0.0, NEGLIGIBLE).removed_share == 1.0
    assert Change(NEGLIGIBLE, 3.0 * NEGLIGIBLE).removed_share < 0.0
    assert Change(2e-5, 3e-5).as_json == {"before": 2e-5, "after": 3e-5}
