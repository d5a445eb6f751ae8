"""The tables in the drives, for people."""

from __future__ import annotations

from typing import Any

from rich.text import Text

from pkm_rig.report.terminal import results

MODES = {"off": "uses none", "kept": "uses bank {}", "trial": "uses bank {} on trial"}


def print_tables(shown: dict[str, Any]) -> None:
    """What each drive holds and uses, and in one line what is active."""
    for name, drive in shown["drives"].items():
        valid = "" if drive["mode"] == "off" or drive["valid"] else ", which is not for the payload that is on"
        _print(f"drive {name}: {MODES[drive['mode']].format(drive['bank'])}{valid}")
        for bank in drive["banks"]:
            _print(f"  bank {bank['number']}: {_bank(bank)}")
    if shown["host"] is not None:
        _print_host(shown["host"])
    _print(f"tables: {shown['tables']}")


def _print_host(host: dict[str, Any]) -> None:
    """What this computer corrects of its targets where it leads the drives."""
    if host["campaign"] is None:
        _print("host: no correction was accepted")
        return
    does = "corrects" if host["on"] else "does not correct; it has"
    _print(f"host: {does} generation {host['generation']}, CRC {host['crc']:08X}, campaign {host['campaign']}")
    for load in host["payloads"]:
        parts = ", ".join(f"{name} {t:.1f}" for name, t in sorted(load["temperatures_c"].items()))
        sizes = ", ".join(
            f"{name} {size['value'] * 1e6:.0f} u{size['unit']}" for name, size in load["largest_correction"].items()
        )
        _print(f"  {load['payload_kg']:g} kg, degC: {parts}; up to {sizes}")


def _bank(bank: dict[str, Any]) -> str:
    if bank["status"] != "whole":
        return "empty" if bank["status"] == "empty" else "damaged, or not for this drive"
    campaign = f"campaign {bank['campaign']}" if bank["campaign"] else "of a campaign that is not in this store"
    other = "" if bank["of_this_machine"] else ", OF ANOTHER MACHINE"
    return f"generation {bank['generation']} for {bank['payload_kg']:g} kg, CRC {bank['crc']:08X}, {campaign}{other}"


def _print(line: str) -> None:
    results.print(Text(line), soft_wrap=True)
