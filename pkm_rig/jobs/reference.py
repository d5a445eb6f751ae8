"""The calibration in force as what later readings are compared with: its model, its values, their covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.machine.description import Machine
from calibration.model.model import Model, Poses, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.payload import PayloadEntry
from calibration.model.visits import Visits
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.store.life import IDENTIFIED, LifeRow, life_rows
from pkm_rig.store.store import Store

MOUNTING = "mounting."
DRIFT_SHARE = 0.1  # of a tolerance's standard deviation that a parameter may have changed by since its calibration


@dataclass(frozen=True)
class Reference:
    """A stored calibration.

    values (k,) and covariance (k, k): of `names`, first the model's unknowns in their order, then the mountings of the
    reflectors that were measured. noise: factor on stated standard deviations that its own readings asked for.
    temperatures_c: of the parts that its tables are for. report: the frame of before and after in the machine's, and
    its reflectors, as the row has them.
    """

    campaign: str
    model: Model
    names: tuple[str, ...]
    values: Array
    covariance: Array
    noise: float
    temperatures_c: Mapping[str, float]
    report: Mapping[str, Any]

    @property
    def machine(self) -> Machine:
        """The machine."""
        return self.model.machine

    @property
    def moving(self) -> tuple[int, ...]:
        """Rows in the machine file of all reflectors that move."""
        return tuple(i for i, smr in enumerate(self.machine.smrs) if smr.on != "floor")

    def mounting_m(self) -> Array:
        """Places (s, 3) of all reflectors on their parts; nominal where one was not measured."""
        places = np.array([smr.position_m for smr in self.machine.smrs])
        for name, value in zip(self.names, self.values, strict=True):
            if name.startswith(MOUNTING):
                smr, axis = name.removeprefix(MOUNTING).rsplit(".", 1)
                places[[s.name for s in self.machine.smrs].index(smr), "xyz".index(axis)] += value
        return places

    def predict(self, visits: Visits) -> Poses:
        """Poses of visits in the machine's frame."""
        return self.model.predict(self.values[: len(self.model)], visits)

    def report_frame(self, frame: Frame) -> ReportFrame:
        """The frame of before and after as a station sees it that sees the machine's frame there.

        InputError of a calibration that did not keep it.
        """
        if not self.report:
            raise InputError(f"calibration {self.campaign}: it kept no frame; calibrate the machine anew, in full")
        names = [smr.name for smr in self.machine.smrs]
        rotation, shift = np.array(self.report["rotation"]), np.array(self.report["translation_m"])
        return ReportFrame(
            self.machine,
            Frame(frame.rotation @ rotation, frame.rotation @ shift + frame.translation_m),
            tuple(names.index(name) for name in self.report["smrs"]),
            np.array(self.report["mounting_m"]),
        )

    def watched_covariance(self) -> Array:
        """Covariance (p + 3 q) of machine parameters and mountings of all moving reflectors."""
        return self._of_parameters_and_mountings(self.covariance)

    def drift_covariance(self, reseat_m: float) -> Array:
        """What parameters may have changed by since (DRIFT_SHARE of their tolerance), and reflectors by reseating."""
        sigma = np.array([p.sigma for p in self.model.parameters.parameters])
        mountings = np.full(3 * len(self.moving), max(reseat_m, 1e-7))
        return np.diag(np.concatenate([DRIFT_SHARE * sigma, mountings]) ** 2)

    def _of_parameters_and_mountings(self, covariance: Array) -> Array:
        count = len(self.model.parameters)
        wanted = [f"{MOUNTING}{self.machine.smrs[i].name}.{axis}" for i in self.moving for axis in "xyz"]
        missing = [name for name in wanted if name not in self.names]
        if missing:
            raise InputError(f"calibration {self.campaign}: it has no {missing[0]}; calibrate with all reflectors")
        rows = [*range(count), *(self.names.index(name) for name in wanted)]
        return np.asarray(covariance[np.ix_(rows, rows)])


def keeps_covariance(store: Store, rig: str, campaign: str) -> bool:
    """Whether a calibration was made by a version that kept a covariance, so that checks can be compared with it."""
    rows = life_rows(store, "calibrations", rig)
    return any((row.campaign, row.kind) == (campaign, IDENTIFIED) for row in rows)


def load_reference(
    store: Store, rig: str, campaign: str, machine: Machine, payloads: tuple[PayloadEntry, ...]
) -> Reference:
    """A calibration of the store; InputError where it was made by a version that kept no covariance."""
    own = [row for row in life_rows(store, "calibrations", rig) if row.campaign == campaign]
    rows = [row for row in own if row.kind == IDENTIFIED]
    if not rows:
        raise InputError(
            f"calibration {campaign}: made by an older version, which kept no covariance; calibrate the machine anew"
        )
    warmths = [row.data["table_temperatures_c"] for row in own if "table_temperatures_c" in row.data]
    return reference_of(rows[-1], machine, payloads, warmths[-1] if warmths else rows[-1].data["temperatures_c"])


def reference_of(
    row: LifeRow, machine: Machine, payloads: tuple[PayloadEntry, ...], temperatures_c: Mapping[str, float]
) -> Reference:
    """A calibration's row as a reference; InputError if it is of another model than the machine has today."""
    model = Model(ParameterSet.of(machine), SystematicUncertainties.from_declared(payloads, machine))
    unknowns = row.data["unknowns"]
    names = tuple(str(name) for name in unknowns["names"])
    if names[: len(model)] != tuple(unknown.name for unknown in model.unknowns):
        raise InputError(
            f"calibration {row.campaign}: its unknowns are not those of the machine and the payloads as they are "
            "stated now; calibrate anew"
        )
    return Reference(
        campaign=str(row.campaign),
        model=model,
        names=names,
        values=np.array(unknowns["values"], dtype=np.float64),
        covariance=np.array(unknowns["covariance"], dtype=np.float64),
        noise=float(np.sqrt(max(1.0, row.data["chi2_per_dof"]))),
        temperatures_c=dict(temperatures_c),
        report=row.data.get("report", {}),
    )
