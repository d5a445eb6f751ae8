"""`pkm-rig`: runs a command; an expected failure is one line on stderr and a status (docs/reference/commands.md)."""

from __future__ import annotations

import errno
import functools
import logging
import os
import signal
import stat
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from calibration.base.errors import InputError
from drivers.errors import DeviceError
from pkm_rig.cli import (
    analysis_commands,
    certificate_command,
    device_commands,
    life_commands,
    mock_command,
    panel_command,
    recalibrate_command,
    record_commands,
    rig_commands,
    store_commands,
    table_commands,
)
from pkm_rig.cli.terminal_operator import ask_for_pause
from pkm_rig.errors import CampaignRefused, NotChecked, StoreError, WorkersGone
from pkm_rig.report.terminal import messages
from pkm_rig.version import __version__

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
REFUSED, BAD_INPUT, DEVICE, INTERNAL = 1, 2, 3, 4
CHECK_PATH, MAY_WRITE, FREE_SPACE = "check the path", "choose a place where you may write", "free space and go on"
PLACES = {  # what may be wrong with the place of a file: status, and what to do
    **dict.fromkeys((errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ELOOP), (BAD_INPUT, CHECK_PATH)),
    errno.ENAMETOOLONG: (BAD_INPUT, "choose a shorter name"),
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), (BAD_INPUT, MAY_WRITE)),
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), (DEVICE, FREE_SPACE)),
}
COMMANDS: dict[str, Callable[..., None]] = {  # in the order of the help
    "demo": rig_commands.demo,
    "calibrate": rig_commands.calibrate,
    "measure": rig_commands.measure,
    "verify": rig_commands.verify,
    "check": device_commands.check,
    "home": device_commands.home,
    "interim-test": device_commands.interim_test,
    "tables": table_commands.tables,
    "panel": panel_command.panel,
    "mock": mock_command.mock,
    "poses": analysis_commands.poses,
    "identify": analysis_commands.identify,
    "diagnose": analysis_commands.diagnose,
    "compare": analysis_commands.compare,
    "compensate": analysis_commands.compensate,
    "health": life_commands.health,
    "recalibrate": recalibrate_command.recalibrate,
    "history": life_commands.history,
    "list": store_commands.list_campaigns,
    "show": store_commands.show,
    "report": store_commands.report,
    "certificate": certificate_command.certificate,
    "export": store_commands.export_campaign,
    "import": store_commands.import_folder,
    "audit": record_commands.audit,
    "backup": record_commands.backup,
    "archive": record_commands.archive,
    "delete": record_commands.delete,
}

CONNECTING = (
    "calibrate",
    "measure",
    "verify",
    "check",
    "home",
    "interim-test",
    "tables",
    "panel",
    "health",
    "recalibrate",
)


def _with_store_of_rig(command: Callable[..., None]) -> Callable[..., None]:
    """The command, for which `--out` has the store that the rig file names, if it names one."""

    @functools.wraps(command)
    def bound(*, rig: Path | None = None, out: Path, **options: object) -> None:
        if rig is not None:
            from calibration.base.toml_file import read_toml  # noqa: PLC0415 - help comes without it
            from pkm_rig.rig.config import RigFile  # noqa: PLC0415
            from pkm_rig.store.place import bind_folder  # noqa: PLC0415

            address = read_toml(rig, RigFile).store
            if address is not None:
                bind_folder(out, address)
        command(rig=rig, out=out, **options)

    return bound


app = typer.Typer(pretty_exceptions_enable=False)
for _name, _command in COMMANDS.items():
    app.command(name=_name)(_with_store_of_rig(_command) if _name in CONNECTING else _command)


class Interrupted(BaseException):
    """SIGINT, SIGTERM or SIGHUP: everything unwinds, so the drives are stopped and left without power."""


LIBRARIES = ("asyncio", "bluesky", "can", "canopen", "event_model", "matplotlib", "pymodbus")


def main() -> None:
    """Run the command of `sys.argv` and exit with its status."""
    for library in LIBRARIES:  # what goes wrong is raised as our own error; the last line on stderr is that
        logging.getLogger(library).addHandler(logging.NullHandler())
    if threading.current_thread() is threading.main_thread():
        for number in STOPPING:
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as `nohup` leaves it
                signal.signal(number, _interrupt)
    try:
        sys.exit(app(prog_name="pkm-rig", standalone_mode=False))
    except typer.TyperException as error:
        _exit_with_line(BAD_INPUT, _usage_line(error))
    except typer.Abort:  # the input ended where an answer was asked for
        _exit_with_line(BAD_INPUT, "no answer, so nothing was done; answer, or say it with an option")
    except Interrupted as error:
        has_drives = {"demo", *CONNECTING}.intersection(sys.argv[1:2])  # of other commands none was connected
        line = "interrupted; the drives were stopped, what was read is kept" if has_drives else "interrupted"
        _exit_with_line(DEVICE, _with_notes(line, error))
    except InputError as error:
        _exit_with_line(BAD_INPUT, _with_notes(str(error), error))
    except CampaignRefused as error:
        _exit_with_line(REFUSED, _with_notes(str(error), error))
    except (DeviceError, NotChecked, StoreError, WorkersGone) as error:
        _exit_with_line(DEVICE, _with_notes(str(error), error))
    except Exception as error:
        if isinstance(error, OSError):
            _exit_if_no_error_of_ours(error)
        messages.print(traceback.format_exc(), style="dim", markup=False)
        _exit_with_line(
            INTERNAL,
            f"internal error: {type(error).__name__}: {error}; please report it with the lines above",
        )


def _exit_if_no_error_of_ours(error: OSError) -> None:
    """Exit with a line if a terminal is gone, or a file cannot be where it was to be."""
    if error.errno == errno.EIO:  # a terminal may be gone before its signal comes
        _leave_terminal()
        _exit_with_line(DEVICE, _with_notes("the terminal is gone; the drives were stopped", error))
    if error.errno in PLACES:
        status, advice = PLACES[error.errno]
        where = "" if error.filename is None else f"{error.filename}: "
        _exit_with_line(status, _with_notes(f"{where}{error.strerror}; {advice}", error))


def _print_version(is_set: bool) -> None:
    if is_set:
        print(f"pkm-rig {__version__}")
        raise typer.Exit


@app.callback()
def options(
    _version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="print the version and end")
    ] = False,
) -> None:
    """Calibrates over-constrained parallel kinematic machines on the machine itself."""


def _usage_line(error: typer.TyperException) -> str:
    """What was wrong with the command as it was typed, and what helps."""
    command: str = getattr(getattr(error, "ctx", None), "command_path", "pkm-rig")
    name, message = command.removeprefix("pkm-rig").strip(), error.format_message()
    sentence = (f"{name}: " if name else "") + message + ("" if message.endswith((".", "?")) else ".")
    if getattr(getattr(error, "param", None), "name", None) == "rig":
        return f"{sentence} Give the rig file, as --rig RIG.toml; without hardware try `pkm-rig demo`"
    return f"{sentence} See `{command} --help`"


def _with_notes(line: str, error: BaseException) -> str:
    """A message with what was added to the error on its way: active tables, campaign, how it goes on."""
    return "; ".join([line, *getattr(error, "__notes__", ())])


def _exit_with_line(status: int, line: str) -> NoReturn:
    messages.print(" ".join(f"pkm-rig: {line}".split()), markup=False, soft_wrap=True)
    sys.exit(status)


def _interrupt(signal_number: int, _frame: object) -> None:
    if signal_number == signal.SIGINT and ask_for_pause():
        return
    if signal_number == signal.SIGHUP:
        _leave_terminal()
    for number in STOPPING:  # one is enough: leaving safely must not be interrupted
        signal.signal(number, signal.SIG_IGN)
    raise Interrupted


def _leave_terminal() -> None:
    """The terminal is gone: what is still written to it would fail, and must not keep the drives from being stopped."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        if stat.S_ISCHR(os.fstat(stream).st_mode):
            os.dup2(nowhere, stream)
