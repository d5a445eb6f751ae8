"""The diagnosis on a plant in MuJoCo in which errors emerge from contacts, springs and friction
(docs/explanation/emergent.md).

`run` makes and scores the cases: `cases` says which, `making` makes one of what `faults`, `machines`, `campaign` and
`disturbances` draw; `drive_model` and `strut_model` are the plant, `statics` its check by hand, `sizes` what is visible
of a change, and `readings` the station and the files.
"""

__all__ = [
    "campaign", "cases", "disturbances", "drive_model", "faults", "machines", "making", "readings", "run", "sizes",
    "statics", "strut_model",
]  # fmt: skip
