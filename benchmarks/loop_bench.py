"""A bench for the loop's benchmarks that knows files alone: runs are simulated one by one into a campaign folder.

Another program in the place of `shockrig run`: what it records is read back by `plan` like any other lab's. Its clock
counts chamber travel, the soak until the probes have settled, and the record; run.json says when each run began.
"""

from __future__ import annotations

import datetime
import json
import math
import shutil
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from shockrig.analysis.design.goals import Goals
from shockrig.analysis.plan.decide import decide, with_due
from shockrig.analysis.plan.decision import Decision
from shockrig.files.campaign import Campaign, read_campaign
from shockrig.rig.seams import Air
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import GOLDEN_RATIO, Shock
from shockrig.rig.virtual.truth import Truth

BEGAN = datetime.datetime(2026, 5, 1, tzinfo=datetime.UTC)
WAY_BACK_S = 2.0
SETTLED_K, SETTLED_PERCENT = 0.02, 0.1  # of the probes, as `rig.protocol.Soak` has them


def commit() -> str:
    """Of the code that is measured, as git names it; "+" where something is changed."""
    words = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    here = Path(__file__).parent
    return subprocess.run(words, cwd=here, capture_output=True, text=True, check=False).stdout.strip()


class Waiting:
    """Decisions whose diagnoses are made while the next run is recorded; `waited_s` is how long the bench stood still.

    The bench's own clock says how long a soak and a record last; thinking is counted in processor time, whatever else
    the machine does. A diagnosis that takes longer than the run beside it keeps the bench waiting for the rest.
    """

    def __init__(self) -> None:
        self.waited_s = 0.0
        self.behind_s = 0.0
        self._clock_s = 0.0

    def decide(self, bench: FileBench, goals: Goals, before: Decision | None) -> Decision:
        """The next decision on a campaign."""
        seen = bench.seen()
        run_s, self._clock_s = bench.clock_s - self._clock_s, bench.clock_s
        began_s = time.process_time()
        if before is not None:
            before = with_due(seen, before)
        behind_s = time.process_time() - began_s
        decision = decide(seen, goals, before, later=True)
        self.behind_s += behind_s
        self.waited_s += time.process_time() - began_s - min(behind_s, run_s)
        return decision


class FileBench:
    """Records runs of one truth into one campaign folder; `minutes` is the bench time so far."""

    def __init__(self, truth: Truth, folder: Path, seed: int, travel_s_per_k: float = 0.0) -> None:
        self.truth, self.folder, self.seed = truth, folder, seed
        self.travel_s_per_k = travel_s_per_k
        self.clock_s = 0.0
        self.runs = 0
        self._before: Shock | None = None

    @property
    def minutes(self) -> float:
        return self.clock_s / 60.0

    def campaign(self) -> Campaign | None:
        """What has been recorded, read back; None where nothing has."""
        return read_campaign(self.folder) if self.runs else None

    def seen(self) -> list[Campaign]:
        """The same as its only probe saw it; none before the first run."""
        return [read_campaign(self.folder)] if self.runs else []

    def record_run(self, run: Mapping[str, Any], over_s: float = 12.0) -> None:
        """Record one run of a plan (`shock-plan/1`)."""
        shock = Shock(
            "0001",
            Air(**run["source"]),
            Air(**run["destination"]),
            run["airflow_m_s"],
            run["pressure_hpa"],
            transfer_duration_s=run["transfer"].get("duration_s"),
            extra={k: run[k] for k in ("irradiance_w_m2",) if k in run},
        )
        self.record(shock, run["lead_s"], (shock.transfer_duration_s or 0.0) + run["dwell_s"], over_s)

    def record(self, shock: Shock, lead_s: float, after_s: float, over_s: float) -> None:
        """Soak, record, transfer, record."""
        self.runs += 1
        self.clock_s += self._soak_s(shock, over_s) + WAY_BACK_S
        began = BEGAN + datetime.timedelta(seconds=self.clock_s)
        lead_s = round(lead_s + (self.runs * GOLDEN_RATIO) % 1.0, 4)
        shock = Shock(**{**vars(shock), "id": "0001", "lead_s": lead_s, "duration_s": lead_s + after_s})
        part = self.folder.with_name(self.folder.name + ".part")
        rng = np.random.default_rng([self.seed, self.runs])
        simulate_campaign(self.truth, [shock], rng, part, name=self.folder.name)
        run = part / "runs" / "0001"
        head = json.loads((run / "run.json").read_text())
        head |= {"id": f"{self.runs:04d}", "started_at": began.isoformat().replace("+00:00", "Z")}
        (run / "run.json").write_text(json.dumps(head))
        if not self.folder.exists():
            (self.folder / "runs").mkdir(parents=True)
            shutil.copy(part / "campaign.json", self.folder / "campaign.json")
        shutil.move(run, self.folder / "runs" / head["id"])
        shutil.rmtree(part)
        self.clock_s += lead_s + after_s
        self._before = shock

    def _soak_s(self, shock: Shock, over_s: float) -> float:
        """Until chambers and probes stand still; the probes come from where the last run left them."""
        if self._before is None:
            return over_s
        source, left = shock.source, self._before.destination
        kelvin = abs(source.temperature_c - left.temperature_c)
        percent = abs(source.humidity_percent - left.humidity_percent)
        travel_s = self.travel_s_per_k * max(
            abs(a.temperature_c - b.temperature_c)
            for a, b in ((source, self._before.source), (shock.destination, self._before.destination))
        )
        bead_s = self.truth.bead_radius_m**2 / (math.pi**2 * self.truth.thermal_diffusivity_m2_s)
        film_s = 4.0 * self.truth.film_thickness_m**2 / math.pi**2
        film_s /= float(self.truth.diffusivity_m2_s(source.temperature_c))
        settle_s = max(
            bead_s * math.log(max(kelvin / SETTLED_K, 1.0)), film_s * math.log(max(percent / SETTLED_PERCENT, 1.0))
        )
        return travel_s + settle_s + over_s
