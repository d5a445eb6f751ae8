"""A mock rig whose own control plays an NC program, and the rig that watches it through the station alone."""

from __future__ import annotations

from contextlib import contextmanager

from mock_devices.nc.correction import read_correction
from mock_devices.nc.program import read_program
from pkm_rig.jobs.nc_program import NcChoice, write_program
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.connection import connect_watched_rig
from pkm_rig.virtual.mock_rig import embedded_mock_rig

STARTS = ("start the program at N", "is measured")


@contextmanager
def controlled_rig(
    file, machine, folder, *, choice=None, first=(), corrections=None, start_s=0.0, operator_s=None, path=None
):
    """The player of the mock's control, and the connected rig."""
    path = path or embedded_rig_path()
    program = folder / "visits.ngc"
    write_program(file, machine, program, choice or NcChoice(), first)
    names = [drive.name for drive in file.drives]
    tables = {n: read_correction(where, names) for n, where in (corrections or {}).items()}
    with embedded_mock_rig(file, path, start_s=start_s) as mock, mock.clock.activity():
        player = mock.mock.load_program(read_program(program), tables, operator_s)
        with connect_watched_rig(mock.file, machine, mock.clock, rig_path=path) as rig:
            yield player, rig


def operator(player, said=None):
    """A `notify` that presses start whenever it is told to, and keeps what was said."""

    def hear(line):
        if said is not None:
            said.append(line)
        if STARTS[0] in line:
            number = int(line.split(STARTS[0])[1])
            if player.state.startswith("waits for"):
                player.start()
            elif player.state != "running":
                player.start(number)
        elif line.endswith(STARTS[1]) and player.state == "waits for start":
            player.start()

    return hear
