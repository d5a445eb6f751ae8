"""Commands that connect a rig for its devices' sake: check, home, interim-test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pkm_rig.cli.options import JsonOption, OutOption, RigOption
from pkm_rig.errors import CampaignRefused


def check(rig: RigOption, out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """Connect, read identities, units and interlocks; report every obstacle to a campaign."""
    from pkm_rig.jobs.check import check_devices
    from pkm_rig.jobs.session import open_rig, store_if_there
    from pkm_rig.report.check_text import print_check
    from pkm_rig.report.terminal import print_either, print_message
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.table_recovery import end_unfinished_change

    with store_if_there(out) as store, open_rig(rig, needs=Need.MOTION) as connected_rig:
        end_unfinished_change(connected_rig, store, print_message)
        check_result = check_devices(connected_rig)
    print_either(json, check_result, print_check)
    if check_result["problems"]:
        raise CampaignRefused(check_result["problems"][0])


def home(
    rig: RigOption,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    again: Annotated[bool, typer.Option("--again", help="all drives, also those that are referenced")] = False,
) -> None:
    """Home the drives that have lost their reference, one after the other: they move."""
    from pkm_rig.jobs.homing import home_drives
    from pkm_rig.jobs.session import open_rig, store_if_there
    from pkm_rig.report.homing_text import print_homing
    from pkm_rig.report.terminal import print_either, print_message
    from pkm_rig.rig.capabilities import Need
    from pkm_rig.rig.table_recovery import settle_tables

    needs = Need.HOMING if again else Need.NOTHING
    with store_if_there(out) as store, open_rig(rig, needs=needs, homing=True) as connected_rig:
        settle_tables(connected_rig, store, print_message)
        homing_result = home_drives(connected_rig, again=again, store=store)
    print_either(json, homing_result, print_homing)


def interim_test(rig: RigOption, out: OutOption = Path("runs"), json: JsonOption = False) -> None:
    """Test the station on the floor nests: two-face errors and the certified distance, pass or fail."""
    from pkm_rig.jobs.interim import run_interim_test
    from pkm_rig.jobs.session import open_rig, store_if_there
    from pkm_rig.report.interim_text import interim_test_json, print_interim_test
    from pkm_rig.report.terminal import print_json, print_message, print_simulated
    from pkm_rig.rig.table_recovery import end_unfinished_change

    with store_if_there(out) as store, open_rig(rig) as connected_rig:
        end_unfinished_change(connected_rig, store, print_message)
        test_result = run_interim_test(connected_rig)
        simulated = bool(connected_rig.simulated_devices)
    if json:
        print_json(interim_test_json(test_result, simulated=simulated))
    else:
        print_simulated(simulated)
        print_interim_test(test_result)
    if not test_result.passed:
        raise CampaignRefused(f"interim test: {test_result.failures[0]}; have the station checked before measuring")
