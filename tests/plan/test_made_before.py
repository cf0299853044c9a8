"""A diagnosis that lies beside a campaign is used while it is of the campaign as it is, and said to be old later."""

import json
import shutil

import numpy as np
import pytest
from small_worlds import small_plan

from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.plan import look
from shockrig.files.campaign import read_campaign
from shockrig.files.fingerprint import fingerprint
from shockrig.files.plan_file import read_decisions
from shockrig.protocols.adaptive import Loop
from shockrig.protocols.cli import main
from shockrig.rig.bench import virtual_bench
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.truth import Hidden, draw_truth

GOALS = "alpha 2 %, ties decided"
STEM = Hidden("stem_conduction", {"fraction": 0.04, "time_constant_s": 11.0}, ("temperature",))


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with a campaign of the thermometer alone, and its diagnosis beside it."""
    home, rng = tmp_path_factory.mktemp("home"), np.random.default_rng(71)
    campaign = simulate_campaign(draw_truth(rng, effects=[STEM]), small_plan()[::3], rng, home / "mine")
    for hyt in campaign.glob("runs/*/hyt.csv"):
        hyt.unlink()
    assert main(["diagnose", str(campaign), "--out", str(home / "found")]) == 0
    return home


@pytest.fixture
def copy(home, tmp_path):
    shutil.copytree(home, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture(scope="module")
def done():
    """Diagnoses made in this module, by what they were made of."""
    return {}


@pytest.fixture
def diagnosed(monkeypatch, done):
    """The channels that a planner diagnoses itself; of the same readings once."""
    asked, really = [], look.diagnose_channel

    def diagnose_channel(channel, **options):
        asked.append(channel.name)
        key = (channel.name, channel.run_ids, channel.value.tobytes(), repr(options))
        if key not in done:
            done[key] = really(channel, **options)
        return done[key]

    monkeypatch.setattr(look, "diagnose_channel", diagnose_channel)
    return asked


def plan(home):
    assert main(["plan", str(home / "mine"), "--until", GOALS, "--out", str(home / "next.toml")]) == 0
    return json.loads((home / "mine" / "decisions.jsonl").read_text().splitlines()[-1])


def test_a_diagnosis_of_the_campaign_as_it_is_is_used(copy, diagnosed, capsys):
    found = plan(copy)["verdicts"]["temperature"]
    assert diagnosed == []
    assert "found/diagnosis.json: is a diagnosis of this campaign as it is, and is used" in capsys.readouterr().err
    (copy / "found" / "diagnosis.json").unlink()
    (copy / "mine" / "decisions.jsonl").unlink()
    anew = plan(copy)["verdicts"]["temperature"]
    assert diagnosed and found["verdict"] == anew["verdict"] and list(found["causes"]) == list(anew["causes"])
    assert found["final"] and found["runs"] == anew["runs"]
    assert "diagnosis.json" not in capsys.readouterr().err


def test_a_loop_that_goes_on_with_the_campaign_uses_it(copy, diagnosed):
    said = []
    Loop(copy / "mine", parse_goals(GOALS), virtual_bench(), said.append)(None, 0.0)
    assert diagnosed == [] and "is a diagnosis of this campaign as it is" in said[0]
    (decision,) = read_decisions(copy / "mine")
    assert decision["verdicts"]["temperature"]["runs"] == len(decision["recorded"])


def test_one_that_is_out_of_date_is_said_to_be(copy, diagnosed, capsys):
    file = copy / "found" / "diagnosis.json"
    said = json.loads(file.read_text())
    said["made_from"]["runs"] = said["made_from"]["runs"][:-2]
    file.write_text(json.dumps(said))
    plan(copy)
    runs = len(read_campaign(copy / "mine").runs)
    assert diagnosed and f"is out of date (2 of the {runs} runs are newer)" in capsys.readouterr().err


def test_a_fingerprint_is_that_of_the_recordings(copy):
    before = read_campaign(copy / "mine")
    head = copy / "mine" / "campaign.json"
    head.write_text(json.dumps(json.loads(head.read_text()) | {"sessions": [{"operator": "somebody"}]}))
    assert fingerprint(read_campaign(copy / "mine")) == fingerprint(before)
    table = copy / "mine" / "runs" / "0004" / "imet.csv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join(lines[:-1]) + "\n")
    assert fingerprint(read_campaign(copy / "mine")) != fingerprint(before)
