"""Recordings in progress, made by hand as the recorder writes them, for tests of watching."""

import json
import os

from shockrig.rig.journal import JournalWriter
from shockrig.rig.protocol import Record
from shockrig.rig.watch.status_file import step_entry


def made_campaign(path, records, status=None, runs=3):
    """A campaign folder with a run in progress, as the recorder writes it."""
    folder = path / "recording" / "0001"
    folder.mkdir(parents=True)
    entry = {"source": {"temperature_c": 20}, "destination": {}, "note": "", "steps": ["soak", "record 20 s"]}
    content = {"format": "shock-campaign/1", "name": path.name, "protocol": "p", "bench": "b"}
    content["plan"] = [{"id": f"{i + 1:04d}", **entry} for i in range(runs)]
    (path / "campaign.json").write_text(json.dumps(content))
    if status is not None:
        (path / "status.json").write_text(json.dumps(status))
    journal = JournalWriter(folder / "journal.log", None)
    for one in [["run", {"id": "0001", "sensors": ["imet", "hyt"], "steps": entry["steps"]}], *records]:
        journal.append(one, 0.0)
    return journal


def reading(sensor, at_s, outcome="ok", **values):
    return ["reading", sensor, outcome, at_s, at_s + 0.1, at_s, values, ""]


STATUS = {
    "state": "recording",
    "pid": os.getpid(),
    "host": "elsewhere",
    "began_s": 0.0,
    "steps": [{"text": "soak", "at_least_s": 30.0, "at_most_s": 600.0}, step_entry(Record(20.0))],
    "planned_s": {"0001": [50.0, 620.0], "0002": [50.0, 620.0], "0003": [50.0, 620.0]},
}
