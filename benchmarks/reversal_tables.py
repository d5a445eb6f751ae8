"""Tables by direction against single tables on mock machines with backlash in both drives.

Each seed's machine is calibrated twice, the same but for what its drives read: images of version 2, which have a value
for each direction, or of version 1 alone. Which drives have a reversal and of which size, the campaign's own diagnosis
says. Stopped, it goes on with the campaign that was not finished.

    python -m benchmarks.reversal_tables [--seeds 1,2] [--out runs/reversal-tables]
"""

from __future__ import annotations

import argparse
import re
import sys
from importlib import resources
from pathlib import Path

from benchmarks.calibrated_mock import calibrated_mock
from benchmarks.results_file import code_digest
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.config import embedded_rig_path
from tests.kept_results import KeptResults, key_of, until_stopped

BACKLASH = ("backlash=3e-5,place=left", "backlash=2.4e-5,place=right")
SINGLE = "single.toml"  # a profile beside the rig file


def write_rig(folder: Path, *, by_direction: bool) -> Path:
    """The embedded rig with backlash, its drives of a make that reads tables by direction or not."""
    folder.mkdir(parents=True, exist_ok=True)
    effects = ", ".join(f'"{effect}"' for effect in BACKLASH)
    text = embedded_rig_path().read_text(encoding="utf-8").replace("[mock]", f"[mock]\neffects = [{effects}]")
    if not by_direction:
        profile = (resources.files("drivers.drives") / "profiles" / "pkm-mock.toml").read_text(encoding="utf-8")
        (folder / SINGLE).write_text(profile.replace("by_direction = true\n", ""), encoding="utf-8")
        text = re.sub(r"(\nnode_id = \d+)", rf'\1\nprofile = "{SINGLE}"', text)
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def figures(outcome: CampaignOutcome) -> str:
    """Errors after, by payload, and what the tables were given."""
    after = ", ".join(
        f"{v.before.position_rms_m * 1e6:.1f} -> {v.after.position_rms_m * 1e6:.1f} "
        f"(U {2e6 * v.after.u_position_rms_m:.1f}) um at {v.payload_kg:g} kg"
        for v in outcome.verified
    )
    values = [state.get("reversal_m", 0.0) * 1e6 for state in outcome.written[0].drives.values()]
    return f"{after}; reversal values {', '.join(f'{value:.1f}' for value in values)} um; {outcome.decision}"


def main() -> int:
    """Print a line a campaign. Status 1 where tables by direction leave more than single ones."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1,2")
    parser.add_argument("--out", type=Path, default=Path("runs/reversal-tables"))
    arguments = parser.parse_args()
    if not re.fullmatch(r"\d+(,\d+)*", arguments.seeds):
        parser.error(f"--seeds {arguments.seeds}: give whole numbers with commas between them")
    code = code_digest("calibration", "drivers", "mock_devices", "pkm_rig", "benchmarks/reversal_tables.py")
    kept, worse = KeptResults(arguments.out / "campaigns.jsonl"), 0
    for seed in map(int, arguments.seeds.split(",")):
        left = {}
        for kind, by_direction in (("single", False), ("by direction", True)):
            folder, key = arguments.out / f"seed-{seed}" / kind.replace(" ", "-"), key_of(code, seed, kind)
            if key not in kept:
                with calibrated_mock(write_rig(folder, by_direction=by_direction), seed, folder / "store") as run:
                    after_m = [v.after.position_rms_m for v in run.outcome.verified]
                    kept.add({"key": key, "figures": figures(run.outcome), "after_m": after_m})
            print(f"seed {seed}, {kind:12}: {kept[key]['figures']}", flush=True)
            left[kind] = kept[key]["after_m"]
        worse += any(turned > plain for plain, turned in zip(left["single"], left["by direction"], strict=True))
    return int(worse > 0)


if __name__ == "__main__":
    sys.exit(until_stopped(main))
