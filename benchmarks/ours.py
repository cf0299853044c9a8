"""This project as the benchmarks use it: a campaign folder in, its profile and diagnosis as their files say them, and
errors on runs that the fit never saw. The only place in these benchmarks that knows the analysis from inside.
"""

from __future__ import annotations

import json
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LIMIT_S = 300


@dataclass
class Outcome:
    """What came of one campaign: the contents of the files, or why there are none.

    `refused` holds the one-line errors that a user would see, `crashed` tracebacks and time-outs, both by command.
    `found` is the diagnosis itself, for `fresh_errors`.
    """

    plain: dict[str, Any] | None = None
    extended: dict[str, Any] | None = None
    diagnosis: dict[str, Any] | None = None
    refused: dict[str, str] = field(default_factory=dict)
    crashed: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    found: Any = None

    def tells(self, channel: str) -> dict[str, Any] | None:
        """The diagnosis of one channel; None where there is none."""
        return None if self.diagnosis is None else self.diagnosis["channels"].get(channel)


class Late(Exception):
    """A command took longer than its limit."""


@contextmanager
def _limit(seconds: int) -> Iterator[None]:
    def late(*_: object) -> None:
        raise Late(f"not done after {seconds} s of the processor")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)  # of the processor: a busy machine fails nobody
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def judge(
    campaign: str | Path, seed: int = 0, limit_s: int = LIMIT_S, characterized: bool = True, exact: bool = False
) -> Outcome:
    """Characterize and diagnose a campaign, as the two commands do but for their reports.

    With `exact` the tolerances are 0: every significant remainder is material.
    """
    outcome = Outcome()
    if characterized:
        _try(outcome, "characterize", limit_s, lambda: _characterize(outcome, Path(campaign), seed))
    _try(outcome, "diagnose", limit_s, lambda: _diagnose(outcome, Path(campaign), seed, exact))
    return outcome


def _try(outcome: Outcome, command: str, limit_s: int, work: Callable[[], None]) -> None:
    from shockrig.files.errors import InputError

    started = time.process_time()
    try:
        with _limit(limit_s):
            work()
    except InputError as error:
        outcome.refused[command] = str(error)
    except Late as error:
        outcome.crashed[command] = str(error)
    except Exception:  # a benchmark counts every fault and goes on
        outcome.crashed[command] = traceback.format_exc(limit=-3)
    outcome.seconds[command] = time.process_time() - started


def _characterize(outcome: Outcome, campaign: Path, seed: int) -> None:
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.characterize.result import to_profile
    from shockrig.files.campaign import read_campaign

    outcome.plain = _as_file(to_profile(characterize(read_campaign(campaign), seed)))


def _diagnose(outcome: Outcome, campaign: Path, seed: int, exact: bool) -> None:
    from shockrig.analysis.diagnose.diagnose import diagnose
    from shockrig.analysis.diagnose.diagnosed import to_json
    from shockrig.analysis.diagnose.extended_profile import extended_profile, extended_result
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.files.campaign import read_campaign

    recorded = read_campaign(campaign)
    outcome.found = diagnose(recorded, tolerance=Tolerance(0.0, 0.0) if exact else None)
    outcome.diagnosis = to_json(outcome.found)
    results = {found.name: extended_result(found) for found in outcome.found.channels}
    if any(results.values()):
        outcome.extended = _as_file(extended_profile(recorded, seed, results, {}))


def _as_file(profile: Any) -> dict[str, Any]:
    from shockrig.files.profile import write_profile

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "profile.json"
        write_profile(profile, file)
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return content


def fresh_errors(outcome: Outcome, campaign: str | Path, channel: str) -> tuple[float, float] | None:
    """Rms errors on another campaign of the same sensor, plain and extended, its runs' starts and airs placed.

    None where the diagnosis has nothing to predict with.
    """
    import numpy as np

    found = fresh_run_errors(outcome, campaign, channel)
    return None if found is None else (float(np.nanmean(found[0]) ** 0.5), float(np.nanmean(found[1]) ** 0.5))


def fresh_run_errors(outcome: Outcome, campaign: str | Path, channel: str) -> tuple[Array, Array] | None:
    """The same as mean squares of each run of that campaign (R,); NaN for those that a diagnosis leaves out."""
    import numpy as np

    from shockrig.analysis.diagnose.held_out import plainly, run_errors
    from shockrig.analysis.estimate.problem import DRIFT_SCATTER

    if (beside := _beside(outcome, campaign, channel)) is None:
        return None
    found, recorded, fresh, problem = beside
    used = np.isin([run.id for run in recorded.runs], fresh.run_ids)
    before, after = np.full((2, used.size), np.nan)
    # No rival lets the air of a run that it is judged on drift, where nobody recorded it.
    plain, fit = (replace(one, drift_scatter=DRIFT_SCATTER) for one in (found.plain, found.predicting.fit))
    before[used] = run_errors(fresh, problem, plainly(plain))
    after[used] = run_errors(fresh, problem, fit) if fit.structure.effects else before[used]
    return before, after


def _beside(outcome: Outcome, campaign: str | Path, channel: str) -> tuple[Any, Any, Any, Any] | None:
    """The diagnosis of a channel, and another campaign of it: as recorded, its channel and the problem of that. None
    where there is none, or what is known of the one is nothing of the other."""
    from shockrig.analysis.diagnose.prepare import prepare
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import read_campaign

    found = next((c for c in outcome.found.channels if c.name == channel), None) if outcome.found else None
    recorded = read_campaign(campaign)
    fresh = build_channel(recorded, channel)
    if found is None or fresh is None or fresh.rates != found.problem.channel.rates:
        return None
    return found, recorded, fresh, prepare(fresh, found.noise.averaged).problem


def borne_out(outcome: Outcome, campaign: str | Path, channel: str) -> list[tuple[float, bool]]:
    """Of each effect of a diagnosis's likeliest model its probability, and whether unseen runs bear it out: at the rate
    that runs have in common that model leaves less of another campaign than the likeliest one without the effect does.
    """
    from shockrig.analysis.diagnose.held_out import run_errors
    from shockrig.analysis.estimate.refitting import as_judged

    if (beside := _beside(outcome, campaign, channel)) is None:
        return []
    found, _, fresh, bins = beside

    def left(model: Any) -> float:
        judged = as_judged(found.problem, model.fit)
        return float("nan") if judged is None else float(run_errors(fresh, bins, judged).mean())

    search = found.search
    likeliest = search.pool[0]
    said = []
    for effect in sorted(likeliest.ids - search.plain.ids):
        without = next((one for one in search.pool if not one.holds(effect)), None)
        if without is not None:
            said.append((search.probability(effect), left(likeliest) < left(without)))
    return said


def judged_from(campaign: str | Path, channel: str) -> dict[str, float]:
    """The first reading of each run that is used [s]: one that drifts before its start is used from there on."""
    from shockrig.analysis.estimate.gather import usable_runs
    from shockrig.files.campaign import read_campaign

    return {one.run.id: float(one.trace.time_s[0]) for one in usable_runs(read_campaign(campaign), channel)[0]}


def t63(profile: dict[str, Any] | None, channel: str) -> tuple[float, float | None] | None:
    """A profile's t63 with its standard uncertainty [s], the first ambient's of a film; None where there is none.

    The profile may state the uncertainty as `t63_standard_uncertainty` beside it. Else, where the profile carries no
    effect, it is that of the rate, to which t63 is inverse; with effects it is then not stated.
    """
    part = (profile or {}).get(channel)
    if not part:
        return None
    if channel == "temperature":
        times, rate = part.get("response_time_s"), part.get("thermal_diffusivity_m2_s")
    else:
        times = (part.get("response_time_s") or [None])[0]
        row = (part.get("diffusivity_table") or [None])[0]
        rate = row and {"value": row["diffusivity_m2_s"], "standard_uncertainty": row["standard_uncertainty"]}
    if not times:
        return None
    value = times["t63"]
    stated = times.get("t63_standard_uncertainty")
    if stated is None and rate and not part.get("effects"):
        stated = value * rate["standard_uncertainty"] / rate["value"]
    return value, stated


def rate(profile: dict[str, Any] | None, channel: str) -> tuple[float, float] | None:
    """A profile's alpha or D (the first row's) with its standard uncertainty [m^2/s]; None where there is none."""
    part = (profile or {}).get(channel)
    if not part:
        return None
    if channel == "temperature":
        value = part["thermal_diffusivity_m2_s"]
        return value["value"], value["standard_uncertainty"]
    row = part["diffusivity_table"][0]
    return row["diffusivity_m2_s"], row["standard_uncertainty"]
