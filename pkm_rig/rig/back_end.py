"""Ways to have an identified correction act on a connected rig: tables in the drives, or this computer's own targets.

Each can build a correction, say its limits by refusing, put it on trial (write, read back, activate), say what to
command, confirm that it is what acts, keep it, and go back to what was before.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.host import HostCorrection, correction_by, host_correction
from calibration.compensation.limits import require_change, require_size_and_slope
from calibration.compensation.measured_range import MeasuredRange
from calibration.compensation.samples import Corrections, CorrectionSamples, slopes_of
from calibration.compensation.tables import CompensationTable, build_table, correction_at, table_for_payload
from calibration.identification.calibration import Calibration
from calibration.identification.fit import Fit
from calibration.machine.inverse import nominal_drives
from calibration.machine.led_path import tool_coordinates
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import Block
from pkm_rig.rig.table_change import TableChange

Correction = CompensationTable | HostCorrection
U_POSES = 8  # at which the forces' uncertainty is looked at


class BackEnd(ABC):
    """One way; `change` records what the drives had before. Methods raise DeviceError, StoreError and InputError."""

    name: str

    def __init__(self, rig: Rig, change: TableChange) -> None:
        self.rig, self.change = rig, change

    @abstractmethod
    def build(self, calibration: Calibration, payload: int, temperatures_c: dict[str, float]) -> Correction:
        """The correction for a payload at some temperatures; InputError where limits do not permit it."""

    @abstractmethod
    def build_partly(
        self, fit: Fit, report: ReportFrame, conditions: OperatingConditions, measured: MeasuredRange | None
    ) -> Correction:
        """The correction by a calibration that was brought up to date; measured: the range of both, where it counts."""

    def against_reversals(self, correction: Correction, reversal_m: Array) -> Correction:
        """It with values for each direction against reversal values (d,) of the drives, where it can have such."""
        del reversal_m
        return correction

    def reversals(self, correction: Correction) -> Array:
        """Reversal values (d,) that it compensates."""
        del correction
        return np.zeros(len(self.rig.machine.drive_names))

    @abstractmethod
    def use_former(self, former: HostCorrection | None) -> None:
        """Have what was before act again, within the change: to measure with it. former: the host's, if it had one."""

    @abstractmethod
    def try_out(self, correction: Correction) -> dict[str, dict[str, Any]]:
        """Write it, read it back and have it act on trial; what each drive has, for the store."""

    @abstractmethod
    def commanded(self, block: Block, correction: Correction) -> Block:
        """Visits as they are to be commanded while it acts."""

    @abstractmethod
    def require_in_use(self) -> None:
        """Raise TableError unless what was tried last still acts, and nothing else."""

    @abstractmethod
    def keep(self) -> None:
        """Have it act for good: it is verified, and the verdict is stored."""

    def remark(self, block: Block, correction: Correction) -> str | None:
        """What is to be said of a correction before it is tried, None if nothing."""
        del block, correction
        return None

    @abstractmethod
    def corrections(self, correction: Correction) -> tuple[Corrections, Array]:
        """What it adds to the drives (n, d) at platform poses (n, 6), NaN where nothing; the box (k, 2) it is for."""

    def samples(self, correction: Correction) -> CorrectionSamples:
        """It at some poses, for the store. InputError where it is too large, or changes too fast along a drive."""
        machine, (corrections, box) = self.rig.machine, self.corrections(correction)
        samples = replace(CorrectionSamples.of(machine, box, corrections), reversal=self.reversals(correction))
        require_size_and_slope(machine, samples.correction, slopes_of(machine, box, corrections))
        return samples

    def changes_since(self, correction: Correction, former: CorrectionSamples) -> Array:
        """Changes (n, d), m or rad, since a former correction, at its samples within what was measured."""
        corrections, box = self.corrections(correction)
        commanded = tool_coordinates(self.rig.machine, former.target_m)
        inside = np.all((commanded >= box[:, 0]) & (commanded <= box[:, 1]), axis=1)
        if not np.any(inside):
            return np.zeros((0, former.correction.shape[1]))
        change = corrections(former.target_m[inside]) - former.correction[inside]
        turned = 0.5 * np.abs(self.reversals(correction) - former.reversal)
        return np.asarray(change + np.copysign(turned, change))

    def change_since(self, correction: Correction, former: CorrectionSamples, source: str, *, accept: bool) -> float:
        """The largest change (m or rad) since a former correction; InputError for one too large, unless accepted."""
        change = self.changes_since(correction, former)
        return require_change(self.rig.machine, change, source, accept=accept) if len(change) else 0.0

    def settings(self) -> dict[str, Any]:
        """What the correction can be built from again, beside payload and temperatures."""
        return {"back_end": self.name}

    def roll_back(self) -> None:
        """Go back to what was before."""
        self.change.bring_to_target()


class DriveTables(BackEnd):
    """Tables in two drives, which each drive interpolates over its own position and its partner's."""

    name = "drive-tables"

    def build(self, calibration: Calibration, payload: int, temperatures_c: dict[str, float]) -> CompensationTable:
        """A table over both drives' commanded positions."""
        return table_for_payload(calibration, payload, temperatures_c)

    def build_partly(
        self, fit: Fit, report: ReportFrame, conditions: OperatingConditions, measured: MeasuredRange | None
    ) -> CompensationTable:
        """The same."""
        del measured
        return build_table(fit, report, conditions)

    def against_reversals(self, correction: Correction, reversal_m: Array) -> Correction:
        """A table by direction, if all drives read such."""
        if not isinstance(correction, CompensationTable):
            raise TypeError("a table is needed")
        can = all(bank.objects.by_direction for bank in self.rig.banks)
        return correction.with_reversals(self.rig.machine, reversal_m) if can and np.any(reversal_m) else correction

    def reversals(self, correction: Correction) -> Array:
        """Half of each value either side."""
        if not isinstance(correction, CompensationTable):
            raise TypeError("a table is needed")
        return np.asarray(correction.by_direction_m[:, 0] - correction.by_direction_m[:, 1])

    def use_former(self, former: HostCorrection | None) -> None:
        """The drives' former tables, or none."""
        del former
        self.change.use_former()

    def remark(self, block: Block, correction: Correction) -> str | None:
        """How fine the grid is, and what interpolation adds."""
        del block
        if not isinstance(correction, CompensationTable):
            return None
        points = correction.correction_m.shape[1]
        rms_m, most_m = correction.interpolation_rms_m, correction.interpolation_max_m
        names = zip(self.rig.machine.drive_names, self.reversals(correction), strict=True)
        turned = ", ".join(f"{name} {value * 1e6:.1f} um" for name, value in names if value)
        return (
            f"tables of {points} x {points} nodes: interpolation adds {rms_m * 1e6:.2f} um RMS, {most_m * 1e6:.2f} um "
            f"at most{f'; by direction, against reversal values: {turned}' if turned else ''}"
        )

    def try_out(self, correction: Correction) -> dict[str, dict[str, Any]]:
        """Write the tables into all drives and use them on trial."""
        if not isinstance(correction, CompensationTable):
            raise TypeError("a table is needed")
        states = self.change.compensate(self.rig.images(correction, self.rig.next_generation()))
        return {
            drive.name: {"generation": state.generation, "crc": state.crc, "active": state.valid}
            | ({"reversal_m": float(value)} if value else {})
            for drive, state, value in zip(self.rig.file.drives, states, self.reversals(correction), strict=True)
        }

    def corrections(self, correction: Correction) -> tuple[Corrections, Array]:
        """As the drives interpolate them, over the workspace."""
        if not isinstance(correction, CompensationTable):
            raise TypeError("a table is needed")
        machine = self.rig.machine
        return lambda pose: correction_at(correction, nominal_drives(machine, pose)), machine.commanded_limits

    def commanded(self, block: Block, correction: Correction) -> Block:
        """The same visits: the drives correct."""
        del correction
        return block

    def require_in_use(self) -> None:
        """The drives are asked."""
        self.change.require_in_use()

    def keep(self) -> None:
        """Use the tables for good."""
        self.change.keep()


class Host(BackEnd):
    """This computer corrects its targets before it sends them. The drives' own tables are off meanwhile, and stay so.

    There is nothing in the drives to read back; what acts is what is commanded, and every reading records that. Which
    campaign's correction is in force, the store knows (`host_state`).
    """

    name = "host"

    def __init__(self, rig: Rig, change: TableChange) -> None:
        super().__init__(rig, change)
        self._crcs: dict[float, int] = {}  # of what was tried, by payload in kg

    def build(self, calibration: Calibration, payload: int, temperatures_c: dict[str, float]) -> HostCorrection:
        """The identified model itself."""
        return host_correction(calibration, payload, temperatures_c)

    def build_partly(
        self, fit: Fit, report: ReportFrame, conditions: OperatingConditions, measured: MeasuredRange | None
    ) -> HostCorrection:
        """The same. InputError beyond the range."""
        if measured is None:
            raise TypeError("a correction by the host is for what was measured")
        return correction_by(fit, report, conditions, measured)

    def use_former(self, former: HostCorrection | None) -> None:
        """The host's former correction, or none."""
        self.rig.compensate(None)
        if former is not None:
            self.rig.host = former.corrections
            self.require_in_use()

    def try_out(self, correction: Correction) -> dict[str, dict[str, Any]]:
        """Have this computer correct its targets; refused while a drive has a table on."""
        if not isinstance(correction, HostCorrection):
            raise TypeError("a correction by the host is needed")
        self._crcs[correction.conditions.payload_kg] = self.samples(correction).crc
        self.change.try_host(zlib.crc32(b"".join(crc.to_bytes(4, "little") for crc in self._crcs.values())))
        self.rig.compensate(None)
        self.rig.host = correction.corrections
        self.require_in_use()
        return {}

    def corrections(self, correction: Correction) -> tuple[Corrections, Array]:
        """By the identified model, over what was measured."""
        if not isinstance(correction, HostCorrection):
            raise TypeError("a correction by the host is needed")
        return correction.corrections, correction.measured.box

    def commanded(self, block: Block, correction: Correction) -> Block:
        """The visits with corrected drive positions. InputError beyond travel or limits."""
        if not isinstance(correction, HostCorrection):
            raise TypeError("a correction by the host is needed")
        return corrected_block(block, correction)

    def remark(self, block: Block, correction: Correction) -> str | None:
        """Forces that the model predicts of the struts, where there are more drives than coordinates to command."""
        if not isinstance(correction, HostCorrection) or not self.rig.machine.redundantly_actuated:
            return None
        target_m = np.array([visit.target_m for visit in block.visits])
        before, after = np.array([visit.drives_m for visit in block.visits]), correction.drives(target_m)
        rms, most = (
            [float(f(correction.forces_n(drives, target_m))) for drives in (before, after)]
            for f in (_rms, lambda force: np.max(np.abs(force)))
        )
        u = _rms(correction.force_u_n(after[:U_POSES], target_m[:U_POSES]))
        free = "" if correction.free is None else f"; that adds {correction.free.u_growth:.1%} to the tool's U"
        return (
            f"predicted strut forces: {rms[0]:.0f} N RMS, {most[0]:.0f} N at most; corrected {rms[1]:.0f} N (u "
            f"{u:.0f} N), {most[1]:.0f} N{free}"
        )

    def require_in_use(self) -> None:
        """No drive may correct as well."""
        self.rig.require_one_correction()

    def keep(self) -> None:
        """The accepted correction is in the store, by its campaign; the drives keep what they had, switched off."""
        self.change.keep()


def corrected_block(block: Block, correction: HostCorrection) -> Block:
    """Visits with corrected drive positions. InputError beyond travel, limits or what was measured."""
    drives = correction.drives(np.array([visit.target_m for visit in block.visits]))
    visits = (replace(visit, drives_m=row) for visit, row in zip(block.visits, drives, strict=True))
    return replace(block, visits=tuple(visits))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def back_end_of(rig: Rig, change: TableChange) -> BackEnd:
    """The back end that the rig file names, or that its machine needs."""
    return DriveTables(rig, change) if uses_tables(rig.file, rig.machine) else Host(rig, change)
