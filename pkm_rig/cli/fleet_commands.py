"""What `--all` does: a command on all campaigns of a store, here or on a cluster, and pictures of all rigs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pkm_rig.errors import CampaignRefused

if TYPE_CHECKING:
    from pkm_rig.jobs.many_campaigns import Work
    from pkm_rig.jobs.worker_pool import Attempt, Task
    from pkm_rig.results.done import Done

AllOption = Annotated[bool, typer.Option("--all", help="all campaigns of the store, each result kept as it comes")]
JobsOption = Annotated[
    int | None, typer.Option("--jobs", help="with --all: processes of this computer; as many as it has cores")
]
SchedulerOption = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="with --all: of a Dask cluster that computes"),
]
AgainOption = Annotated[bool, typer.Option("--again", help="with --all: also what was computed before")]


def run_on_all(work: Work, out: Path, json: bool, jobs: int | None, scheduler: str | None, *, again: bool) -> None:
    """Do a command on all campaigns; CampaignRefused, naming them, if any failed."""
    from pkm_rig.jobs.many_campaigns import choose, work_through
    from pkm_rig.jobs.worker_pool import worker_pool
    from pkm_rig.report.fleet_text import fleet_json, print_fleet
    from pkm_rig.report.terminal import print_either, print_message, progress_bar
    from pkm_rig.store.store import open_existing_store

    with open_existing_store(out) as store, progress_bar("campaigns") as progress:
        chosen = choose(store)
        found, total = list(chosen.damaged), len(chosen.campaigns)
        with worker_pool(total, jobs, scheduler) as pool, _says_how_far(found, total, again=again):
            for done in work_through(store, out, work, chosen.campaigns, pool, again=again):
                found.append(done)
                progress(1, total, work.command)
                if done.failure:
                    print_message(f"{done.campaign}: {done.failure}")
    found.sort(key=lambda done: done.campaign)
    print_either(json, fleet_json(work.command, found, chosen.skipped), print_fleet)
    failed = [done for done in found if done.failure]
    if failed:
        raise CampaignRefused(
            f"{work.command}: {len(failed)} of {len(found)} campaigns failed: "
            + ", ".join(done.campaign for done in failed[:5])
            + (" ..." if len(failed) > 5 else "")
            + f"; {failed[0].failure}"
        )


@contextmanager
def _says_how_far(found: list[Done], total: int, *, again: bool) -> Iterator[None]:
    """What ends the work early says how far it came."""
    try:
        yield
    except BaseException as error:
        done = sum(not one.failure for one in found)
        goes_on = "the same command goes on" + (", without --again" if again else "")
        error.add_note(f"{done} of {total} campaigns are done and kept; {goes_on}")
        raise


def draw_all(tasks: list[Task], keep: Callable[[Attempt], None], jobs: int | None, scheduler: str | None) -> None:
    """Draw pictures, each kept as it comes."""
    from pkm_rig.jobs.worker_pool import worker_pool
    from pkm_rig.report.terminal import progress_bar

    with worker_pool(len(tasks), jobs, scheduler) as pool, progress_bar("rigs") as progress:
        for attempt in pool.attempts(tasks):
            keep(attempt)
            progress(1, len(tasks), "drawing")
