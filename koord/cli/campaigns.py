"""``koord sim --runs K``: many runs with seeds of their own, as a table."""

from __future__ import annotations

import argparse
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterator

from msgspec.structs import replace

from koord.api.campaign import (
    MOST_RUNS,
    Campaign,
    CampaignBegun,
    CampaignRequest,
    make_campaign,
)
from koord.api.campaign_figures import mean_words, rate_words, until_of
from koord.api.fitting import FitRequest
from koord.api.progress import Progress
from koord.api.sim_report import still_words
from koord.cli.exits import Exit
from koord.cli.progress import Interruption, LiveLine
from koord.cli.terminal import Paint, style_of, visible

#: The flags that say how one run is made or shown.
OF_ONE_RUN = ("html", "trace", "record", "processes", "planners", "live", "pace")


def campaign_request(arguments: argparse.Namespace) -> CampaignRequest:
    """Make the request of a campaign. Raises ArgumentTypeError and KoordError, before long work."""
    given = [f"--{name}" for name in OF_ONE_RUN if getattr(arguments, name)]
    if given:
        those = " and ".join(given)
        raise ArgumentTypeError(
            f"{those} {'is' if len(given) == 1 else 'are'} of one run: leave out --runs and --sweep"
        )
    if arguments.resume and arguments.csv is None and arguments.parquet is None:
        raise ArgumentTypeError("--resume goes on with the runs in a file: say --csv FILE")
    until = None if arguments.until is None else until_of(dict([arguments.until]))
    swept, values = (None, ()) if arguments.sweep is None else arguments.sweep
    request = CampaignRequest(
        runs=(1 if until is None else MOST_RUNS) if arguments.runs is None else arguments.runs,
        until=until,
        jobs=arguments.jobs,
        cluster=arguments.cluster,
        swept=swept,
        values=values,
        rounds=arguments.rounds,
        duration_s=arguments.time,
        check_summaries=arguments.check_summaries,
        kernels=arguments.kernels == "on",
        csv=arguments.csv,
        parquet=arguments.parquet,
        resume=arguments.resume,
        plot=arguments.plot,
    )
    request.check()
    return request


def campaign(
    arguments: argparse.Namespace, wanted: FitRequest, request: CampaignRequest, first_seed: int
) -> int:
    """Make the runs, report on them, and return the exit code. Raises KoordError."""
    with Interruption() as interruption, LiveLine(sys.stderr) as line:

        def show(told: Progress) -> None:
            if not isinstance(told, CampaignBegun):
                line.show(told.message)
            elif told.known and not arguments.json:
                print(told.message)

        made = make_campaign(replace(wanted, seed=first_seed), request, show, interruption)
    if arguments.json:
        sys.stdout.write(made.to_json() + "\n")
    else:
        for text in _table(made):
            print(text)
    if made.interrupted:
        return Exit.INTERRUPTED
    if any(row.is_bad for row in made.runs):
        return Exit.VIOLATED
    return Exit.STUCK if any(row.stuck for row in made.runs) else Exit.OK


def _table(campaign: Campaign) -> Iterator[str]:
    """A line for each value that was swept: means, with intervals of 95 %."""
    style, rows = style_of(sys.stdout), campaign.runs
    if not rows:
        yield "no run was done"
        return
    heads = [
        campaign.swept,
        "runs",
        "done",
        "time s",
        "distance m",
        "waited s",
        "nearest m",
        "broken",
        "broken %",
        "×",
    ]
    lines = [heads]
    for value, group in campaign.groups().items():
        times, alpha = [row.taken_s for row in group], campaign.alpha(group)
        near = [row.separation_m for row in group if row.separation_m is not None]
        broken = sum(row.is_bad for row in group)
        done = sum(row.is_done for row in group)
        speed = sum(row.time_s for row in group) / max(sum(row.wall_s for row in group), 1e-9)
        lines.append(
            [
                value,
                str(len(group)),
                str(done),
                mean_words([time for time in times if time is not None], alpha),
                mean_words([row.distance_m for row in group], alpha),
                mean_words([row.waited_s for row in group], alpha),
                f"{min(near):.2f}" if near else "-",
                str(broken),
                rate_words(broken, len(group), alpha),
                f"{speed:.0f}",
            ]
        )
    widths = [max(len(line[k]) for line in lines) for k in range(len(heads))]
    heading = f"{campaign.program}: {len(rows)} runs{campaign.common()}, means with 95 % intervals"
    yield style.paint(visible(heading), Paint.BOLD)
    for line in lines:
        yield "  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
    bad = [row for row in rows if row.is_bad]
    for row in [row for row in rows if row.stuck][:10]:
        yield (
            f"{style.paint('stuck', Paint.ERROR)}: {row.robots} robots, seed {row.seed}: "
            f"{still_words(row.stuck)}"
        )
    for row in bad[:10]:
        what = f"{row.broken} claims broken" if row.broken else row.ending
        yield f"{style.paint('broken', Paint.ERROR)}: {row.robots} robots, seed {row.seed}: {what}"
