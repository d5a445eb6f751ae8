"""The PLC of a rig file: its line and its register map."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.recording.columns import unit_of
from drivers.plc.modbus_line import ModbusLine, RtuLine, TcpLine, TlsLine
from drivers.plc.plc_registers import ReadingRegister, Register, RegisterMap
from pkm_rig.rig.device_sections import PlcConnection, ReadingEntry, RegisterEntry

_MEASURED = ("pressure_hpa", "humidity_percent")
_TEMPERATURE = "_temperature_c"
SIMULATED_AT = 18


def plc_line(plc: PlcConnection, rig_path: Path) -> ModbusLine:
    """The line to the PLC; files of certificates are beside the rig file."""
    if plc.transport == "rtu":
        if plc.serial_port is None:
            raise InputError("rig file: plc: RTU needs serial_port")
        return RtuLine(plc.serial_port, plc.baudrate, plc.parity, plc.stop_bits)
    if plc.transport == "tcp":
        return TcpLine(plc.host, plc.port)
    folder = rig_path.parent

    if plc.ca_file is None:
        raise InputError("rig file: plc: TLS needs ca_file, the certificate that signs the PLC's")

    def resolve(name: str | None) -> Path | None:
        return None if name is None else folder / name

    certificate, key = resolve(plc.certificate_file), resolve(plc.key_file)
    for path in (folder / plc.ca_file, certificate, key):
        if path is not None and not path.is_file():
            raise InputError(f"rig file: plc: there is no file {path}")
    return TlsLine(plc.host, folder / plc.ca_file, plc.port, certificate, key)


def register_map(plc: PlcConnection) -> RegisterMap:
    """The default map (docs/reference/plc.md) with the rig file's changes. Raises InputError in one line."""
    default = RegisterMap()
    names = {field.name for field in fields(RegisterMap)}
    changed: dict[str, Any] = dict.fromkeys(plc.without)
    temperatures = dict(default.temperatures_c)
    try:
        for name, entry in plc.registers.items():
            sensor = name.removesuffix(_TEMPERATURE)
            if sensor in temperatures and sensor != name:
                temperatures[sensor] = _register(temperatures[sensor], entry)
            elif name in _MEASURED:
                changed[name] = _register(getattr(default, name), entry)
            elif name in names - {"temperatures_c", "interlock_bits", "readings"}:
                if entry != RegisterEntry(address=entry.address):
                    raise InputError(f"rig file: plc.registers.{name}: a whole word, which has an address only")
                changed[name] = entry.address
            else:
                raise InputError(f"rig file: plc.registers names '{name}', which is not in docs/reference/plc.md")
        if plc.interlocks:
            changed["interlock_bits"] = dict(plc.interlocks)
        changed["readings"] = {entry.name: _reading_register(entry) for entry in plc.readings}
        return _with_simulated(replace(default, temperatures_c=temperatures, **changed), plc)
    except ValueError as error:
        raise InputError(f"rig file: plc: {error}") from error


def _with_simulated(registers: RegisterMap, plc: PlcConnection) -> RegisterMap:
    """The map with the register that says that a PLC is simulated, also where the rig file does not name it.

    Its default place costs nothing where it lies between others, all of which are read at once.
    """
    asked = "simulated" in plc.registers or "simulated" in plc.without
    between = registers.first <= SIMULATED_AT < registers.first + registers.count
    return registers if asked or not between else replace(registers, simulated=SIMULATED_AT)


def _reading_register(entry: ReadingEntry) -> ReadingRegister:
    unit = unit_of(entry.name)
    return ReadingRegister(**entry.model_dump(exclude={"name", "meaning"}), unit="" if unit is None else unit.symbol)


def _register(default: Register, entry: RegisterEntry) -> Register:
    return replace(default, **entry.model_dump(exclude_none=True))
