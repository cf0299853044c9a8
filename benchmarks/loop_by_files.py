"""The loop through files alone: `shockrig plan`, runs recorded by another program, `plan` again, until it stops.

The other program is this one. It knows the plan's JSON and the campaign's files, and imports nothing of shockrig: a
bead that warms itself (a sphere read at its core, by its series) and a film (read as its mean, by its series) between
two airs, whose rates differ by 0.3 % from run to run. It begins with a folder that is not there.

    python benchmarks/loop_by_files.py --out benchmarks/results/loop_by_files.txt
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

GOALS = "alpha 0.5 %, D 0.5 % at 20 30, ties decided, minutes 60"
ALPHA, RADIUS_M = 6.3e-8, 4e-4
D_AT_20, HALVES_K, FILM_M = 9.0e-12, 25.0, 1e-5  # doubles in 25 K
RISE_K = 0.25  # of the bead over the air at 6 m/s: a current through it
NOISE_K, NOISE_PERCENT = 0.01, 0.06
SCATTER = 0.003
PERIOD_S = 0.1
K_PER_S, SETTLE_S = 0.05, 20.0  # of the chambers
TERMS = np.arange(1, 80)[:, None]


def core_of_sphere(fourier: np.ndarray) -> np.ndarray:
    """Share of a step that the core of a sphere has still to go; Carslaw and Jaeger 1959, 9.3."""
    late = 2.0 * ((-1.0) ** (TERMS + 1) * np.exp(-((TERMS * math.pi) ** 2) * np.maximum(fourier, 1e-3))).sum(axis=0)
    return np.where(fourier < 1e-3, 1.0, late)


def mean_of_film(fourier: np.ndarray) -> np.ndarray:
    """Share of a step that the mean of a film, sealed on one face, has still to go; Crank 1975, 4.3."""
    odd = (2 * TERMS - 1) * math.pi / 2.0
    late = (2.0 / odd**2 * np.exp(-(odd**2) * np.maximum(fourier, 0.0))).sum(axis=0)
    return np.where(fourier <= 0.0, 1.0, late)


class Bench:
    """Two chambers, a bead and a film; records the runs of a plan into a campaign folder."""

    def __init__(self, campaign: Path, seed: int) -> None:
        self.campaign, self.rng = campaign, np.random.default_rng(seed)
        self.clock, self.runs, self._air_c = datetime(2026, 5, 1, 9, tzinfo=UTC), 0, 20.0

    def record(self, run: dict[str, Any]) -> None:
        """One run of NEXT.json."""
        if self.runs == 0:
            self.campaign.mkdir(parents=True, exist_ok=True)
            sensors = {"imet": {"kind": "a bead", "bead_radius_m": RADIUS_M, "body": "sphere"},
                       "hyt": {"kind": "a film", "film_thickness_m": FILM_M, "body": "film"}}  # fmt: skip
            head = {"format": "shock-campaign/1", "name": "another program's", "sensors": sensors}
            (self.campaign / "campaign.json").write_text(json.dumps(head))
        self.runs += 1
        source, destination, flow = run["source"], run["destination"], run["airflow_m_s"]
        from_c, to_c = source["temperature_c"], destination["temperature_c"]
        self.clock += timedelta(seconds=SETTLE_S + abs(from_c - self._air_c) / K_PER_S)
        start_s = run["lead_s"] + self.rng.random()
        time = np.arange(self.rng.random() * PERIOD_S, start_s + run["dwell_s"], PERIOD_S)
        since = time - start_s + 0.005 * self.rng.standard_normal()
        scatter = np.exp(SCATTER * self.rng.standard_normal(2))
        folder = self.campaign / "runs" / f"{self.runs:04d}"
        folder.mkdir(parents=True)
        left = core_of_sphere(ALPHA * scatter[0] * since / RADIUS_M**2)
        ventilated = 2.0 + 0.6 * math.sqrt(flow * 2 * RADIUS_M / 1.5e-5) * 0.71 ** (1 / 3)
        usual = 2.0 + 0.6 * math.sqrt(6.0 * 2 * RADIUS_M / 1.5e-5) * 0.71 ** (1 / 3)
        bead = to_c + (from_c - to_c) * left + RISE_K * usual / ventilated
        bead += NOISE_K * self.rng.standard_normal(time.size)
        rows = [f"{t:.4f},{y:.4f}" for t, y in zip(time, bead, strict=True)]
        (folder / "imet.csv").write_text("\n".join(["time_s,temperature_c", *rows]) + "\n")
        if from_c == to_c:  # a film that is warmed as well is more than this program knows
            rate = D_AT_20 * 2.0 ** ((to_c - 20.0) / HALVES_K) / FILM_M**2
            left = mean_of_film(rate * scatter[1] * since)
            before, after = source["humidity_percent"], destination["humidity_percent"]
            film = after + (before - after) * left + NOISE_PERCENT * self.rng.standard_normal(time.size)
            rows = [f"{t:.4f},{y:.3f},{to_c},0" for t, y in zip(time, film, strict=True)]
            (folder / "hyt.csv").write_text("\n".join(["time_s,humidity_percent,temperature_c,stale", *rows]) + "\n")
        told = {"format": "shock-run/1", "id": folder.name, "started_at": self.clock.isoformat(), "source": source,
                "destination": destination, "airflow_m_s": flow, "pressure_hpa": run["pressure_hpa"],
                "transfer": {"start_s": start_s}}  # fmt: skip
        (folder / "run.json").write_text(json.dumps(told))
        self.clock += timedelta(seconds=float(time[-1]))
        self._air_c = from_c


def can(run: dict[str, Any]) -> bool:
    """Whether this bench makes a run: it does not slow its transfer."""
    return "duration_s" not in run["transfer"]


def loop(folder: Path, goals: str, plan: Callable[[list[str]], str], seed: int, most: int = 30) -> list[str]:
    """Plan, record, plan again; what was said, a paragraph for each plan."""
    bench, said = Bench(folder / "campaign", seed), []
    for _ in range(most):
        words = plan(["plan", str(bench.campaign), "--until", goals, "--out", str(folder / "next.toml")])
        next_ = json.loads((folder / "next.json").read_text())
        said.append(f"after {bench.runs} runs\n{words}")
        if next_["status"] != "continue":
            break
        for run in filter(can, next_["runs"]):
            bench.record(run)
    return said


def shockrig(words: list[str]) -> str:
    """What the command prints."""
    command = [str(Path(sys.executable).with_name("shockrig")), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", default=GOALS)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/loop_by_files.txt"))
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        said = loop(Path(folder), args.until, shockrig, args.seed)
        truth = f"true: alpha {ALPHA:g} m2/s, D at 20 degC {D_AT_20:g} m2/s, the bead warmer than the air by {RISE_K} K"
        shockrig(["diagnose", f"{folder}/campaign", "--out", f"{folder}/diagnosis"])
        extended = ["--extend", f"{folder}/diagnosis/diagnosis.json"]
        known = shockrig(["characterize", f"{folder}/campaign", "--out", f"{folder}/found", *extended])
        text = "\n".join([f"goals: {args.until}; seed {args.seed}", *said, truth, known]).replace(folder + "/", "")
    args.out.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
