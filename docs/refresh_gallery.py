"""Runs the commands of the gallery of other people's logs, writes what they print into it and draws its figures;
`--check` only compares the page (words as they are, numbers within 5 % or two of their last digit).
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from refresh_tutorial import agree, printed_by

from shockrig.analysis.physics.driven import respond
from shockrig.analysis.physics.modes import first_order

HERE = Path(__file__).parent
PAGE, IMAGES = HERE / "gallery_logs.md", HERE / "images"
PUBLISHED_T63_S = {"control": 217, "open": 124, "closed": 381}  # README of Project Haar's folder Testing
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TABLE = re.compile(r"(?<=<!-- response times -->\n).*?(?=<!-- end -->)", re.DOTALL)
FOUND = re.compile(r"^ +(control|open|closed)\.temperature: .* 63 % after ([\d.e+]+) s$", re.MULTILINE)

LAG = re.compile(r"like a lag of (\d+) s \(run 0001\)")
STYLE = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
BLUE, YELLOW, GREEN = "#0072b2", "#e69f00", "#009e73"


def main() -> int:
    """Write the page and its figures anew, or compare the page; 1 where it is out of date."""
    parser = argparse.ArgumentParser(description=__doc__.partition(";")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; say what differs")
    check = parser.parse_args().check
    text, here = PAGE.read_text(encoding="utf-8"), Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            Path("data").symlink_to(HERE.parent / "data")
            made = BLOCK.sub(lambda m: f"```console\n{printed_by(m[1])}```", text)
            found = {name: float(seconds) for name, seconds in FOUND.findall(made)}
            made = TABLE.sub(lambda _: times_table(found), made)
            if not check:
                PAGE.write_text(made, encoding="utf-8")
                draw_times(IMAGES / "real_haar_times.png")
                draw_closed(IMAGES / "real_haar_closed.png", float(LAG.search(made)[1]))
                (IMAGES / "real_rbr_first.png").write_bytes(Path("first/temperature_seen.png").read_bytes())
                return 0
        finally:
            os.chdir(here)
    if agree(text, made):
        return 0
    print("".join(difflib.unified_diff(text.splitlines(True), made.splitlines(True), PAGE.name, "what is printed")))
    print(f"{PAGE} is out of date; run {Path(__file__).name}", file=sys.stderr)
    return 1


def times_table(found: dict[str, float]) -> str:
    """Times to 63 % as a table, found beside published."""
    rows = [f"| {name} | {PUBLISHED_T63_S[name]} | {seconds:.0f} |\n" for name, seconds in found.items()]
    return "".join(["\n| housing | published, s | found, s |\n|---|---|---|\n", *rows, "\n"])


def draw_times(path: Path) -> None:
    """The three sensors' way in the box, each over its own range, with the published times."""
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
        for name, colour in zip(PUBLISHED_T63_S, (BLUE, YELLOW, GREEN), strict=True):
            run = Path("haar") / name / "runs" / "0001"
            frame = pd.read_csv(run / "imet.csv")
            seen_s = float(re.search(r'"step_seen_s": ([\d.]+)', (run / "run.json").read_text())[1])
            time, value = frame["time_s"].to_numpy() - seen_s, frame["temperature_c"].to_numpy()
            begin, end = np.median(value[(time > -60) & (time < 0)]), np.median(value[-value.size // 20 :])
            shown = (time > -150) & (time < 1500)
            axes.plot(time[shown], 100 * (value[shown] - begin) / (end - begin), color=colour, label=name)
            axes.plot(PUBLISHED_T63_S[name], 63.2, "o", color=colour, markerfacecolor="white")
        axes.axhline(63.2, color="0.6", linewidth=0.7, linestyle=":")
        axes.set_xlabel("time since the step is seen, s")
        axes.set_ylabel("share of the way, %")
        axes.legend(loc="lower right", title="circles: published")
        figure.savefig(path, dpi=110)
        plt.close(figure)


def draw_closed(path: Path, lag_s: float) -> None:
    """The closed housing beside the open one as its air, and a lag of so many seconds driven by that air."""
    run = Path("haar") / "closed" / "runs" / "0001"
    reading, air = (pd.read_csv(run / name) for name in ("imet.csv", "air.csv"))
    time, value = (reading[name].to_numpy() for name in ("time_s", "temperature_c"))
    told = air["temperature_c"].notna()
    air_time, air_value = (air.loc[told, name].to_numpy() for name in ("time_s", "temperature_c"))
    shown = time < 3500
    lagged = respond(first_order(np.array(lag_s)), air_time, air_value, time[shown])
    with mpl.rc_context(STYLE):
        figure, (above, below) = plt.subplots(
            2, figsize=(6.4, 4.2), layout="constrained", sharex=True, height_ratios=(3, 1)
        )
        above.plot(
            air_time[air_time < 3500], air_value[air_time < 3500], color=YELLOW, label="open housing, as the air"
        )
        above.plot(time[shown], value[shown], color=GREEN, label="closed housing")
        above.plot(time[shown], lagged, "--", color="0.2", linewidth=1, label=f"a lag of {lag_s:.0f} s behind that air")
        below.plot(time[shown], value[shown] - lagged, color=GREEN)
        below.axhline(0, color="0.6", linewidth=0.7)
        above.set_ylabel("temperature, °C")
        below.set_ylabel("difference, K")
        below.set_xlabel("time of the record, s")
        above.legend(loc="lower right")
        figure.savefig(path, dpi=110)
        plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
