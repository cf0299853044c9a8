"""`shockrig fly` on emulated instruments in real time, with faults: what is lost, how late messages are, what it costs.

    python benchmarks/fly_real_time.py [SECONDS]        600 by default; needs a C compiler for the preload library

A serial line falls silent, the I2C bus does not answer, a chip is slow, lines come twice, a MAVLink port is
never read, and in the middle the process is killed (SIGKILL) and started again. Beside it a peer that computes for some
milliseconds each period, as a row does, tells how much of the delay is the machine's own.
"""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files.profile import write_profile
from shockrig.rig.recorder.run_journal import read_run

PERIOD_S = 0.1
ROW_S = 0.005  # of processor, that a row takes or less
BENCH = """[bench]
name = "drone"
[sensors.imet]
kind = "imet-xf"
port = "{port}"
[sensors.hyt]
kind = "hyt-271"
bus = 1
[stage]
kind = "manual"
[reference]
kind = "set-points"
"""


class Peer(threading.Thread):
    """Computes for `ROW_S` of processor each period and notes how late it is done."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.late_s: list[float] = []
        self.done = threading.Event()

    def run(self) -> None:
        due = time.monotonic()
        while not self.done.wait(max(due - time.monotonic(), 0.0)):
            used = time.thread_time()
            while time.thread_time() - used < ROW_S:
                pass
            self.late_s.append(time.monotonic() - due)
            due = max(due + PERIOD_S, time.monotonic())


def delays(late_s: np.ndarray) -> str:
    return (
        f"median {1e3 * np.median(late_s):.1f} ms, 99 % {1e3 * np.quantile(late_s, 0.99):.1f} ms, longest "
        f"{1e3 * late_s.max():.0f} ms; below a period in {100 * np.mean(late_s < PERIOD_S):.2f} %"
    )


def shockrig(*words: str) -> list[str]:
    return [sys.executable, "-m", "shockrig", *words]


def flown(command: list[str], environment: dict[str, str], for_s: float, number: int) -> tuple[float, float]:
    """Seconds of processor and of time that a flight took until it was sent a signal; the processor's from when it
    flew on."""
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        time.sleep(min(5.0, for_s / 4))
        began, used = time.monotonic(), _processor_s(process.pid)
        time.sleep(max(for_s - 5.0, 0.0))
        used, took = _processor_s(process.pid) - used, time.monotonic() - began
        process.send_signal(number)
    return used, took


def _processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    total_s = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_profile(typical_profile(), folder / "profile.json")
        (folder / "bench.toml").write_text(BENCH.format(port=folder / "ttyXF"))
        unread, stalled = os.openpty()
        parts = np.array([0.15, 0.3, 0.75, 0.85]) * total_s
        kinds = "silence", "nack", "slow", "doubled"
        faults = [f"{kind}@{at:.0f}-{at + 5:.0f}" for kind, at in zip(kinds, parts, strict=True)]
        emulator = subprocess.Popen(
            shockrig("emulate", "imet-xf", "hyt-271", "--link", str(folder / "ttyXF"), "--folder", str(folder / "bus"),
                     "--truth", str(folder / "said.csv"), *(w for fault in faults for w in ("--fault", fault))),
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert emulator.stdout is not None
        for line in emulator.stdout:
            if "export" in line:
                break
        environment = dict(os.environ) | dict(word.split("=", 1) for word in line.split()[1:])
        command = shockrig("fly", "--bench", str(folder / "bench.toml"), "--profile", str(folder / "profile.json"),
                           "--out", str(folder / "flights"), "--mavlink", "udpout:127.0.0.1:14550",
                           "--mavlink", os.ttyname(stalled), "--dronecan", "mcast:")  # fmt: skip
        peer = Peer()
        peer.start()
        try:
            spent = [flown(command, environment, total_s / 2, n) for n in (signal.SIGKILL, signal.SIGTERM)]
        finally:
            emulator.send_signal(signal.SIGINT)
            emulator.wait()
            peer.done.set()
        os.close(unread)
        print(f"{total_s:g} s in two flights, the first one killed; faults {', '.join(faults)}; one port never read")
        late, rows, damaged, answers = [], 0, [], 0
        for flight in sorted((folder / "flights").iterdir()):
            run = read_run(flight)
            damaged.append(run.damage or "none")
            answers += sum(len(readings) for readings in run.readings.values())
            text = (flight / "flight.csv").read_text()
            table = list(csv.DictReader(text[: text.rindex("\n")].splitlines()))
            rows += len(table)
            late += [float(row["sent_s"]) - float(row["came_s"]) for row in table if row["came_s"]]
            print(f"flight {flight.name}: {run.status}, {len(table)} rows; {'; '.join(t for _, t in run.notes)}")
            said = {(one.sensor, round(one.sampled_s, 5)) for readings in run.readings.values() for one in readings
                    if one.sampled_s is not None}  # fmt: skip
            lost = [row for row in table if row["temperature_c"] and not any(
                ("imet", round(float(row["time_s"]) + d, 5)) in said for d in (-1e-5, 0.0, 1e-5))]  # fmt: skip
            print(f"  rows whose reading is not in the journal: {len(lost)}; damage: {damaged[-1]}")
        print(f"{rows} rows, {answers} answers of sensors")
        print(f"from reading to message: {delays(np.array(late))}")
        print(f"the peer, {1e3 * ROW_S:g} ms of processor each: {delays(np.array(peer.late_s))}")
        print(f"processor: {100 * sum(u for u, _ in spent) / sum(t for _, t in spent):.1f} % of one core")


if __name__ == "__main__":
    main()
