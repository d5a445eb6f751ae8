"""Draws the picture of the README from a verified campaign in the store.

python benchmarks/readme_picture.py CAMPAIGN [--out runs]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from calibration.compensation.error_map import error_map
from pkm_rig.jobs.acceptance import stored_outcome
from pkm_rig.report.maps import error_fields, error_maps
from pkm_rig.store.store import open_store


def main() -> None:
    """Write docs/images/error-map.png."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign")
    parser.add_argument("--out", type=Path, default=Path("runs"))
    options = parser.parse_args()
    with open_store(options.out) as store:
        outcome = stored_outcome(store, options.campaign)
    written = outcome.written[-1]
    fields = error_fields(error_map(outcome.calibration, written.table), outcome.reduction, written.payload)
    figure = error_maps(fields, "Errors of the tool point, 200 kg payload")
    target = Path(__file__).parent.parent / "docs" / "images" / "error-map.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=90, bbox_inches="tight", metadata={"Software": None})
    print(target)


if __name__ == "__main__":
    main()
